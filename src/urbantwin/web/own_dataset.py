"""What a dataset of ours says beyond its frames: times, sensors, columns of its boxes."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.artefact.arrays import array_header
from urbantwin.artefact.tables import read_parquet
from urbantwin.dataset.reading.frame_files import STORED
from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording
from urbantwin.geometry import Pose
from urbantwin.web.shown_boxes import ShownBoxes
from urbantwin.web.side import FrameEntry

__all__ = ["OwnDataset"]

_EXPECTED = "a dataset of urbantwin record"


class OwnDataset:
    """A dataset's tables and manifest.

    Args:
        folder: of the dataset.

    Attributes:
        folder: where it is.
        manifest: ``dataset.json``.

    Raises:
        InputError: the manifest is not right.
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
        """The sensors as the manifest has them."""
        return list(self.manifest["rig"]["sensors"])

    def points_file(self, name: str) -> str:
        """Return which file has the points of a frame, from the dataset's folder on."""
        return f"points/{name}{STORED.get(self.manifest.get('storage', 'npy'), '.npy')}"

    def entries(self, recording: Recording) -> list[FrameEntry]:
        """Return the frames that the manifest names, those that are missing or cut short marked."""
        there = set(recording.names)
        found = []
        for one in self.manifest["frames"]:
            name = one["name"]
            error = self._wrong(name) if name in there else f"{self.points_file(name)}: not found"
            entry = FrameEntry(name, float(one["time_s"]), int(one.get("points", 0)), error)
            found.append(entry)
        return found

    def _wrong(self, name: str) -> str | None:
        """Return what is wrong with the sizes of a frame's files; the contents are not read."""
        rows: int | None = None
        for folder in ("points", "rays"):
            file = self.folder / folder / f"{name}.npy"
            if not file.is_file():
                continue
            try:
                with file.open("rb") as stream:
                    _, whole, shape = array_header(stream)
            except Exception:  # a header is Python's syntax: its parser raises what it likes
                return f"{folder}/{name}.npy: is no array"
            size = file.stat().st_size
            if size != whole:
                return f"{folder}/{name}.npy: has {size:,} bytes; expected {whole:,}"
            if rows is not None and shape and shape[0] != rows:
                return f"{folder}/{name}.npy: has {shape[0]:,} rows for {rows:,} points"
            rows = shape[0] if shape else 0
        labels = self.folder / "semantic" / f"{name}.label"
        if rows is not None and labels.is_file() and labels.stat().st_size != 4 * rows:
            size = labels.stat().st_size
            return f"semantic/{name}.label: has {size:,} bytes; expected 4 for each of {rows:,}"
        return None

    def site_SE3_frame(self, name: str) -> Pose | None:  # noqa: N802
        """Return what takes the points of a frame to the site; None where nothing says."""
        told = self._told.get(name, {})
        rows = told.get("dataset_SE3_site") or self.manifest.get("dataset_SE3_site")
        return None if rows is None else pose_of_matrix(rows).inverse()

    @cached_property
    def _told(self) -> dict[str, dict[str, Any]]:
        return {one["name"]: one for one in self.manifest["frames"]}

    @cached_property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``."""
        return read_parquet(self.folder / "boxes.parquet", _EXPECTED)

    @cached_property
    def _rows(self) -> dict[tuple[str, int], int]:
        frames, tracks = self.boxes["frame"].to_pylist(), self.boxes["track"].to_pylist()
        return {key: row for row, key in enumerate(zip(frames, tracks, strict=True))}

    @cached_property
    def _columns(self) -> dict[str, NDArray[Any]]:
        names = self.boxes.column_names
        wanted = ("num_points_alone", "truncation", "difficulty")
        return {
            name: self.boxes[name].to_numpy(zero_copy_only=False)
            for name in wanted
            if name in names
        }

    def complete(self, name: str, boxes: ShownBoxes) -> None:
        """Add to boxes of a frame what a `Frame` does not say of them."""
        if not (self.folder / "boxes.parquet").is_file():
            return
        try:
            rows = np.array([self._rows.get((name, int(one)), -1) for one in boxes.track], int)
            columns = {key: values[rows] for key, values in self._columns.items()}
            if "num_points_alone" in columns:
                boxes.alone = np.where(rows < 0, -1, columns["num_points_alone"].astype(np.int64))
            if "truncation" in columns:
                boxes.truncation = np.where(rows < 0, np.nan, columns["truncation"].astype(float))
            if "difficulty" in columns:
                boxes.difficulty = [str(one or "") for one in columns["difficulty"]]
        except (KeyError, ValueError, TypeError, pa.ArrowException):
            raise InputError(
                "has columns of other types", file=self.folder / "boxes.parquet", expected=_EXPECTED
            ) from None
