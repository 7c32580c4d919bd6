"""Objects that are found in only one of two recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation import Criterion
from urbantwin.evaluation.truth import counted_objects
from urbantwin.studies.causes.reasons import Reason, Said, reason_of, said_of
from urbantwin.studies.causes.side import Side, class_of

__all__ = ["LOST", "WON", "Change", "Comparison", "changes_between"]

LOST, WON = "found to missed", "missed to found"


@dataclass(frozen=True, eq=False)
class Change:
    """One object in one frame that is found in one recording only.

    Attributes:
        frame: name of the frame.
        time_s: time of the frame, seconds; NaN if it is unknown.
        track: track of the object.
        actor: class of the object.
        way: `LOST` or `WON`.
        reason: why it was missed, in the recording where it was missed.
        said: output of the detector for the object in that recording.
        points: number of points on it, base and variant.
        alone: number of points without occlusion by other objects.
        score: score of the detection that found it.
    """

    frame: str
    time_s: float
    track: int
    actor: str
    way: str
    reason: Reason
    said: Said
    points: tuple[int, int]
    alone: tuple[int, int]
    score: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two recordings compared.

    Attributes:
        base: recording without the change.
        variant: recording with the change.
        found: (L,) the detection that found each object of both sides, -1 for none.
        changes: changes by frame, then track.
        both, neither: number of objects found or missed on both sides.
        apart: number of objects that would count but exist on one side only.
    """

    base: Side
    variant: Side
    found: tuple[NDArray[np.int64], NDArray[np.int64]]
    changes: tuple[Change, ...]
    both: int
    neither: int
    apart: int


def changes_between(
    base: Side,
    variant: Side,
    criterion: Mapping[str, Criterion],
    least: Mapping[str, float],
) -> Comparison:
    """Compare two recordings of the same objects.

    An object counts if it counts on either side, so an object that has lost all its points is
    missed.

    Args:
        base: recording without the change.
        variant: recording with the change.
        criterion: by class, the condition for a detection to match an object.
        least: by class, the minimum score of a detection that counts.
    """
    counted = counted_objects(base.seen.truth) | counted_objects(variant.seen.truth)
    there = {key for key in counted if key in base.rows and key in variant.rows}
    sides = base.counting(there), variant.counting(there)
    found = sides[0].found(criterion, least), sides[1].found(criterion, least)
    changes, both, neither = [], 0, 0
    for key in sorted(there):
        rows = sides[0].rows[key], sides[1].rows[key]
        name = class_of(sides[0].seen.truth.class_names[rows[0]])
        if name is None or any(key not in side.fates for side in sides):
            continue
        hits = found[0][rows[0]] >= 0, found[1][rows[1]] >= 0
        if hits[0] == hits[1]:
            both, neither = both + hits[0], neither + (not hits[0])
            continue
        at = 1 if hits[0] else 0  # side on which it was missed
        missed, other = sides[at], sides[1 - at]
        said = said_of(missed, rows[at], name, found[at], criterion[name], least)
        told = [side.fates[key] for side in sides]
        detection = found[1 - at][rows[1 - at]]
        changes.append(
            Change(
                frame=key[0],
                time_s=float(told[0]["time_s"]),
                track=key[1],
                actor=sides[0].seen.truth.class_names[rows[0]],
                way=LOST if at else WON,
                reason=reason_of(missed, other, key, said),
                said=said,
                points=(int(told[0]["num_points"]), int(told[1]["num_points"])),
                alone=(int(told[0]["num_points_alone"]), int(told[1]["num_points_alone"])),
                score=float(other.seen.detections.score[detection]),
            )
        )
    return Comparison(*sides, found, tuple(changes), both, neither, len(counted) - len(there))
