"""Reasons why an object detected in one recording was missed in another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation import Criterion
from urbantwin.evaluation.criterion import near
from urbantwin.geometry import plan_overlaps
from urbantwin.studies.causes.side import Side, class_of

__all__ = ["FEWER", "REASONS", "Reason", "Said", "reason_of", "said_of"]

#: Reasons with their meaning; the first that applies is reported.
REASONS: Mapping[str, str] = {
    "turn lost": "no turn of any sensor arrived, or that of one which saw it",
    "out of view": "outside of the region, the range or the field of view",
    "hidden": "something stands before it that did not, or that hides more of it",
    "weather": "rain, fog or snow take returns that it would give even alone",
    "fewer points": "fewer beams come back from it even alone: another distance, beams, an outage",
    "merged": "the detection near it belongs to a neighbour",
    "displaced": "it was detected too far from where it is",
    "heading": "its box is turned too far",
    "size": "its box has the wrong size",
    "another class": "it was taken for another class",
    "score": "it was detected with too low a score",
    "not detected": "nothing was detected, though it has points as before",
}
#: Fraction of the other recording's points below which points count as fewer.
FEWER = 0.7


@dataclass(frozen=True)
class Said:
    """The detector's output around a missed object.

    Attributes:
        reason: one of the later `REASONS`.
        told: description.
        detection: number of the related detection, or -1.
        score: its score; ``None`` without one.
        off_m: distance of its centre in plan, metres; ``None`` without one.
        other: row of the neighbour that it matches, or -1.
    """

    reason: str
    told: str
    detection: int = -1
    score: float | None = None
    off_m: float | None = None
    other: int = -1


@dataclass(frozen=True)
class Reason:
    """Reason why an object was missed.

    Attributes:
        reason: one of `REASONS`.
        told: description.
        by: class of the occluder; or the weather, sensors or neighbour.
        by_track: track of the occluding actor or neighbour.
    """

    reason: str
    told: str
    by: str | None = None
    by_track: int | None = None


def said_of(
    side: Side,
    row: int,
    name: str,
    found: NDArray[np.int64],
    criterion: Criterion,
    least: Mapping[str, float],
) -> Said:
    """Return the detector's output around a missed object.

    Args:
        side: recording in which it was missed.
        row: row of the object in ``side.seen.truth``.
        name: class as which it is evaluated.
        found: (L,) matching detection of each object.
        criterion: matching criterion.
        least: lowest score of a detection that counts, by class.
    """
    truth = side.seen.truth
    near_it = _near(side, row, name, found, criterion, least)
    if near_it.taken:
        number, score, off = near_it.taken[0]
        other = int(np.flatnonzero(found == number)[0])
        words = f"its detection belongs to {truth.class_names[other]} {truth.track[other]}"
        return Said("merged", words, number, score, off, other)
    if near_it.own:
        number, score, off = near_it.own[0]
        box = side.seen.detections.box[number]
        why = "displaced"
        if criterion.measure != "distance_m":
            why = _what_is_off(box, truth.box[row])
        return Said(why, _how_far_off(why, box, truth.box[row]), number, score, off)
    faint = max((score for _, score, _ in near_it.faint), default=0.0)
    if near_it.other_class and near_it.other_class[0][1] > faint:
        number, score, off = near_it.other_class[0]
        kind = side.seen.detections.class_names[number]
        return Said("another class", f"taken for a {kind}, score {score:.2f}", number, score, off)
    if near_it.faint:
        number, score, off = max(near_it.faint, key=lambda one: one[1])
        words = f"score {score:.2f} below {least.get(name, 0.0):.2f}"
        return Said("score", words, number, score, off)
    return Said("not detected", "nothing is detected near it")


@dataclass(frozen=True)
class _Near:
    """Detections near a missed object: number, score and distance of each, the nearest first.

    Attributes:
        own: unmatched ones of its class.
        taken: ones of its class that match another object.
        other_class: unmatched ones of another class.
        faint: ones that would match with a higher score.
    """

    own: list[tuple[int, float, float]]
    taken: list[tuple[int, float, float]]
    other_class: list[tuple[int, float, float]]
    faint: list[tuple[int, float, float]]


def _near(
    side: Side,
    row: int,
    name: str,
    found: NDArray[np.int64],
    criterion: Criterion,
    least: Mapping[str, float],
) -> _Near:
    """Return the detections near an object; see `said_of` for the arguments."""
    detections, pairs = side.seen.detections, side.pairs
    mine = np.flatnonzero(pairs.label == row)
    mine = mine[np.argsort(pairs.distance_m[mine], kind="stable")]
    meets = pairs.meet(criterion)
    close = pairs.meet(near(name)) | (pairs.bev_iou > 0)
    owned = set(found[found >= 0].tolist())
    result = _Near([], [], [], [])
    for pair in mine.tolist():
        number = int(pairs.detection[pair])
        score, kind = float(detections.score[number]), detections.class_names[number]
        told = (number, score, float(pairs.distance_m[pair]))
        judged = class_of(kind)
        if score < (least.get(judged, 0.0) if judged else 0.0):
            result.faint.extend([told] * (judged == name and bool(meets[pair])))
        elif judged != name:
            result.other_class.extend([told] * (bool(close[pair]) and number not in owned))
        elif number in owned:
            result.taken.extend([told] * bool(close[pair]))
        else:
            result.own.append(told)
    return result


def _how_far_off(why: str, box: NDArray[np.float64], true: NDArray[np.float64]) -> str:
    """Return a description of a box's error."""
    if why == "heading":
        turned = np.degrees(abs((box[6] - true[6] + np.pi / 2) % np.pi - np.pi / 2))
        return f"its box is turned by {turned:.0f} degrees"
    if why == "size":
        return f"{box[3]:.1f} x {box[4]:.1f} m in place of {true[3]:.1f} x {true[4]:.1f} m"
    return f"detected {np.hypot(*(box[:2] - true[:2])):.1f} m away"


def _what_is_off(found: NDArray[np.float64], true: NDArray[np.float64]) -> str:
    """Return the component of a box whose correction brings it nearest to the true one."""
    put_right = {"displaced": [0, 1], "heading": [6], "size": [3, 4]}
    best, most = "displaced", -1.0
    for name, columns in put_right.items():
        box = found.copy()
        box[columns] = true[columns]
        plan = float(plan_overlaps(box[None], true[None])[0])
        share = plan / (box[3] * box[4] + true[3] * true[4] - plan)
        if share > most:
            best, most = name, share
    return best


def reason_of(missed: Side, other: Side, key: tuple[str, int], said: Said) -> Reason:
    """Return why an object was missed in one recording and detected in the other.

    Args:
        missed: recording in which it was missed.
        other: recording in which it was detected.
        key: its frame and track.
        said: the detector's output where it was missed.
    """
    fate, before = missed.fates[key], other.fates[key]
    if fate["fate"] in ("turn lost", "out of view"):
        return Reason(fate["fate"], REASONS[fate["fate"]])
    points, was = int(fate["num_points"]), int(before["num_points"])
    if points <= FEWER * was and points < was:
        return _fewer(missed, other, key, points, was)
    if said.reason == "merged":
        truth = missed.seen.truth
        return Reason(
            "merged", said.told, truth.class_names[said.other], int(truth.track[said.other])
        )
    return Reason(said.reason, said.told)


def _fewer(missed: Side, other: Side, key: tuple[str, int], points: int, was: int) -> Reason:
    """Return why an object has fewer points than in the other recording."""
    fate, before = missed.fates[key], other.fates[key]
    alone, was_alone = int(fate["num_points_alone"]), int(before["num_points_alone"])
    told = f"{was} points, now {points}"
    more_hidden = (alone - points) - (was_alone - was)
    if more_hidden > 0 and more_hidden >= was_alone - alone:
        name, track, share, had = _what_hides_more(fate, before)
        if name is None:
            return Reason("hidden", told)
        who = name if track is None else f"{name} {track}"
        words = f"{who} hides {100 * share:.0f} % of it, before {100 * had:.0f} %; {told}"
        return Reason("hidden", words, name, track)
    lost = missed.lost.get(key[0], frozenset()) - other.lost.get(key[0], frozenset())
    if lost:
        names = ", ".join(sorted(lost))
        return Reason("turn lost", f"{told}: nothing of {names} arrived", names)
    if missed.weather != other.weather:
        weather, far = missed.weather
        air = weather if far is None else f"{weather}, {far:g} m"
        return Reason("weather", f"{told} ({air}; before {other.weather[0]})", weather)
    ranges = [
        side.seen.truth.range_m[side.rows[key]] if key in side.rows else np.nan
        for side in (other, missed)
    ]
    return Reason(
        "fewer points",
        f"{told}; alone {was_alone}, now {alone}; {ranges[0]:.0f} m away, now {ranges[1]:.0f} m",
    )


def _what_hides_more(
    fate: Mapping[str, Any], before: Mapping[str, Any]
) -> tuple[str | None, int | None, float, float]:
    """Return the occluder that increased most: class, track, fraction and former fraction."""
    now, then = (
        {(one["what"], one["track"]): float(one["share"]) for one in row["hiders"] or ()}
        for row in (fate, before)
    )
    if not now:
        return None, None, 0.0, 0.0
    # Parts of the scene have no track; ties are broken by name.
    key = min(now, key=lambda one: (then.get(one, 0.0) - now[one], one[0], one[1] or 0))
    return key[0], key[1], now[key], then.get(key, 0.0)
