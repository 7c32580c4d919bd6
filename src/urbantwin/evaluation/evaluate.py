"""Evaluation of a detector's boxes against labels: all values of a report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.evaluation.bootstrap import block_length, drawn_frames, interval, same_objects
from urbantwin.evaluation.criterion import (
    CRITERIA,
    ERRORS_WITHIN_M,
    JUDGED,
    Criterion,
    near,
    overlapping,
)
from urbantwin.evaluation.false_alarms import (
    REASONS,
    false_alarm_reasons,
    standing_false_alarms,
)
from urbantwin.evaluation.matching import Matched, matched
from urbantwin.evaluation.pairs import Pairs, pairs_of
from urbantwin.evaluation.precision import (
    average_precision,
    best_operation,
    nuscenes_precision,
    recall_at_false_alarms,
    resampled_precision,
)
from urbantwin.evaluation.reading import Seen
from urbantwin.evaluation.truth import roles_of
from urbantwin.progress import Progress, untold

__all__ = ["DRAWS", "Figures", "Judged", "evaluate"]


_RANGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 60.0, np.inf)
_POINTS = (0, 10, 30, 100, 300, np.inf)
#: Levels of occlusion of docs/reference/labels.md.
_HIDDEN = (0.0, 0.2, 0.6, 1.01)
#: Properties by which results are broken down, and the units of their bins.
KINDS = {"range": "m", "points": "points", "occlusion": "% hidden"}


@dataclass(frozen=True, eq=False)
class Bin:
    """A subset of the objects, and the detections that count as false alarms for it.

    Attributes:
        kind: one of ``KINDS``.
        title: "10 to 20 m".
        labels: (L,) bool, objects of the bin.
        detections: (N,) bool, detections of the bin; all for occlusion, which detections do not
            have.
    """

    kind: str
    title: str
    labels: NDArray[np.bool_]
    detections: NDArray[np.bool_]


def bins_of(seen: Seen) -> Iterator[Bin]:
    """Yield all bins, including empty ones."""
    truth = seen.truth
    for low, high in pairwise(_RANGES_M):
        yield Bin(
            "range",
            f"{low:g} to {high:g} m" if np.isfinite(high) else f"{low:g} m and more",
            (truth.range_m >= low) & (truth.range_m < high),
            (seen.range_m >= low) & (seen.range_m < high),
        )
    for low, high in pairwise(_POINTS):
        yield Bin(
            "points",
            f"{low:g} to {high - 1:g} points" if np.isfinite(high) else f"{low:g} points and more",
            (truth.num_points >= low) & (truth.num_points < high),
            (seen.num_points >= low) & (seen.num_points < high),
        )
    for low, high in pairwise(_HIDDEN):
        yield Bin(
            "occlusion",
            f"{100 * low:g} to {100 * min(high, 1.0):g} % hidden",
            (truth.occlusion >= low) & (truth.occlusion < high),
            np.ones(len(seen.detections), bool),
        )


def box_errors(found: NDArray[np.float64], true: NDArray[np.float64]) -> dict[str, Any]:
    """Return mean errors over pairs of a detected and a labelled box (P, 7), P >= 1.

    ``ate_m``, ``ase`` and ``aoe_rad`` are nuScenes' (Caesar et al. 2020): distance of centres in
    plan; 1 - IoU after aligning centres and headings; smallest difference of yaw. Signed errors are
    detected minus labelled.
    """
    away = found[:, :2] - true[:, :2]
    place = np.hypot(*away.T)
    c, s = np.cos(true[:, 6]), np.sin(true[:, 6])
    size, true_size = found[:, 3:6], true[:, 3:6]
    common = np.minimum(size, true_size).prod(axis=1)
    either = size.prod(axis=1) + true_size.prod(axis=1) - common
    turn = found[:, 6] - true[:, 6]
    turn = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
    axis = np.minimum(turn, np.pi - turn)
    longer = size - true_size
    return {
        "boxes": len(found),
        "ate_m": float(place.mean()),
        "ase": float((1 - common / either).mean()),
        "aoe_rad": float(turn.mean()),
        "place_median_m": float(np.median(place)),
        "ahead_m": float((away[:, 0] * c + away[:, 1] * s).mean()),
        "left_m": float((away[:, 1] * c - away[:, 0] * s).mean()),
        "up_m": float((found[:, 2] - true[:, 2]).mean()),
        "longer_m": float(longer[:, 0].mean()),
        "wider_m": float(longer[:, 1].mean()),
        "higher_m": float(longer[:, 2].mean()),
        "axis_median_deg": float(np.degrees(np.median(axis))),
        "turned_round": float((turn > np.pi / 2).mean()),
    }


#: Draws of frames for an interval; fewer if there are many detections.
DRAWS = 500
_MOST_DRAWN = 10_000_000
#: False alarms per frame at which the recall is reported.
_FALSE_ALARMS = (0.1, 1.0)


@dataclass(frozen=True, eq=False)
class Judged:
    """The results of one class.

    Attributes:
        name: one of ``criterion.JUDGED``.
        roles: (L,) role of every labelled object (`truth.roles_of`).
        order: (M,) detections of the class by falling score.
        found: matches by the distance criterion of breakdowns.
        reasons: why each of ``found`` is wrong; empty if it is right.
        threshold: the score with the best F1, 0 without matches.
        figures: values for the report.
    """

    name: str
    roles: NDArray[np.int64]
    order: NDArray[np.int64]
    found: Matched
    reasons: list[str]
    threshold: float
    figures: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Figures:
    """The results of all classes.

    Attributes:
        seen: detections and labels.
        pairs: pairs of nearby detections and labels.
        classes: results by name; classes with neither objects nor detections are left out.
        block: number of consecutive frames drawn together for intervals.
        doubts: reasons to doubt the results.
    """

    seen: Seen
    pairs: Pairs
    classes: dict[str, Judged]
    block: int
    doubts: tuple[str, ...]


def evaluate(
    seen: Seen,
    *,
    layout: str,
    classes: Sequence[str] | None = None,
    vans: bool = False,
    draws: int = DRAWS,
    tell: Progress = untold,
) -> Figures:
    """Evaluate detections.

    Args:
        seen: detections and labels.
        layout: layout of the recording.
        classes: classes of ``criterion.JUDGED`` to evaluate; all present ones if None.
        vans: count KITTI's vans as cars.
        draws: number of draws of frames for intervals.
        tell: called with the progress.

    Raises:
        InputError: a class is unknown, or no class has objects.
    """
    names = list(JUDGED) if classes is None else list(dict.fromkeys(classes))
    unknown = next((name for name in names if name not in JUDGED), None)
    if unknown is not None:
        raise InputError(
            f"{unknown!r:.60} is no class", place="classes", expected=", ".join(JUDGED)
        )
    pairs = pairs_of(seen.detections, seen.truth)
    length, doubt = block_length(seen.truth)
    often = drawn_frames(len(seen.truth.frames), length, draws)
    bins = list(bins_of(seen))
    found: dict[str, Judged] = {}
    for number, name in enumerate(names):
        tell(number / len(names), name)
        roles = roles_of(seen.truth, name, layout=layout, vans=vans)
        order = _order(seen, name)
        if (roles > 0).any() or (len(order) and classes is not None):
            found[name] = _judged(seen, pairs, name, roles, order, often, bins)
    if not found:
        kinds = ", ".join(sorted(set(seen.truth.class_names))) or "none"
        raise InputError(
            "there is no object to be found",
            place="labels",
            expected=f"objects with enough points of {', '.join(names)}; there are {kinds}",
        )
    doubts = [doubt] if doubt else []
    for one in found.values():
        doubts += _doubts(one)
    return Figures(seen, pairs, found, length, tuple(doubts))


def _order(seen: Seen, name: str) -> NDArray[np.int64]:
    members = JUDGED[name]
    mine = np.flatnonzero([one in members for one in seen.detections.class_names])
    return mine[np.argsort(-seen.detections.score[mine], kind="stable")]


def _judged(
    seen: Seen,
    pairs: Pairs,
    name: str,
    roles: NDArray[np.int64],
    order: NDArray[np.int64],
    often: NDArray[np.int64],
    bins: Sequence[Bin],
) -> Judged:
    truth, frames = seen.truth, len(seen.truth.frames)
    score = seen.detections.score
    wanted = roles > 0
    of_frame = np.bincount(truth.frame[wanted], minlength=frames)
    fewer = often[: max(50, _MOST_DRAWN // max(len(order), 1))]
    precision: dict[str, Any] = {}
    by_criterion: dict[Criterion, Matched] = {}
    for criterion in CRITERIA:
        found = by_criterion[criterion] = matched(pairs, order, roles, seen.in_view, criterion)
        sure = None
        if found.total and frames > 1:
            sure = interval(resampled_precision(found, seen.detections.frame, of_frame, fewer))
        row = {"ap": average_precision(found), "ap_ci95": sure}
        if criterion.measure == "distance_m":
            row["ap_nuscenes"] = nuscenes_precision(found)
        precision[criterion.name] = row
    found = by_criterion[near(name)]
    best = best_operation(found, score, frames)
    reasons = false_alarm_reasons(found, pairs, roles, near(name))
    right = by_criterion[Criterion("distance_m", ERRORS_WITHIN_M)]
    hits = right.detection[right.right], right.label[right.right]
    followed = np.unique(truth.track[wanted & (truth.track >= 0)])
    threshold = best.score if best else 0.0
    figures = {
        "objects": int(wanted.sum()),
        "tracks": len(followed) if len(followed) else None,
        "distinct": len(np.unique(same_objects(truth)[wanted])),
        "not_counted": int((roles < 0).sum()),
        "detections": len(order),
        "detections_judged": len(found.detection),
        "ap": precision,
        "best_f1": None if best is None else {**asdict(best), "f1": best.f1},
        "recall_at_false_alarms_per_frame": {
            f"{per_frame:g}": recall_at_false_alarms(found, score, frames, per_frame)
            for per_frame in _FALSE_ALARMS
        },
        "false_alarms": _false_alarms(seen, found, reasons, threshold, frames),
        "errors": box_errors(seen.detections.box[hits[0]], truth.box[hits[1]])
        if len(hits[0])
        else None,
        "by": [
            _of_bin(seen, pairs, name, roles, order, one, found, threshold)
            for one in bins
            if (wanted & one.labels).any()
        ],
    }
    return Judged(name, roles, order, found, reasons, threshold, figures)


def _false_alarms(
    seen: Seen, found: Matched, reasons: Sequence[str], threshold: float, frames: int
) -> dict[str, Any]:
    """Return the false alarms at or above the score with the best F1."""
    above = ~found.right & (seen.detections.score[found.detection] >= threshold)
    counts = {
        reason: sum(bool(yes) and one == reason for yes, one in zip(above, reasons, strict=True))
        for reason in REASONS
    }
    return {
        "score": threshold,
        "per_frame": int(above.sum()) / frames,
        "reasons": counts,
        "standing": standing_false_alarms(seen, found.detection[above]),
    }


def _of_bin(
    seen: Seen,
    pairs: Pairs,
    name: str,
    roles: NDArray[np.int64],
    order: NDArray[np.int64],
    one: Bin,
    found: Matched,
    threshold: float,
) -> dict[str, Any]:
    """Return the values of a bin, in which objects of other bins are neutral."""
    inside = np.where((roles > 0) & ~one.labels, -1, roles)
    counts = seen.in_view & one.detections
    row: dict[str, Any] = {"by": one.kind, "bin": one.title, "objects": int((inside > 0).sum())}
    for criterion in (overlapping(), near(name)):
        row[criterion.name] = average_precision(matched(pairs, order, inside, counts, criterion))
    above = found.right & (seen.detections.score[found.detection] >= threshold)
    row["found"] = int(one.labels[found.label[above]].sum()) / row["objects"]
    return row


#: Minimum number of boxes, and median error of the axis, for a doubt about the box convention.
_FEWEST_DOUBTED, _QUARTER_DEG = 10, 60.0


def _doubts(one: Judged) -> list[str]:
    """Return signs in the errors of another box convention."""
    errors = one.figures["errors"]
    if errors is None or errors["boxes"] < _FEWEST_DOUBTED:
        return []
    said = []
    if one.name != "pedestrian" and errors["axis_median_deg"] > _QUARTER_DEG:
        said.append(
            f"Headings of {one.name} boxes lie across: are length and width exchanged, or does yaw "
            "not count from +x?"
        )
    if one.name not in ("pedestrian", "bicycle") and errors["turned_round"] > 0.8:
        said.append(f"Nearly all {one.name} boxes look backwards: another convention of yaw?")
    low = -errors["up_m"]
    if 0.5 < low < 1.2:
        said.append(
            f"Boxes of {one.name} stand {low:.1f} m too low: is z that of their floor, and not of "
            "their centre?"
        )
    return said
