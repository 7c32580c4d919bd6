"""Boxes as the annotators of a data set draw them: each of their habits, measured.

A side is drawn by a monotone map from true sides to drawn ones, which is known at some places; how
far one object is from another of its side tells its place on the map, so no two of the same size
need the same box. An object keeps its box for its whole track. ``annotators.yaml`` says of each
map what it was fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import TypedDict

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.traffic.assets.asset_name import Size

__all__ = ["drawn_side", "drawn_size"]

#: Nobody's box is farther from the usual one than this, standard deviations.
_FARTHEST = 2.3
#: A box is at least so large a part of the object: annotators miss ends, not the object.
_LEAST = 0.3
#: What annotators write down, metres.
_ROUNDED_M = 0.01
_STREAM = 7_100_000_000


class Habit(TypedDict):
    """How a side is drawn.

    Attributes:
        actual: sides as they are, ascending, metres.
        drawn: what is drawn of each, metres.
        scatter: standard deviation of what is added to a true side before it is looked up, metres.
    """

    actual: Sequence[float]
    drawn: Sequence[float]
    scatter: float


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
    length, width, height = (
        float(drawn_side(habits[side], true, at)) if side in habits else true
        for side, true, at in zip(("length", "width", "height"), size, away, strict=True)
    )
    return length, width, height


def drawn_side(
    habit: Habit, true: NDArray[np.float64] | float, away: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return sides as they are drawn, metres; beyond the ends of the map they are shifted.

    Args:
        habit: of the side.
        true: sides, metres.
        away: how far each object is from the usual one, standard deviations.
    """
    place = true + habit["scatter"] * np.clip(away, -_FARTHEST, _FARTHEST)
    known, drawn = np.asarray(habit["actual"]), np.asarray(habit["drawn"])
    inside = np.clip(place, known[0], known[-1])
    side = np.interp(inside, known, drawn) + (place - inside)
    return np.asarray(np.maximum(np.round(side / _ROUNDED_M) * _ROUNDED_M, _LEAST * true))


@cache
def _tables() -> dict[str, dict[str, dict[str, Habit]]]:
    text = files(__package__).joinpath("annotators.yaml").read_text(encoding="utf-8")
    tables: dict[str, dict[str, dict[str, Habit]]] = yaml.safe_load(text)
    return tables
