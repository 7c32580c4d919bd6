"""Boxes as the annotators of a data set draw them, by measured habits.

A side is mapped by a monotone function from true to drawn sides, known at some points. A random
offset per object shifts its position on the function, so that objects of the same size have
different boxes. An object keeps its box for its whole track. ``annotators.yaml`` documents the data
that each function was fitted to.
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

#: Maximum offset of an object, standard deviations.
_MAX_OFFSET_SIGMAS = 2.3
#: Least size of a box as a share of the object: annotators miss ends, not the object.
_MIN_SIZE_SHARE = 0.3
#: Rounding of annotated sides, metres.
_ROUNDING_M = 0.01
_STREAM = 7_100_000_000


class Habit(TypedDict):
    """The mapping of a side from true to drawn.

    Attributes:
        actual: true sides, ascending, metres.
        drawn: drawn side of each, metres.
        scatter: standard deviation of the offset that is added to a true side, metres.
    """

    actual: Sequence[float]
    drawn: Sequence[float]
    scatter: float


def drawn_size(annotators: str, actor_class: str, size: Size, track: int, seed: int) -> Size:
    """Return the box that annotators of a data set draw around an object of a true size.

    Args:
        annotators: ``kitti`` or ``tumtraf``.
        actor_class: one of ``taxonomy.BOX_SEMANTICS``; classes and sides that were not measured
            stay unchanged.
        size: length, width and height, metres.
        track: track id; the same track and seed give the same box.
        seed: random seed.
    """
    habits = _tables()[annotators].get(actor_class)
    if habits is None:
        return size
    key = [seed, _STREAM + track]
    away = np.random.Generator(np.random.Philox(key=key)).standard_normal(3)
    length, width, height = (
        float(drawn_side(habits[side], true, draw)) if side in habits else true
        for side, true, draw in zip(("length", "width", "height"), size, away, strict=True)
    )
    return length, width, height


def drawn_side(
    habit: Habit, true: NDArray[np.float64] | float, away: NDArray[np.float64] | float
) -> NDArray[np.float64]:
    """Return drawn sides, metres; beyond the ends of the mapping they are shifted.

    Args:
        habit: mapping of the side.
        true: true sides, metres.
        away: offset of each object, standard deviations.
    """
    place = true + habit["scatter"] * np.clip(away, -_MAX_OFFSET_SIGMAS, _MAX_OFFSET_SIGMAS)
    actual, drawn = np.asarray(habit["actual"]), np.asarray(habit["drawn"])
    inside = np.clip(place, actual[0], actual[-1])
    side = np.interp(inside, actual, drawn) + (place - inside)
    return np.asarray(
        np.maximum(np.round(side / _ROUNDING_M) * _ROUNDING_M, _MIN_SIZE_SHARE * true)
    )


@cache
def _tables() -> dict[str, dict[str, dict[str, Habit]]]:
    text = files(__package__).joinpath("annotators.yaml").read_text(encoding="utf-8")
    tables: dict[str, dict[str, dict[str, Habit]]] = yaml.safe_load(text)
    return tables
