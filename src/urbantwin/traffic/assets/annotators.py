"""Boxes as the annotators of a data set draw them: each of their habits, measured.

A side is drawn as ``off + of_true * true side``, and scatters from object to object; an object
keeps its box for its whole track. ``annotators.yaml`` says of each number what it was fitted to.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np
import yaml

from urbantwin.traffic.assets.asset_name import Size

__all__ = ["drawn_size"]

#: Nobody's box is farther from the usual one than this, standard deviations.
_FARTHEST = 2.3
#: A box is at least so large a part of the object: annotators miss ends, not the object.
_LEAST = 0.5
#: What annotators write down, metres.
_ROUNDED_M = 0.01
_STREAM = 7_100_000_000


def drawn_size(annotators: str, actor_class: str, size: Size, track: int, seed: int) -> Size:
    """Return the box that annotators of a data set draw around an object of a true size.

    Args:
        annotators: ``kitti`` or ``tumtraf``.
        actor_class: one of ``taxonomy.BOX_SEMANTICS``; a class that was not measured, or a side of
            it, stays as it is.
        size: length, width and height, metres.
        track: of the object: the same for the same track and seed, whatever else there is.
        seed: of what is drawn.
    """
    habits = _tables()[annotators].get(actor_class)
    if habits is None:
        return size
    key = [seed, _STREAM + track]
    away = np.random.Generator(np.random.Philox(key=key)).standard_normal(3)
    sides = []
    for side, true, at in zip(("length", "width", "height"), size, away, strict=True):
        off, of_true, scatter = habits.get(side, (0.0, 1.0, 0.0))
        drawn = off + of_true * true + scatter * float(np.clip(at, -_FARTHEST, _FARTHEST))
        sides.append(max(round(drawn / _ROUNDED_M) * _ROUNDED_M, _LEAST * true))
    return sides[0], sides[1], sides[2]


@cache
def _tables() -> dict[str, dict[str, dict[str, tuple[float, float, float]]]]:
    text = files(__package__).joinpath("annotators.yaml").read_text()
    tables: dict[str, dict[str, dict[str, tuple[float, float, float]]]] = yaml.safe_load(text)
    return tables
