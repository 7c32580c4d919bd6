"""Decoding of the network's maps: peaks, then non-maximum suppression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from urbantwin.geometry.box_overlap import box_footprints
from urbantwin.learn.grid import Grid
from urbantwin.learn.heads import ClassHead, decoded

__all__ = ["LEAST_SCORE", "Found", "boxes_of_maps", "kept_of_overlapping"]

#: Lowest score of a returned box by default.
LEAST_SCORE = 0.05
#: Largest number of boxes of a class in a frame.
_MOST_BOXES = 300
#: Largest overlap (IoU in plan) of two boxes.
_MOST_SHARED = 0.15
#: Smallest distance of two centres, metres.
_NEAREST_M = 0.3
#: Classes that suppress each other.
_ROAD_VEHICLES = ("car", "truck", "bus")


@dataclass(frozen=True, eq=False)
class Found:
    """Detected boxes of one frame.

    Attributes:
        box: (N, 7) boxes, z above the ground.
        number: (N,) int64 class indices.
        score: (N,) scores, 0..1, descending.
    """

    box: NDArray[np.float64]
    number: NDArray[np.int64]
    score: NDArray[np.float64]

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Found:
        """Return a selection of boxes."""
        return Found(self.box[chosen], self.number[chosen], self.score[chosen])


def boxes_of_maps(
    maps: Sequence[NDArray[np.floating]],
    grid: Grid,
    heads: Sequence[ClassHead],
    least_score: float = LEAST_SCORE,
) -> Found:
    """Return the boxes of one frame.

    Args:
        maps: outputs of the network: (`heads.OUTPUTS`, rows, columns) for each class.
        grid: grid of the pillars.
        heads: heads of the classes.
        least_score: lowest score of returned boxes.
    """
    boxes, numbers, scores = [np.zeros((0, 7))], [np.zeros(0, np.int64)], [np.zeros(0)]
    for number, (said, head) in enumerate(zip(maps, heads, strict=True)):
        cells = grid.coarser(head.stride)
        logit = np.asarray(said[0], np.float64)
        peak = logit == maximum_filter(logit, size=3, mode="nearest")
        cell = np.flatnonzero(peak & (logit > np.log(least_score / (1 - least_score))))
        cell = cell[np.argsort(-logit.ravel()[cell], kind="stable")][:_MOST_BOXES]
        told = np.asarray(said[1:], np.float64).reshape(len(said) - 1, -1)[:, cell].T
        boxes.append(decoded(told, cells.middles(cell), cells.cell_m, head))
        numbers.append(np.full(len(cell), number))
        scores.append(1 / (1 + np.exp(-logit.ravel()[cell])))
    found = Found(np.concatenate(boxes), np.concatenate(numbers), np.concatenate(scores))
    found = found.only(np.argsort(-found.score, kind="stable"))
    found = found.only(np.asarray(np.isfinite(found.box).all(axis=1)))
    return kept_of_overlapping(found, [head.name for head in heads])


def kept_of_overlapping(found: Found, names: Sequence[str]) -> Found:
    """Apply non-maximum suppression in plan.

    Cars, trucks and buses suppress each other; every other class only suppresses itself, since a
    person may stand beside a bicycle.

    Args:
        found: boxes by descending score.
        names: names of the classes.
    """
    if not len(found.box):
        return found
    vehicles = [number for number, name in enumerate(names) if name in _ROAD_VEHICLES]
    group = np.where(np.isin(found.number, vehicles), -1, found.number)
    outlines = box_footprints(found.box)
    area = shapely.area(outlines)
    tree = shapely.STRtree(outlines)
    first, second = tree.query(outlines, predicate="intersects")
    pair = (first < second) & (group[first] == group[second])
    first, second = first[pair], second[pair]
    shared = shapely.area(shapely.intersection(outlines[first], outlines[second]))
    overlap = shared / np.maximum(area[first] + area[second] - shared, 1e-9)
    apart = np.hypot(*(found.box[first, :2] - found.box[second, :2]).T)
    clash = (overlap > _MOST_SHARED) | (apart < _NEAREST_M)
    # A small box inside a large one has a low IoU: a car's box in a bus's.
    clash |= shared > 0.6 * np.minimum(area[first], area[second])
    kept = np.ones(len(found.box), bool)
    order = np.lexsort((second[clash], first[clash]))
    for one, other in zip(first[clash][order], second[clash][order], strict=True):
        if kept[one]:
            kept[other] = False
    return found.only(kept)
