"""Boxes out of the network's maps: peaks, and of boxes that overlap the likeliest."""

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

#: Boxes that are less likely are not told of.
LEAST_SCORE = 0.05
#: Of each class in a frame.
_MOST_BOXES = 300
#: Two boxes share more of their area in plan than this: one of them is wrong.
_MOST_SHARED = 0.15
#: Nobody stands nearer to another's middle, metres.
_NEAREST_M = 0.3
#: Of these one place holds one.
_ROAD_VEHICLES = ("car", "truck", "bus")


@dataclass(frozen=True, eq=False)
class Found:
    """What is found in one frame.

    Attributes:
        box: (N, 7), z above the ground.
        number: (N,) int64, which class.
        score: (N,) 0..1, falling.
    """

    box: NDArray[np.float64]
    number: NDArray[np.int64]
    score: NDArray[np.float64]

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Found:
        """Return some of it."""
        return Found(self.box[chosen], self.number[chosen], self.score[chosen])


def boxes_of_maps(
    maps: Sequence[NDArray[np.floating]],
    grid: Grid,
    heads: Sequence[ClassHead],
    least_score: float = LEAST_SCORE,
) -> Found:
    """Return the boxes of one frame.

    Args:
        maps: of each class (`heads.OUTPUTS`, rows, columns) as the network says it.
        grid: of the pillars.
        heads: the classes.
        least_score: what is less likely is left out.
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
    """Return what non-maximum suppression leaves: of boxes that overlap the one of highest score.

    Cars, trucks and buses suppress each other; a person may stand by a bicycle, so every other
    class suppresses itself alone.

    Args:
        found: the likeliest first.
        names: of the classes.
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
    # What lies wholly in another is small beside it: a car's box in a bus's.
    clash |= shared > 0.6 * np.minimum(area[first], area[second])
    kept = np.ones(len(found.box), bool)
    order = np.lexsort((second[clash], first[clash]))
    for one, other in zip(first[clash][order], second[clash][order], strict=True):
        if kept[one]:
            kept[other] = False
    return found.only(kept)
