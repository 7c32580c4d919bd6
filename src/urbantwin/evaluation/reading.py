"""Reading of the labelled frames of a recording beside detections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import Detections
from urbantwin.errors import InputError
from urbantwin.evaluation.truth import FEWEST_POINTS, Truth, why_not
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.labelled_view import View, view_of
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.tables import frame_number
from urbantwin.geometry import points_in_box
from urbantwin.progress import Progress, untold

__all__ = ["Seen", "read_labelled", "shared_frames"]

#: Boxes this far above or below the points at their position belong to another frame, metres.
_APART_M = 1.0
#: Share and number of such boxes from which all detections are in another frame.
_MOST, _FEWEST = 0.9, 10


@dataclass(frozen=True, eq=False)
class Seen:
    """Detections and labels of the same frames.

    Attributes:
        detections: detections of the labelled frames.
        truth: labels of the same frames.
        number: (frames,) number of each frame in the recording.
        in_view: (N,) whether each detection is in the labelled region.
        num_points: (N,) points in each detection.
        range_m: (N,) distance from the nearest sensor in plan, metres.
        view: description of the labelled region.
        notes: notes that qualify the results.
    """

    detections: Detections
    truth: Truth
    number: tuple[int, ...]
    in_view: NDArray[np.bool_]
    num_points: NDArray[np.int64]
    range_m: NDArray[np.float64]
    view: str
    notes: tuple[str, ...]


def shared_frames(found: Sequence[str], recorded: Sequence[str], path: Path) -> dict[int, int]:
    """Return the recording's frame number -> frame number of the detections, for common frames.

    Names are compared literally, then without suffixes, then by the number at their end.

    Raises:
        InputError: there is no common frame.
    """
    keys: tuple[Callable[[str], str], ...] = (str, lambda name: name.split(".")[0], frame_number)
    for key in keys:
        told = {key(name): number for number, name in enumerate(found)}
        known = [key(name) for name in recorded]
        if len(told) < len(found) or len(set(known)) < len(known):
            continue
        shared = {number: told[name] for number, name in enumerate(known) if name in told}
        if shared:
            return shared
    raise InputError(
        f"has none of the frames of the predictions ({_some(found)})",
        file=path,
        expected=f"frames of the same names; here are {_some(recorded)}",
    )


def _some(names: Sequence[str]) -> str:
    few = ", ".join(names[:3])
    return f"{few}, ... {names[-1]}" if len(names) > 3 else few or "none"


def read_labelled(
    detections: Detections,
    recording: Recording,
    *,
    fewest_points: int = FEWEST_POINTS,
    most_m: float | None = None,
    tell: Progress = untold,
) -> Seen:
    """Read the frames that have both labels and detections.

    Args:
        detections: detections of any frames.
        recording: a recording with labels.
        fewest_points: labelled boxes with fewer points do not count.
        most_m: maximum distance of counted objects and detections from the nearest sensor, metres.
        tell: called with the progress.

    Raises:
        InputError: there is no common frame, no frame has labels, a file is invalid, or the
            detections are in another frame of reference.
    """
    shared = shared_frames(detections.frames, recording.names, recording.path)
    view = view_of(recording)
    frames: list[_FrameSeen] = []
    for count, (number, index) in enumerate(shared.items()):
        tell(count / len(shared), f"frame {recording.names[number]}")
        frame = recording.read(number)
        if frame.boxes is not None:
            rows = np.flatnonzero(detections.frame == index)
            frames.append(_seen(frame, frame.boxes, number, detections, rows, view))
    if not frames:
        raise InputError(
            f"has no labels in the {len(shared)} frames of the predictions",
            file=recording.path,
            expected="frames with boxes",
        )
    _refuse_other_frame(frames, detections)
    truth = _truth(frames, recording, detections, shared, fewest_points, most_m)
    rows = np.concatenate([one.rows for one in frames])
    here = np.repeat(np.arange(len(frames)), [len(one.rows) for one in frames])
    away = np.concatenate([one.range_m for one in frames])
    in_view = np.concatenate([one.in_view for one in frames])
    if most_m is not None:
        in_view &= away <= most_m
    judged = replace(
        detections.only(rows), frames=truth.frames, frame=here.astype(np.int64), time_s=truth.time_s
    )
    return Seen(
        detections=judged,
        truth=truth,
        number=tuple(one.number for one in frames),
        in_view=in_view,
        num_points=np.concatenate([one.num_points for one in frames]),
        range_m=away,
        view=view.said,
        notes=_notes(detections, recording, len(shared), frames),
    )


@dataclass(frozen=True, eq=False)
class _FrameSeen:
    name: str
    number: int
    boxes: Boxes
    box_points: NDArray[np.int64]
    box_range_m: NDArray[np.float64]
    rows: NDArray[np.int64]
    in_view: NDArray[np.bool_]
    num_points: NDArray[np.int64]
    range_m: NDArray[np.float64]
    above_m: NDArray[np.float64]
    notes: tuple[str, ...]


def _seen(
    frame: Frame,
    boxes: Boxes,
    number: int,
    detections: Detections,
    rows: NDArray[np.int64],
    view: View,
) -> _FrameSeen:
    told = boxes.num_points
    counted = np.full(len(boxes), -1, np.int64) if told is None else told.astype(np.int64)
    if (counted < 0).any():
        owner = boxes.points_of(frame.points)
        inside = np.bincount(owner[owner >= 0], minlength=len(boxes))
        counted = np.where(counted < 0, inside, counted)
    found = detections.box[rows]
    num_points, above = _points_in(frame.points, found)
    return _FrameSeen(
        name=frame.name,
        number=number,
        boxes=boxes,
        box_points=counted,
        box_range_m=_ranges(boxes.box, frame),
        rows=rows,
        in_view=view.covers(frame, found),
        num_points=num_points,
        range_m=_ranges(found, frame),
        above_m=above,
        notes=frame.notes,
    )


def _ranges(boxes: NDArray[np.float64], frame: Frame) -> NDArray[np.float64]:
    away = boxes[:, None, :2] - frame.sensor_places[None, :, :2]
    return np.asarray(np.hypot(away[..., 0], away[..., 1]).min(axis=1))


def _points_in(
    points: NDArray[np.float64], boxes: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the number of points in each box (N, 7), and the height of points above the box.

    The height is that of the nearest point outside in plan, negative below the box; 0 if points are
    inside, and NaN without points in plan.
    """
    counts, above = np.zeros(len(boxes), np.int64), np.full(len(boxes), np.nan)
    order = np.argsort(points[:, 0])
    x, y = points[order, 0], points[order, 1]
    for row, box in enumerate(boxes):
        reach = np.hypot(box[3], box[4]) / 2
        first, last = np.searchsorted(x, (box[0] - reach, box[0] + reach))
        near = order[first:last][np.abs(y[first:last] - box[1]) <= reach]
        column = points[near]
        tall = box.copy()
        tall[2], tall[5] = 0.0, np.inf
        column = column[points_in_box(column, tall)]
        if len(column):
            high = column[:, 2] - box[2]
            counts[row] = int((np.abs(high) <= box[5] / 2).sum())
            outside = np.maximum(np.abs(high) - box[5] / 2, 0.0)
            nearest = int(outside.argmin())
            above[row] = np.sign(high[nearest]) * outside[nearest]
    return counts, above


def _refuse_other_frame(frames: Sequence[_FrameSeen], detections: Detections) -> None:
    """Raise an error if nearly all boxes lie far above or below the points."""
    above = np.concatenate([one.above_m for one in frames])
    known = above[~np.isnan(above)]
    if len(known) < _FEWEST or (np.abs(known) > _APART_M).mean() < _MOST:
        return
    middle = float(np.median(known))
    rows = np.concatenate([one.rows for one in frames])
    heights = detections.box[rows, 2]
    raise InputError(
        f"boxes lie {abs(middle):.1f} m {'below' if middle > 0 else 'above'} the points (their z "
        f"is {np.median(heights):.1f} m in the middle)",
        place="predictions",
        expected="z upwards, in the frame of the points, of the box's centre",
    )


def _truth(
    frames: Sequence[_FrameSeen],
    recording: Recording,
    detections: Detections,
    shared: dict[int, int],
    fewest_points: int,
    most_m: float | None,
) -> Truth:
    boxes = [one.boxes for one in frames]
    num_points = np.concatenate([one.box_points for one in frames])
    away = np.concatenate([one.box_range_m for one in frames])
    marked = [reason for one in boxes for reason in (one.ignored or ("",) * len(one))]
    times = np.full(len(frames), np.nan)
    if detections.time_s is not None:
        times = np.array([detections.time_s[shared[one.number]] for one in frames], np.float64)
    return Truth(
        frames=tuple(recording.names[one.number] for one in frames),
        time_s=times,
        frame=np.repeat(np.arange(len(frames)), [len(one) for one in boxes]).astype(np.int64),
        box=np.concatenate([one.box for one in boxes]),
        class_names=tuple(name for one in boxes for name in one.class_names),
        source_names=tuple(name for one in boxes for name in (one.source_names or one.class_names)),
        track=np.concatenate([one.track for one in boxes]),
        num_points=num_points,
        occlusion=np.concatenate(
            [np.full(len(o), np.nan) if o.occlusion is None else o.occlusion for o in boxes]
        ),
        ignored=why_not(marked, num_points, away, fewest_points=fewest_points, most_m=most_m),
        range_m=away,
    )


def _notes(
    detections: Detections, recording: Recording, shared: int, frames: Sequence[_FrameSeen]
) -> tuple[str, ...]:
    notes = list(recording.notes)
    notes += list(dict.fromkeys(note for one in frames for note in one.notes))
    if shared < len(detections.frames):
        lost = len(detections.frames) - shared
        notes.append(f"{lost} of {len(detections.frames)} frames of the predictions are not here.")
    if shared < len(recording):
        notes.append(f"{len(recording) - shared} of {len(recording)} frames have no predictions.")
    if len(frames) < shared:
        notes.append(f"{shared - len(frames)} of {shared} frames have no labels.")
    return tuple(dict.fromkeys(notes))
