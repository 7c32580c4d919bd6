"""The worst misses and false alarms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.bootstrap import same_objects
from urbantwin.evaluation.evaluate import Figures, Judged
from urbantwin.evaluation.false_alarms import REASONS

__all__ = ["Case", "worst_false_alarms", "worst_misses"]

#: False alarms nearer to each other are shown once, metres.
_APART_M = 1.0


@dataclass(frozen=True, eq=False)
class Case:
    """A missed object or a false alarm.

    Attributes:
        class_name: class of the object, or the detected class.
        frame: index of the evaluated frame.
        box: (7,) box of the object or of the wrong detection.
        range_m: distance from the nearest sensor, metres.
        num_points: points in the box.
        score: score of a wrong detection; None for a miss.
        told: explanation for the report.
    """

    class_name: str
    frame: int
    box: NDArray[np.float64]
    range_m: float
    num_points: int
    score: float | None
    told: str

    def row(self, frames: Sequence[str]) -> dict[str, Any]:
        """Return the case as a row of the report."""
        return {
            "class": self.class_name,
            "frame": frames[self.frame],
            "box": [round(float(one), 3) for one in self.box],
            "range_m": round(self.range_m, 1),
            "points": self.num_points,
            "score": self.score,
            "told": self.told,
        }


def worst_misses(figures: Figures, most: int) -> list[Case]:
    """Return objects missed at the best threshold, those with most points first.

    Points are compared within a class, and classes alternate; an object missed in several frames is
    listed once.
    """
    truth = figures.seen.truth
    same = same_objects(truth)
    by_class = []
    for one in _single(figures):
        score = figures.seen.detections.score
        above = one.found.right & (score[one.found.detection] >= one.threshold)
        missed = one.roles > 0
        missed[one.found.label[above]] = False
        rows = np.flatnonzero(missed)
        rows = rows[np.argsort(-truth.num_points[rows], kind="stable")]
        _, first = np.unique(same[rows], return_index=True)
        by_class.append([(one, int(row)) for row in rows[np.sort(first)][:most]])
    return [_miss(figures, one, row) for one, row in _in_turn(by_class, most)]


def _single(figures: Figures) -> Iterable[Judged]:
    """Return the classes without "large", whose members are evaluated on their own."""
    named = [one for name, one in figures.classes.items() if name != "large"]
    return named or figures.classes.values()


def _in_turn(
    by_class: Sequence[Sequence[tuple[Judged, int]]], most: int
) -> list[tuple[Judged, int]]:
    taken: list[tuple[Judged, int]] = []
    for rank in range(most):
        taken += [rows[rank] for rows in by_class if rank < len(rows)]
    return taken[:most]


def _miss(figures: Figures, one: Judged, row: int) -> Case:
    truth, pairs, found = figures.seen.truth, figures.pairs, figures.seen.detections
    near = np.flatnonzero((pairs.label == row) & ((pairs.bev_iou > 0) | (pairs.distance_m <= 2)))
    told = "nothing is there"
    if len(near):
        order = np.lexsort((-found.score[pairs.detection[near]], -pairs.bev_iou[near]))
        best = near[order[0]]
        detection = int(pairs.detection[best])
        told = (
            f"nearest: {found.class_names[detection]}, score {found.score[detection]:.2f}, "
            f"{pairs.distance_m[best]:.1f} m away, IoU {pairs.bev_iou[best]:.2f}"
        )
    hidden = truth.occlusion[row]
    if np.isfinite(hidden):
        told += f"; {100 * hidden:.0f} % hidden"
    return Case(
        one.name,
        int(truth.frame[row]),
        truth.box[row],
        float(truth.range_m[row]),
        int(truth.num_points[row]),
        None,
        told,
    )


def worst_false_alarms(figures: Figures, most: int) -> list[Case]:
    """Return wrong detections by falling score, one per position."""
    seen = figures.seen
    wrong = [
        (float(seen.detections.score[detection]), detection, one.name, reason)
        for one in _single(figures)
        for detection, reason in zip(one.found.detection.tolist(), one.reasons, strict=True)
        if reason
    ]
    wrong.sort(key=lambda row: (-row[0], row[1]))
    cases: list[Case] = []
    for score, detection, name, reason in wrong:
        box = seen.detections.box[detection]
        if any(np.hypot(*(one.box - box)[:2]) < _APART_M for one in cases):
            continue
        cases.append(
            Case(
                name,
                int(seen.detections.frame[detection]),
                box,
                float(seen.range_m[detection]),
                int(seen.num_points[detection]),
                score,
                REASONS[reason],
            )
        )
        if len(cases) == most:
            break
    return cases
