"""What a dataset's boxes say of the config that learns from it: classes, range, sizes.

Sizes of anchors are medians of the boxes in the frames of ``ImageSets/train.txt``; the range holds
99 % of their middles.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS

__all__ = ["FEWEST_POINTS", "PILLAR_M", "LearnedClass", "LearnedClasses", "learned_classes"]

_EXPECTED = "a dataset of urbantwin record"
_COLUMNS = {
    "frame": "text",
    "class": "text", **dict.fromkeys(("x", "y", "z", "length", "width", "height"), "number"),
    "num_points": "whole",
}  # fmt: skip
#: Boxes with fewer points are no example; of a class with fewer boxes nothing is learned.
FEWEST_POINTS, _FEWEST_BOXES = 5, 10
#: What stands still and belongs to nobody, and animals, is not learned.
_LEARNED = tuple(name for name in BOX_SEMANTICS if name not in ("animal", "obstacle"))
#: Edge of a pillar, metres; so many of them along an edge are a multiple of this (strides 2, 2, 2).
PILLAR_M, _MULTIPLE = 0.16, 16
#: The range holds this share of the middles of boxes, and so much more on every side, metres.
_HELD, _MARGIN_M = 0.99, 2.0
#: Overlap with an anchor from which on, and up to which, it is of the class or not.
_LARGE, _SMALL = (0.6, 0.45), (0.5, 0.35)
#: What is narrower is small, metres.
_SMALL_M = 1.2
_MOST_SAMPLED = 15


@dataclass(frozen=True)
class LearnedClass:
    """A class that there are enough examples of.

    Attributes:
        name: ours.
        count: its examples.
        size_m: median length, width and height.
        bottom_m: median height of the boxes' floors, frame of the points.
        matched, unmatched: overlap with an anchor from which on, and up to which, the anchor is of
            the class or of none.
        sampled: how many a frame is filled up to by `gt_sampling`: whoever is frequent need not be
            pasted in as often.
    """

    name: str
    count: int
    size_m: tuple[float, float, float]
    bottom_m: float
    matched: float
    unmatched: float
    sampled: int


@dataclass(frozen=True)
class LearnedClasses:
    """What is learned in a dataset.

    Attributes:
        classes: with enough examples, in the order of `BOX_SEMANTICS`.
        range_m: least x, y, z and greatest x, y, z: square, so many pillars as strides divide.
        labelled: every class that a box has, with its name's order.
        few: classes with too few examples, and how many they have.
    """

    classes: tuple[LearnedClass, ...]
    range_m: tuple[float, float, float, float, float, float]
    labelled: tuple[str, ...]
    few: dict[str, int]

    @property
    def names(self) -> list[str]:
        """The classes' names."""
        return [one.name for one in self.classes]

    @property
    def notes(self) -> list[str]:
        """What a person should be told."""
        left = [f"not learned: {count} boxes of {name}" for name, count in self.few.items()]
        return [*left, f"the configs look {self.range_m[3]:g} m along x and y"]


def learned_classes(dataset: Path) -> LearnedClasses:
    """Return what is to be learned of a dataset.

    Args:
        dataset: one of ours; its ``boxes.parquet`` and ``ImageSets/train.txt`` are read.

    Raises:
        InputError: it is no dataset of ours, or no class has enough boxes.
    """
    file = dataset / "boxes.parquet"
    table = read_parquet(file, _EXPECTED)
    boxes = columns_of(table, _COLUMNS, file, _EXPECTED)
    counts = np.ones(table.num_rows, bool)
    if "ignored" in table.column_names:
        counts = ~np.array([bool(one) for one in table["ignored"].to_pylist()], bool)
    labelled = sorted(set(boxes["class"].astype(str).tolist()))
    split = dataset / "ImageSets" / "train.txt"
    training = read_bytes(split, _EXPECTED).decode(errors="replace").split()
    seen = (boxes["num_points"] >= FEWEST_POINTS) & np.isin(boxes["frame"].astype(str), training)
    boxes = {name: column[seen & counts] for name, column in boxes.items()}
    names, found = np.unique(boxes["class"].astype(str), return_counts=True)
    known = dict(zip(names.tolist(), found.tolist(), strict=True))
    chosen = [name for name in _LEARNED if known.get(name, 0) >= _FEWEST_BOXES]
    if not chosen:
        raise InputError(
            f"has no class with {_FEWEST_BOXES} boxes of {FEWEST_POINTS} points",
            file=file,
            expected="labelled road users",
        )
    most = max(known[name] for name in chosen)
    return LearnedClasses(
        classes=tuple(_of_class(name, boxes, most) for name in chosen),
        range_m=_range(boxes),
        labelled=tuple(labelled),
        few={name: known[name] for name in sorted(set(known) - set(chosen))},
    )


def _of_class(name: str, boxes: dict[str, NDArray[Any]], most: int) -> LearnedClass:
    mine = boxes["class"] == name
    count = int(mine.sum())
    length, width, height = (
        round(float(np.median(boxes[one][mine])), 2) for one in ("length", "width", "height")
    )
    bottom = float(np.median((boxes["z"] - boxes["height"] / 2)[mine]))
    matched, unmatched = _SMALL if width < _SMALL_M else _LARGE
    sampled = max(2, round(_MOST_SAMPLED * (1 - count / most / 2)))
    return LearnedClass(
        name, count, (length, width, height), round(bottom, 2), matched, unmatched, sampled
    )


def _range(boxes: dict[str, NDArray[Any]]) -> tuple[float, float, float, float, float, float]:
    far = np.quantile(np.maximum(np.abs(boxes["x"]), np.abs(boxes["y"])), _HELD) + _MARGIN_M
    step = PILLAR_M * _MULTIPLE / 2
    side = round(float(np.ceil(far / step) * step), 2)
    low = np.quantile(boxes["z"] - boxes["height"] / 2, (1 - _HELD) / 2) - _MARGIN_M / 4
    high = np.quantile(boxes["z"] + boxes["height"] / 2, (1 + _HELD) / 2) + _MARGIN_M / 4
    bottom, top = round(float(np.floor(10 * low) / 10), 1), round(float(np.ceil(10 * high) / 10), 1)
    return (-side, -side, bottom, side, side, top)
