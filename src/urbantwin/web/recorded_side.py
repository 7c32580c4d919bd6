"""Frames with points: an UrbanTwin dataset, or a recording in any known layout."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import cached_property
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.readers import Recording
from urbantwin.geometry import Pose
from urbantwin.progress import Progress, untold
from urbantwin.web.own_dataset import OwnDataset
from urbantwin.web.points import fields_of
from urbantwin.web.shown_boxes import ShownBoxes
from urbantwin.web.side import FrameEntry, told_without_folders
from urbantwin.web.why_unseen import explain_unseen

__all__ = ["RecordedSide"]

#: Number of cached frames; points and boxes of a frame are requested separately.
_KEPT = 3
#: Assumed time between frames of a recording without times, seconds.
_APART_S = 0.1
#: Surveyed frames of other recordings at most; datasets of UrbanTwin need no survey.
_SURVEYED = 60
_TRIED = 5
#: Beyond this, coordinates are a map's, metres.
_FAR_M = 5000.0


class RecordedSide:
    """Frames of a recording as a side (see `side.Side`).

    Args:
        recording: recording with the frames.
        role: ``real``, ``synthetic`` or ``only``.
        own: the UrbanTwin dataset; None for other recordings.
        chosen: frames to show.
        beside: another side, whose frame the points of this one are in.
        in_site: transform points to the site frame; otherwise they stay in their own frame, or for
            a moving sensor in that of the first frame.
        tell: called with the progress of the survey.

    Raises:
        InputError: no frame, or none of the first ones can be read.
    """

    def __init__(
        self,
        recording: Recording,
        role: str,
        *,
        own: OwnDataset | None = None,
        beside: RecordedSide | None = None,
        chosen: Callable[[int], Sequence[int]] = range,
        in_site: bool = False,
        tell: Progress = untold,
    ) -> None:
        self.recording, self.role, self.own, self.in_site = recording, role, own, in_site
        self.name = recording.path.name
        self._kept: OrderedDict[int, Frame] = OrderedDict()
        self._lock = Lock()
        self._poses: dict[int, Pose | None] = {}
        self._beside = beside
        self.shift_m: NDArray[np.float64] | None = None if beside is None else beside.shift_m
        if own is not None:
            entries = own.entries(recording)
            self.rate_hz = own.rate_hz
        else:
            entries = [
                FrameEntry(name, round(number * _APART_S, 6))
                for number, name in enumerate(recording.names)
            ]
            self.rate_hz = 1.0 / _APART_S
        rows = list(chosen(len(entries)))
        self.entries = [entries[row] for row in rows]
        if not self.entries:
            raise InputError("holds no frames", file=recording.path, expected="at least one")
        numbers = {name: number for number, name in enumerate(recording.names)}
        self._numbers = [
            numbers.get(entries[row].name, -1) if own is not None else row for row in rows
        ]
        self._survey(tell)

    def _survey(self, tell: Progress) -> None:
        """Read the first frame, or all of a short foreign recording, to learn its fields."""
        count = len(self.entries)
        several = count if self.own is None and count <= _SURVEYED else 0
        first: Frame | None = None
        problem: InputError | None = None
        self.fields: list[str] = []
        self.has_boxes, self.tracked, self._scale = False, False, 0.0
        self.has_points = True
        tried = at = 0
        for index, entry in enumerate(self.entries):
            if index >= several and (first is not None or tried >= _TRIED):
                break
            if entry.error is not None:
                continue
            tell(index / count, f"frame {entry.name}")
            try:
                frame = self._read(index)
            except InputError as error:
                problem, tried = problem or error, tried + 1
                continue
            if first is None:
                first, at = frame, index
                self._first = frame.world_SE3_frame
            entry.points = len(frame.points)
            self.fields += [one for one in fields_of(frame) if one not in self.fields]
            if frame.boxes is not None:
                self.has_boxes = True
                self.tracked |= bool((frame.boxes.track >= 0).any())
            if frame.intensity is not None:
                self._scale = max(self._scale, float(frame.intensity.max(initial=0.0)))
        if first is None:
            if problem is not None:
                raise problem
            told = next((one.error for one in self.entries if one.error), "cannot be read")
            raise InputError(
                f"has no frame that can be read ({told})",
                file=self.recording.path,
                expected="at least one",
            )
        if self.own is None and self._beside is None:
            self.shift_m = _nearer(first)
        self.sample = self._placed(first, at)

    @property
    def surveyed(self) -> bool:
        """Whether every frame was read in the survey."""
        return self.own is None and len(self.entries) <= _SURVEYED

    @cached_property
    def full_scale(self) -> float:
        """The intensity that is shown brightest."""
        return 1.0 if self.own is not None else full_scale(self._scale)

    @property
    def sensors_range_m(self) -> float:
        """Largest range of the sensors, metres; infinity if unknown."""
        if self.own is None:
            return np.inf
        ranges = [one["sensor"].get("range_max_m") for one in self.own.sensors if "sensor" in one]
        known = [float(one) for one in ranges if one is not None]
        return max(known) if known and len(known) == len(ranges) else np.inf

    def scene_SE3_frame(self, index: int) -> Pose | None:  # noqa: N802
        """Return the transform of a frame to the scene; None for the identity.

        Raises:
            InputError: a frame has to be read for it, and cannot be.
        """
        if self.own is not None:
            site = self.own.site_SE3_frame(self.entries[index].name)
            if self.in_site or site is None:
                return site
            first = self.own.site_SE3_frame(self.entries[0].name)
            return None if first is None else first.inverse() @ site
        if index not in self._poses:
            self.frame(index)
        return self._poses[index]

    def _scene_SE3_others(self, frame: Frame) -> Pose | None:  # noqa: N802
        """Return the transform of a foreign frame to the scene, relative to the first."""
        pose: Pose | None = None
        if frame.world_SE3_frame is not None and self._first is not None:
            pose = self._first.inverse() @ frame.world_SE3_frame
        if self.shift_m is not None:
            nearer = Pose(np.eye(3), self.shift_m)
            pose = nearer if pose is None else nearer @ pose
        return pose

    def _read(self, index: int) -> Frame:
        entry, number = self.entries[index], self._numbers[index]
        if number < 0:
            raise InputError(entry.error or "not found", file=self.recording.path)
        try:
            return self.recording.read(number)
        except InputError as error:
            entry.error = told_without_folders(error, self.recording.path)
            raise
        except OSError as error:
            entry.error = error.strerror or "cannot be read"
            raise InputError(entry.error, file=error.filename) from None

    def _placed(self, frame: Frame, index: int) -> Frame:
        if self.own is None:
            self._poses[index] = self._scene_SE3_others(frame)
        pose = self.scene_SE3_frame(index)
        return frame if pose is None else frame.moved(pose)

    def frame(self, index: int) -> Frame:
        """Return a frame in the scene's frame; the last few are cached."""
        with self._lock:
            kept = self._kept.get(index)
            if kept is None:
                kept = self._kept[index] = self._placed(self._read(index), index)
            self._kept.move_to_end(index)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
            return kept

    def boxes(self, index: int) -> ShownBoxes:
        """Return the boxes of a frame, with the reasons why some are not seen."""
        frame = self.frame(index)
        boxes = ShownBoxes.of(frame.boxes)
        if frame.boxes is None:
            return boxes
        if self.own is not None:
            self.own.complete(self.entries[index].name, boxes)
        if boxes.points is None:
            owner = frame.boxes.points_of(frame.points)
            boxes.points = np.bincount(owner[owner >= 0], minlength=len(boxes)).astype(np.int64)
        explain_unseen(boxes, frame.sensor_places, self.sensors_range_m)
        return boxes


def _nearer(frame: Frame) -> NDArray[np.float64] | None:
    """Return the shift of points in map coordinates; None if they are near the origin.

    The page's numbers have 24 bits: half a metre at the northings of a UTM zone.
    """
    middle = np.median(frame.points, axis=0)
    far = np.abs(middle).max() > _FAR_M
    return np.asarray(-np.round(middle, -2)) if far else None
