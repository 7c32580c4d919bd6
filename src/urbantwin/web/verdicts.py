"""Detections over the labels of a frame: true positives, misses, false positives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urbantwin.detections import Detections
from urbantwin.errors import InputError
from urbantwin.evaluation import read_labelled
from urbantwin.evaluation.criterion import JUDGED, near
from urbantwin.evaluation.matching import matched
from urbantwin.evaluation.pairs import pairs_of
from urbantwin.evaluation.reading import shared_frames
from urbantwin.evaluation.truth import roles_of
from urbantwin.geometry import Pose
from urbantwin.web.recorded_side import RecordedSide
from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["DetectionsBeside"]


@dataclass(frozen=True, eq=False)
class DetectionsBeside:
    """Detections of the frames of a side.

    Attributes:
        detections: detections of any frames.
        side: side with the detected frames.
    """

    detections: Detections
    side: RecordedSide

    def __post_init__(self) -> None:
        """Refuse detections of other frames.

        Raises:
            InputError: no frame is in both.
        """
        recording = self.side.recording
        shared = shared_frames(self.detections.frames, recording.names, recording.path)
        names = recording.names
        object.__setattr__(self, "_index", {names[k]: row for k, row in shared.items()})

    def over(self, index: int, labels: ShownBoxes) -> ShownBoxes:
        """Return a frame's labels, followed by its detections, each with its verdict.

        As in `urbantwin model evaluate`: in order of falling score, each detection matches the
        nearest unmatched object of its class within the class's distance.

        Args:
            index: index of the side's frame.
            labels: labels of that frame, in the scene's frame.
        """
        name = self.side.entries[index].name
        rows = np.zeros(0, np.int64)
        where: dict[str, int] = self._index  # type: ignore[attr-defined]
        if name in where:
            rows = np.flatnonzero(self.detections.frame == where[name])
        mine = self.detections.only(rows)
        pose = self.side.scene_SE3_frame(index)
        box = _moved(mine.box, pose)
        said = [""] * (len(labels) + len(mine))
        match = np.full(len(said), -1, np.int64)
        if name in where and len(labels):
            self._judge(name, where[name], rows, len(labels), said, match)
        scores = np.concatenate([np.full(len(labels), np.nan), mine.score])
        merged = _joined(labels, box, list(mine.class_names), mine.track)
        merged.score, merged.verdict, merged.match = scores, said, match
        return merged

    def _judge(
        self,
        name: str,
        row: int,
        rows: np.ndarray,
        labels: int,
        said: list[str],
        match: np.ndarray,
    ) -> None:
        recording = self.side.recording
        alone = self.detections.only(rows)
        here = Detections(
            (self.detections.frames[row],),
            np.zeros(len(rows), np.int64),
            alone.box,
            alone.class_names,
            alone.score,
            alone.track,
        )
        try:
            seen = read_labelled(here, recording)
        except InputError:
            return  # no labels in this frame, or it is damaged: then nothing is judged
        if len(seen.truth) != labels:
            return
        pairs = pairs_of(seen.detections, seen.truth)
        score = seen.detections.score
        for kind in JUDGED:
            if kind == "large":
                continue  # its member classes are evaluated separately
            roles = roles_of(seen.truth, kind, layout=recording.layout, vans=False)
            members = JUDGED[kind]
            order = np.flatnonzero([one in members for one in seen.detections.class_names])
            order = order[np.argsort(-score[order], kind="stable")]
            found = matched(pairs, order, roles, seen.in_view, near(kind))
            for one in np.flatnonzero(roles > 0):
                said[one] = "miss"
            for one, label in zip(found.detection.tolist(), found.label.tolist(), strict=True):
                said[labels + one] = "hit" if label >= 0 else "false alarm"
                match[labels + one] = label
                if label >= 0:
                    said[label] = "hit"


def _moved(box: np.ndarray, pose: Pose | None) -> np.ndarray:
    if pose is None:
        return box
    moved = box.copy()
    moved[:, :3] = pose.apply(box[:, :3])
    moved[:, 6] += np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    return moved


def _joined(labels: ShownBoxes, box: np.ndarray, names: list[str], track: np.ndarray) -> ShownBoxes:
    count = len(box)

    def longer(values: np.ndarray | None, missing: float) -> np.ndarray | None:
        if values is None:
            return None
        return np.concatenate([values, np.full((count, *values.shape[1:]), missing, values.dtype)])

    def more(values: list[str] | None) -> list[str] | None:
        return None if values is None else values + [""] * count

    return ShownBoxes(
        box=np.concatenate([labels.box, box]),
        class_names=labels.class_names + names,
        track=np.concatenate([labels.track, track]),
        velocity=longer(labels.velocity, np.nan),
        points=longer(labels.points, -1),
        alone=longer(labels.alone, -1),
        occlusion=longer(labels.occlusion, np.nan),
        truncation=longer(labels.truncation, np.nan),
        difficulty=more(labels.difficulty),
        ignored=more(labels.ignored),
        hidden_by=labels.hidden_by + [None] * count if labels.hidden_by else [],
        why=labels.why + [""] * count if labels.why else [],
    )
