"""How well data determine each knob."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urbantwin.fidelity.tuning.knobs import Knob
from urbantwin.fidelity.tuning.loss import Loss
from urbantwin.fidelity.tuning.study import Term

__all__ = ["VAGUE", "sharpness"]

#: Steps of the differences, as a share of the distance between the bounds.
_STEP = 0.015
#: A knob with a larger standard error, as that share, is not determined.
VAGUE = 0.08
#: Curvature below which a direction is flat, in losses for the bounds' distance squared.
_FLAT = 1e-3


def sharpness(knobs: Sequence[Knob], values: dict[str, float], term: Term) -> dict[str, float]:
    """Return the standard error of each knob, as a share of its bounds' distance.

    Of the minimum of a mean of losses it is ``H^-1 G H^-1`` (the sandwich of Huber 1967), with the
    curvature H of the mean and the scatter G of the gradients of the sectors, which count as
    independent. ``inf`` where a direction that a knob has a part in is flat: then others can make
    up for it.
    """
    count = len(knobs)
    middle = np.array([one.share(values[one.name]) for one in knobs])
    middle = np.clip(middle, _STEP, 1 - _STEP)

    def at(*moves: tuple[int, float]) -> Loss:
        shares = middle.copy()
        for knob, sign in moves:
            shares[knob] += sign * _STEP
        tried = {one.name: one.at(float(x)) for one, x in zip(knobs, shares, strict=True)}
        return term({**values, **tried})

    here = at().mean
    sides = [(at((k, 1.0)), at((k, -1.0))) for k in range(count)]
    curved = np.empty((count, count))
    for i in range(count):
        curved[i, i] = sides[i][0].mean + sides[i][1].mean - 2 * here
        for j in range(i):
            both = at((i, 1.0), (j, 1.0)).mean + at((i, -1.0), (j, -1.0)).mean
            alone = sum(one.mean for one in (*sides[i], *sides[j]))
            curved[i, j] = curved[j, i] = (both - alone + 2 * here) / 2
    curved /= _STEP**2
    weight = sides[0][0].weight
    slopes = np.array([(up.total - down.total) / (2 * _STEP) for up, down in sides])
    slopes -= slopes.sum(axis=1, keepdims=True) * weight / max(weight.sum(), 1e-12)
    there = max(int((weight > 0).sum()), 2)
    scatter = slopes @ slopes.T / max(weight.sum(), 1e-12) ** 2 * there / (there - 1)
    size, axes = np.linalg.eigh(curved)
    flat = size < _FLAT
    inverse = (axes / np.where(flat, np.inf, size)) @ axes.T
    error = np.sqrt(np.maximum(np.diag(inverse @ scatter @ inverse), 0.0))
    lost = (np.abs(axes[:, flat]) > 0.2).any(axis=1)
    error = np.where(lost, np.inf, error)
    return {one.name: float(x) for one, x in zip(knobs, error, strict=True)}
