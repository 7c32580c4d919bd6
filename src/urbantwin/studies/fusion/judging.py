"""Evaluation of a setting's detections against the common labels, and the rows of the table.

Classes, roles, matching, average precision and bootstrap draws of frames are those of `evaluation`.
The mean is over the detector's classes with objects. An object counts from 5 points of all nodes
together, regardless of the setting's nodes, so all settings have the same objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

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
from urbantwin.studies.fusion.setting import Setting
from urbantwin.studies.fusion.trial import Outcome

__all__ = ["Judge", "Verdict", "rows_of", "rows_of_failure"]

#: Draws of frames for an interval.
_DRAWS = 300
#: Parts of the time in which a node that falls silent is shown.
_WINDOWS = 8


@dataclass(frozen=True, eq=False)
class Verdict:
    """Quality of detections.

    Attributes:
        mean: mean average precision by distance of centres (1 m; trucks and buses 2 m), 0..1.
        draws: (D,) bootstrap draws of the mean, over frames.
        mean_iou: mean average precision at a BEV intersection over union of 0.5.
        by_class: average precision by distance of each class.
        objects: number of objects.
    """

    mean: float
    draws: NDArray[np.float64]
    mean_iou: float
    by_class: dict[str, float]
    objects: int

    def row(self) -> dict[str, Any]:
        """Return the columns of a table: average precisions in per cent."""
        return {
            "map": _percent(self.mean),
            **_ends("map", self.draws),
            "map_bev_iou_0.5": _percent(self.mean_iou),
            **{f"ap_{name}": _percent(one) for name, one in self.by_class.items()},
            "objects": self.objects,
        }


class Judge:
    """Labels of some moments, for the evaluation of detections.

    Args:
        names: names of the moments.
        time_s: times of the moments, seconds.
        labelled: labels of each moment, in the site frame.
        places: (M, 2) the receiver's true position at each moment, metres.
        within_m: largest distance from it of objects and detections that count, metres.
        classes: classes of the detector.

    Raises:
        InputError: no object counts.
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
                f"no {' or '.join(classes)} has {FEWEST_POINTS} points within {within_m:g} m "
                "of the receiver",
                place="labels",
                expected="objects to find: more frames, or a greater --within",
            )
        self.block, self.doubt = block_length(self.truth)
        self._often = drawn_frames(len(names), self.block, _DRAWS)

    @property
    def objects(self) -> dict[str, int]:
        """Number of objects of each class."""
        return {name: int((one > 0).sum()) for name, one in self.roles.items()}

    @property
    def distinct(self) -> int:
        """Number of distinct objects."""
        counted = np.any([one > 0 for one in self.roles.values()], axis=0)
        return len(np.unique(same_objects(self.truth)[counted]))

    def verdict(
        self,
        found: Sequence[Outcome],
        chosen: NDArray[np.bool_] | None = None,
    ) -> Verdict:
        """Return the quality of detections.

        Args:
            found: results at each moment.
            chosen: (M,) moments that count; all if None.
        """
        keep = np.ones(len(self.truth.frames), bool) if chosen is None else chosen
        frame = np.repeat(np.arange(len(found)), [len(one.box) for one in found]).astype(np.int64)
        box = np.concatenate([one.box for one in found])
        kind = np.concatenate([one.kind for one in found])
        here = keep[frame] & (np.hypot(*(box[:, :2] - self._places[frame]).T) <= self._within_m)
        seen = Detections(
            frames=self.truth.frames,
            frame=frame[here],
            box=box[here],
            class_names=tuple(DETECTED_CLASSES[one] for one in kind[here]),
            score=np.concatenate([one.score for one in found])[here],
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


def rows_of(
    settings: Sequence[Setting], outcomes: Sequence[Sequence[Outcome]], judge: Judge
) -> list[dict[str, Any]]:
    """Return a row per setting: parameters, cost, and quality of its detections.

    Args:
        settings: the settings, including the receiver alone.
        outcomes: results of each setting at each moment.
        judge: labels of these moments.
    """
    known: dict[tuple[object, ...], Verdict] = {}
    for setting, found in zip(settings, outcomes, strict=True):
        if setting.work not in known:
            known[setting.work] = judge.verdict(found)
    alone = next(known[one.work] for one in settings if one.how.name == "alone")
    rows = []
    for setting, found in zip(settings, outcomes, strict=True):
        verdict, channel = known[setting.work], asdict(setting.channel)
        silent, from_s = channel.pop("silent"), channel.pop("silent_from_s")
        ages = [one.age_s for one in found if not np.isnan(one.age_s)]
        rows.append(
            {
                "study": setting.study,
                "way": setting.how.name,
                "told": setting.how.told,
                "value": setting.value,
                "unit": setting.unit or None,
                "aligned": setting.aligned,
                "nodes": setting.nodes,
                **channel,
                "silent_from_s": from_s if silent >= 0 else None,
                "kbit_s": float(np.mean([one.bits_s for one in found])) / 1e3,
                "kbit_frame": float(np.mean([one.bits for one in found])) / 1e3,
                "packets_frame": float(np.mean([one.packets for one in found])),
                "age_s": float(np.mean(ages)) if ages else None,
                **verdict.row(),
                "gain": 100 * (verdict.mean - alone.mean),
                **_ends("gain", verdict.draws - alone.draws),
            }
        )
    return rows


def rows_of_failure(
    settings: Sequence[Setting],
    outcomes: Sequence[Sequence[Outcome]],
    judge: Judge,
    time_s: NDArray[np.float64],
) -> list[dict[str, Any]]:
    """Return average precision in intervals of time, for the study of node failure.

    Args:
        settings: all settings of the study.
        outcomes: results of each setting at each moment.
        judge: labels of these moments.
        time_s: (M,) times of the moments, seconds.
    """
    windows = min(_WINDOWS, len(time_s))
    part = np.arange(len(time_s)) * windows // max(len(time_s), 1)
    return [
        {
            "way": setting.how.name,
            "silent_from_s": setting.channel.silent_from_s if setting.channel.silent >= 0 else None,
            "from_s": float(time_s[part == number].min()),
            "to_s": float(time_s[part == number].max()),
            "frames": int((part == number).sum()),
            **judge.verdict(found, part == number).row(),
        }
        for setting, found in zip(settings, outcomes, strict=True)
        if setting.study == "failure"
        for number in range(windows)
    ]


def _percent(share: float) -> float | None:
    return None if np.isnan(share) else 100 * share


def _ends(name: str, draws: NDArray[np.float64]) -> dict[str, float | None]:
    """Return the middle 95 % of draws, percent."""
    low, high = interval(draws) or (np.nan, np.nan)
    return {f"{name}_low": _percent(low), f"{name}_high": _percent(high)}
