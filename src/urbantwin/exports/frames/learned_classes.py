"""Training parameters derived from a dataset's boxes: classes, range, sizes.

Anchor sizes are medians of the boxes in the frames of ``ImageSets/train.txt``; the range contains
99 % of their centres.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS

__all__ = ["PILLAR_M", "LearnedClass", "LearnedClasses", "learned_classes"]

_EXPECTED = "a dataset of urbantwin record"
#: Boxes with fewer points are no example; of a class with fewer boxes nothing is learned.
_FEWEST_POINTS, _FEWEST_BOXES = 5, 10
#: Classes to learn: not static obstacles, and not animals.
_LEARNED = tuple(name for name in BOX_SEMANTICS if name not in ("animal", "obstacle"))
#: Edge of a pillar, metres, and the divisor of the number of pillars per side (strides 2, 2, 2).
PILLAR_M, _MULTIPLE = 0.16, 16
#: Fraction of box centres within the range, and its margin on every side, metres.
_HELD, _MARGIN_M = 0.99, 2.0
#: Overlap with an anchor above which it is positive, and below which negative.
_LARGE, _SMALL = (0.6, 0.45), (0.5, 0.35)
#: Boxes narrower than this count as small, metres.
_SMALL_M = 1.2
_MOST_SAMPLED = 15
#: Largest distance of a detected centre beyond the range, metres.
_BEYOND_M = 5.0


@dataclass(frozen=True)
class LearnedClass:
    """A class with enough examples.

    Attributes:
        name: UrbanTwin's name of the class.
        count: number of examples.
        size_m: median length, width and height, metres.
        bottom_m: median height of the boxes' floors, points' frame, metres.
        matched, unmatched: overlap with an anchor above which it is positive, and below which
            negative.
        sampled: number per frame up to which `gt_sampling` adds objects; lower for frequent
            classes.
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
    """Classes and range learned from a dataset.

    Attributes:
        classes: classes with enough examples, in the order of `BOX_SEMANTICS`.
        range_m: least x, y, z and greatest x, y, z, metres: square, with a number of pillars
            divisible by the strides.
        labelled: all classes of boxes, in order of name.
        few: classes with too few examples, and their numbers of examples.
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
    def voxel_m(self) -> list[float]:
        """Edges of a pillar along x, y and z."""
        return [PILLAR_M, PILLAR_M, round(self.range_m[5] - self.range_m[2], 1)]

    @property
    def beyond_m(self) -> list[float]:
        """Bounds of detected centres, like ``range_m``."""
        low, high = self.range_m[:3], self.range_m[3:]
        low_m = (round(one - _BEYOND_M, 2) for one in low)
        return [*low_m, *(round(one + _BEYOND_M, 2) for one in high)]

    @property
    def config_values(self) -> dict[str, object]:
        """Template variables common to all configs."""
        return {
            "names": self.names,
            "classes": self.classes,
            "range": self.range_m,
            "voxel": self.voxel_m,
            "beyond": self.beyond_m,
            "fewest": _FEWEST_POINTS,
        }

    @property
    def notes(self) -> list[str]:
        """Notes for the user."""
        left = [f"not learned: {count} boxes of {name}" for name, count in self.few.items()]
        return [*left, f"the configs look {self.range_m[3]:g} m along x and y"]


def learned_classes(dataset: Path) -> LearnedClasses:
    """Return the training parameters of a dataset.

    Args:
        dataset: folder of an UrbanTwin dataset; its labels and ``ImageSets/train.txt`` are read.

    Raises:
        InputError: not an UrbanTwin dataset, or no class has enough boxes.
    """
    objects = LabelledObjects.in_folder(dataset)
    split = dataset / "ImageSets" / "train.txt"
    training = read_bytes(split, _EXPECTED).decode(errors="replace").split()
    counts = (objects.ignored == "") & np.isin(objects.frame.astype(str), training)
    learned = objects.take(counts & (objects.num_points >= _FEWEST_POINTS))
    names, found = np.unique(learned.class_name, return_counts=True)
    known = dict(zip(names.tolist(), found.tolist(), strict=True))
    chosen = [name for name in _LEARNED if known.get(name, 0) >= _FEWEST_BOXES]
    if not chosen:
        raise InputError(
            f"has no class with {_FEWEST_BOXES} boxes of {_FEWEST_POINTS} points",
            file=objects.file,
            expected="labelled road users",
        )
    most = max(known[name] for name in chosen)
    return LearnedClasses(
        classes=tuple(_of_class(name, learned, most) for name in chosen),
        range_m=_range(learned.box),
        labelled=tuple(sorted(set(objects.class_name.tolist()))),
        few={name: known[name] for name in sorted(set(known) - set(chosen))},
    )


def _of_class(name: str, objects: LabelledObjects, most: int) -> LearnedClass:
    box = objects.box[objects.class_name == name]
    count = len(box)
    length, width, height = (round(float(one), 2) for one in np.median(box[:, 3:6], axis=0))
    bottom = float(np.median(box[:, 2] - box[:, 5] / 2))
    matched, unmatched = _SMALL if width < _SMALL_M else _LARGE
    sampled = max(2, round(_MOST_SAMPLED * (1 - count / most / 2)))
    return LearnedClass(
        name, count, (length, width, height), round(bottom, 2), matched, unmatched, sampled
    )


def _range(box: NDArray[np.float64]) -> tuple[float, float, float, float, float, float]:
    far = np.quantile(np.abs(box[:, :2]).max(axis=1), _HELD) + _MARGIN_M
    step = PILLAR_M * _MULTIPLE / 2
    side = round(float(np.ceil(far / step) * step), 2)
    low = np.quantile(box[:, 2] - box[:, 5] / 2, (1 - _HELD) / 2) - _MARGIN_M / 4
    high = np.quantile(box[:, 2] + box[:, 5] / 2, (1 + _HELD) / 2) + _MARGIN_M / 4
    bottom, top = round(float(np.floor(10 * low) / 10), 1), round(float(np.ceil(10 * high) / 10), 1)
    return (-side, -side, bottom, side, side, top)
