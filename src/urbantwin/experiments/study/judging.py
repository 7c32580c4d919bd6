"""Figures of detection and tracking for one recording of a study."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import Detections
from urbantwin.evaluation import FEWEST_POINTS, JUDGED, Figures, Seen, evaluate, read_labelled
from urbantwin.evaluation.criterion import near, overlapping
from urbantwin.evaluation.tracks import judged_tracks
from urbantwin.evaluation.truth import counted_objects, counting, roles_of
from urbantwin.fidelity.readers import Recording
from urbantwin.geometry import points_in_box
from urbantwin.progress import Progress, between, untold
from urbantwin.tracking import tracked

__all__ = ["ALL", "METRICS", "Verdict", "judged_recording"]

#: Figures of a recording, in the order of tables, with descriptions.
METRICS: Mapping[str, str] = {
    "points": "points on an object that counts, mean",
    "seen": f"share of the objects that count with {FEWEST_POINTS} points or more",
    "in_box": "share of the points on an object that counts in its box, grown by 5 cm, mean",
    "ap": "average precision, within 1 m (trucks, buses 2 m)",
    "ap_overlap": "average precision, BEV IoU 0.5",
    "recall": "share found at the score of the best F1",
    "false_alarms": "wrong boxes a frame at that score",
    "hota": "HOTA",
    "mota": "MOTA",
    "idf1": "IDF1",
}
#: Name of the mean over classes with objects.
ALL = "all"
#: Margin of boxes in the search for their points, metres, so that noise does not count as
#: misplaced.
_MARGIN_M = 0.05


@dataclass(frozen=True)
class Verdict:
    """Evaluation of one recording.

    Attributes:
        figures: figures of `METRICS` by class (`ALL` for their mean).
        objects: number of objects that count, by class.
        counted: frame and track of those objects.
    """

    figures: dict[str, dict[str, float]]
    objects: dict[str, int]
    counted: frozenset[tuple[str, int]]


def judged_recording(
    recording: Recording,
    detections: Detections | None,
    times_s: Sequence[float],
    *,
    classes: Sequence[str] | None = None,
    base: Collection[tuple[str, int]] | None = None,
    tell: Progress = untold,
) -> Verdict:
    """Evaluate detections and tracks of one recording.

    Args:
        recording: recording of the study's motion, with labels.
        detections: detections in all of its frames; ``None`` to report visibility only.
        times_s: times of the frames, seconds.
        classes: reported classes; all with objects if ``None``.
        base: frame and track of the objects that count; those with enough points if ``None``.
        tell: called with the fraction done and a description.

    Raises:
        InputError: a file of the recording is damaged.
    """
    names = [one for one in JUDGED if one != "large" and (classes is None or one in classes)]
    nothing = _nothing(recording) if detections is None else detections
    seen = _seen(nothing, recording, base, between(tell, 0.0, 0.3))
    counted = counted_objects(seen.truth) if base is None else frozenset(base)
    inside = _inside_their_boxes(recording, seen, between(tell, 0.3, 0.4))
    figures: dict[str, dict[str, float]] = {}
    objects: dict[str, int] = {}
    for name in names:
        wanted = roles_of(seen.truth, name, layout=recording.layout, vans=False) > 0
        if wanted.any():
            points = seen.truth.num_points[wanted]
            objects[name] = int(wanted.sum())
            figures[name] = {
                "points": float(points.mean()),
                "seen": float((points >= FEWEST_POINTS).mean()),
            }
            known = inside[wanted & ~np.isnan(inside)]
            if len(known):
                figures[name]["in_box"] = float(known.mean())
    if detections is not None and objects:
        of_boxes = _evaluated(seen, recording, list(objects), between(tell, 0.4, 0.5))
        for name, one in of_boxes.classes.items():
            figures[name] |= _of_boxes(one.figures, name)
        if len(times_s) > 1:
            followed = tracked(
                detections, np.array(times_s, np.float64), tell=between(tell, 0.5, 0.7)
            )
            again = _seen(followed, recording, base, between(tell, 0.7, 0.9))
            judged = _evaluated(again, recording, list(objects), between(tell, 0.9, 1.0))
            told = judged_tracks(judged) or {}
            for name in objects:
                row = told.get(name, {})
                figures[name] |= {key: float(row.get(key, 0.0)) for key in ("hota", "mota", "idf1")}
    if figures:
        figures[ALL] = {
            key: float(np.mean([row[key] for row in figures.values()]))
            for key in METRICS
            if all(key in row for row in figures.values())
        }
        objects[ALL] = sum(objects.values())
    return Verdict(figures, objects, counted)


def _seen(
    detections: Detections,
    recording: Recording,
    base: Collection[tuple[str, int]] | None,
    tell: Progress,
) -> Seen:
    seen = read_labelled(detections, recording, tell=tell)
    return seen if base is None else replace(seen, truth=counting(seen.truth, base))


def _inside_their_boxes(recording: Recording, seen: Seen, tell: Progress) -> NDArray[np.float64]:
    """Return the fraction of each object's points (L,) inside its box; NaN without points."""
    truth = seen.truth
    share = np.full(len(truth), np.nan)
    for number, which in enumerate(seen.number):
        tell(number / len(seen.number), "points in boxes")
        frame = recording.read(which)
        if frame.instance is None:
            return share
        order = np.argsort(frame.instance, kind="stable")
        own = frame.instance[order]
        for row in np.flatnonzero((truth.frame == number) & (truth.track >= 0)):
            first, last = np.searchsorted(own, (truth.track[row], truth.track[row] + 1))
            if last > first:
                points = frame.points[order[first:last]]
                share[row] = points_in_box(points, truth.box[row], _MARGIN_M).mean()
    return share


def _evaluated(seen: Seen, recording: Recording, names: Sequence[str], tell: Progress) -> Figures:
    # Intervals of a single recording are not used: a study's are over seeds.
    return evaluate(seen, layout=recording.layout, classes=names, draws=1, tell=tell)


def _of_boxes(told: Mapping[str, object], name: str) -> dict[str, float]:
    precision, best, alarms = told["ap"], told["best_f1"], told["false_alarms"]
    assert isinstance(precision, Mapping)
    assert isinstance(alarms, Mapping)
    return {
        "ap": float(precision[near(name).name]["ap"] or 0.0),
        "ap_overlap": float(precision[overlapping().name]["ap"] or 0.0),
        "recall": float(best["recall"]) if isinstance(best, Mapping) else 0.0,
        "false_alarms": float(alarms["per_frame"]),
    }


def _nothing(recording: Recording) -> Detections:
    """Return empty detections for all frames."""
    return Detections(
        frames=tuple(recording.names),
        frame=np.zeros(0, np.int64),
        box=np.zeros((0, 7)),
        class_names=(),
        score=np.zeros(0),
        track=np.zeros(0, np.int64),
    )
