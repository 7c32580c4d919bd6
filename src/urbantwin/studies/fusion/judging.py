"""Detections of a setting judged by the common labels: mean average precision, with intervals.

Classes, roles, matching, average precision and draws of frames are those of `evaluation`. The mean
is over the classes that the detector tells apart and of which there are objects; an object counts
from 5 points of all nodes together on, whoever looks in a setting: all are asked for the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES, Detections
from urbantwin.errors import InputError
from urbantwin.evaluation.bootstrap import block_length, drawn_frames, interval, same_objects
from urbantwin.evaluation.criterion import near, overlapping
from urbantwin.evaluation.matching import matched
from urbantwin.evaluation.pairs import pairs_of
from urbantwin.evaluation.precision import average_precision, resampled_precision
from urbantwin.evaluation.truth import FEWEST_POINTS, Truth, roles_of, why_not
from urbantwin.studies.fusion.nodes import Labelled

__all__ = ["Judge", "Verdict"]

#: Draws of frames for an interval.
_DRAWS = 300


@dataclass(frozen=True, eq=False)
class Verdict:
    """How good detections are.

    Attributes:
        mean: mean average precision by distance of centres (1 m; trucks and buses 2 m), 0..1.
        draws: (D,) of it, had other frames been drawn.
        mean_iou: mean average precision at an intersection over union in plan of one half.
        by_class: average precision by distance of each class.
        objects: how many there were to find.
    """

    mean: float
    draws: NDArray[np.float64]
    mean_iou: float
    by_class: dict[str, float]
    objects: int

    @property
    def sure(self) -> tuple[float, float] | None:
        """The middle 95 % of the draws."""
        return interval(self.draws)

    def gain(self, other: Verdict) -> tuple[float, tuple[float, float] | None]:
        """Return how much better it is than another, of the same draws, and how sure that is."""
        return self.mean - other.mean, interval(self.draws - other.draws)


class Judge:
    """The labels of some moments, and what detections are worth by them.

    Args:
        names: of the moments.
        time_s: of each.
        labelled: of each, in the site.
        places: (M, 2) the receiver's true place at each.
        within_m: objects and detections farther from it do not count.
        classes: that the detector tells apart.

    Raises:
        InputError: there is nothing to find.
    """

    def __init__(
        self,
        names: Sequence[str],
        time_s: NDArray[np.float64],
        labelled: Sequence[Labelled],
        places: NDArray[np.float64],
        within_m: float,
        classes: Sequence[str],
    ) -> None:
        self._places, self._within_m = places, within_m
        count = [len(one.track) for one in labelled]
        frame = np.repeat(np.arange(len(labelled)), count).astype(np.int64)
        box = np.concatenate([one.box for one in labelled]) if labelled else np.zeros((0, 7))
        away = np.hypot(*(box[:, :2] - places[frame]).T)
        points = np.concatenate([one.num_points for one in labelled])
        marked = [reason for one in labelled for reason in one.ignored]
        kinds = tuple(name for one in labelled for name in one.class_names)
        self.truth = Truth(
            frames=tuple(names),
            time_s=time_s,
            frame=frame,
            box=box,
            class_names=kinds,
            source_names=kinds,
            track=np.concatenate([one.track for one in labelled]),
            num_points=points,
            occlusion=np.full(len(frame), np.nan),
            ignored=why_not(marked, points, away, fewest_points=FEWEST_POINTS, most_m=within_m),
            range_m=away,
        )
        roles = {name: roles_of(self.truth, name, layout="own", vans=False) for name in classes}
        self.roles = {name: one for name, one in roles.items() if (one > 0).any()}
        if not self.roles:
            raise InputError(
                f"nobody of {', '.join(classes)} has {FEWEST_POINTS} points within {within_m:g} m "
                "of the receiver",
                place="labels",
                expected="objects to find: more frames, or a greater --within",
            )
        self.block, self.doubt = block_length(self.truth)
        self._often = drawn_frames(len(names), self.block, _DRAWS)

    @property
    def objects(self) -> dict[str, int]:
        """How many there are to find of each class."""
        return {name: int((one > 0).sum()) for name, one in self.roles.items()}

    @property
    def distinct(self) -> int:
        """How many different ones these are."""
        counted = np.any([one > 0 for one in self.roles.values()], axis=0)
        return len(np.unique(same_objects(self.truth)[counted]))

    def verdict(
        self,
        found: Sequence[tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]],
        chosen: NDArray[np.bool_] | None = None,
    ) -> Verdict:
        """Return how good detections are.

        Args:
            found: at each moment boxes (n, 7) in the site, numbers of classes and scores.
            chosen: (M,) which of the moments count; all if None.
        """
        keep = np.ones(len(self.truth.frames), bool) if chosen is None else chosen
        frame = np.repeat(np.arange(len(found)), [len(one[0]) for one in found]).astype(np.int64)
        box = np.concatenate([one[0] for one in found])
        kind = np.concatenate([one[1] for one in found])
        here = keep[frame] & (np.hypot(*(box[:, :2] - self._places[frame]).T) <= self._within_m)
        seen = Detections(
            frames=self.truth.frames,
            frame=frame[here],
            box=box[here],
            class_names=tuple(DETECTED_CLASSES[one] for one in kind[here]),
            score=np.concatenate([one[2] for one in found])[here],
            track=np.full(int(here.sum()), -1, np.int64),
        )
        pairs = pairs_of(seen, self.truth)
        counts = np.ones(len(seen), bool)
        means: dict[str, float] = {}
        draws, overlaps, objects = [], [], 0
        for name, every in self.roles.items():
            roles = np.where(keep[self.truth.frame], every, 0)
            wanted = roles > 0
            if not wanted.any():
                continue
            mine = np.flatnonzero([one == name for one in seen.class_names])
            order = mine[np.argsort(-seen.score[mine], kind="stable")]
            found_near = matched(pairs, order, roles, counts, near(name))
            shared = matched(pairs, order, roles, counts, overlapping())
            means[name] = average_precision(found_near) or 0.0
            overlaps.append(average_precision(shared) or 0.0)
            of_frame = np.bincount(self.truth.frame[wanted], minlength=len(keep))
            draws.append(resampled_precision(found_near, seen.frame, of_frame, self._often))
            objects += int(wanted.sum())
        if not means:
            nothing = np.full(len(self._often), np.nan)
            return Verdict(float("nan"), nothing, float("nan"), {}, 0)
        with np.errstate(invalid="ignore"):
            known = ~np.isnan(np.array(draws))
            total = np.where(known, np.array(draws), 0.0).sum(axis=0)
            mean = np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), np.nan)
        return Verdict(
            float(np.mean(list(means.values()))), mean, float(np.mean(overlaps)), means, objects
        )
