"""UrbanTwin datasets for the page: times, sensors, additional columns of boxes."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.dataset.reading import FrameFiles, pose_of_matrix, read_manifest
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.fidelity.readers import Recording
from urbantwin.geometry import Pose
from urbantwin.web.shown_boxes import ShownBoxes
from urbantwin.web.side import FrameEntry

__all__ = ["OwnDataset"]


class OwnDataset:
    """A dataset's manifest and labels.

    Args:
        folder: folder of the dataset.

    Attributes:
        folder: folder of the dataset.
        manifest: content of ``dataset.json``.

    Raises:
        InputError: the manifest is wrong.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest: dict[str, Any] = read_manifest(folder)

    @property
    def rate_hz(self) -> float:
        """Frames a second of the rig."""
        return float(self.manifest["rig"]["rate_hz"])

    @property
    def sensors(self) -> list[dict[str, Any]]:
        """The sensors' entries in the manifest."""
        return list(self.manifest["rig"]["sensors"])

    def entries(self, recording: Recording) -> list[FrameEntry]:
        """Return the frames in the manifest, with missing or truncated ones marked."""
        there = set(recording.names)
        found = []
        for one in self.manifest["frames"]:
            files = FrameFiles(self.folder, one["name"], self.manifest.get("storage"))
            wrong = files.problem_of_sizes() if files.name in there else f"{files}: not found"
            points = int(one.get("points", 0))
            found.append(FrameEntry(files.name, float(one["time_s"]), points, wrong))
        return found

    def site_SE3_frame(self, name: str) -> Pose | None:  # noqa: N802
        """Return the transform of a frame's points to the site frame; None if unknown."""
        told = self._frames.get(name, {})
        rows = told.get("dataset_SE3_site") or self.manifest.get("dataset_SE3_site")
        return None if rows is None else pose_of_matrix(rows).inverse()

    @cached_property
    def _frames(self) -> dict[str, dict[str, Any]]:
        return {one["name"]: one for one in self.manifest["frames"]}

    @cached_property
    def objects(self) -> LabelledObjects | None:
        """The labelled boxes of all frames; None without labels.

        Raises:
            InputError: the labels are damaged.
        """
        there = LabelledObjects.is_in(self.folder)
        return LabelledObjects.in_folder(self.folder) if there else None

    def complete(self, name: str, boxes: ShownBoxes) -> None:
        """Add columns to the boxes of a frame that a `Frame` lacks."""
        if self.objects is None:
            return
        own = self.objects.of_frame(name)
        row = {track: k for k, track in enumerate(own.track.tolist())}
        rows = np.array([row.get(int(one), -1) for one in boxes.track], int)
        known = rows >= 0
        boxes.alone, boxes.truncation = np.full(len(rows), -1), np.full(len(rows), np.nan)
        boxes.alone[known] = own.num_points_alone[rows[known]]
        boxes.truncation[known] = own.truncation[rows[known]]
        boxes.difficulty = [own.difficulty[k] if k >= 0 else "" for k in rows.tolist()]
