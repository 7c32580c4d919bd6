"""A dataset through all of its frames: who was there, where everybody went, and where it looked."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.table_form import frames_of, read_table
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.dataset.track_paths import TrackPaths

__all__ = ["DatasetSequence"]


class DatasetSequence:
    """The tables of a dataset that follow actors and sensors; see docs/sequences.md."""

    folder: Path
    manifest: dict[str, Any]

    if TYPE_CHECKING:  # what who has these fields brings

        @property
        def names(self) -> tuple[str, ...]: ...  # noqa: D102

        @property
        def times_s(self) -> NDArray[np.float64]: ...  # noqa: D102

        @property
        def boxes(self) -> pa.Table: ...  # noqa: D102

        @property
        def sweeps(self) -> pa.Table: ...  # noqa: D102

    @cached_property
    def tracks(self) -> pa.Table:
        """One row for each track: class, size, first and last frame, how well it was seen."""
        from urbantwin.dataset.tracklets import track_table

        return self._table("tracks.parquet") or track_table(self.tracklets, self.boxes)

    @cached_property
    def tracklets(self) -> pa.Table:
        """One row for each track and frame that labels it, by track: its box in the site."""
        from urbantwin.dataset.pose_table import frame_poses
        from urbantwin.dataset.tracklets import tracklet_table

        table = self._table("tracklets.parquet")
        return table or tracklet_table(self.boxes, frame_poses(self.manifest))

    @cached_property
    def trajectories(self) -> pa.Table:
        """One row for each track and step of the motion, also before and after the frames.

        Raises:
            InputError: the dataset is of a version that did not write them.
        """
        table = self._table("trajectories.parquet")
        if table is None:
            raise InputError(
                "has no trajectories.parquet: it is of a version that did not write it",
                file=self.folder,
                expected="`urbantwin sequence dataset/ --motion motion/`, which writes it, or "
                "`tracklets`, which have the frames alone",
            )
        return table

    @cached_property
    def poses(self) -> pa.Table:
        """One row for each frame and the ego, and for each turn of a sensor: where it was."""
        from urbantwin.dataset.pose_table import pose_table

        return self._table("poses.parquet") or pose_table(self.manifest, self.sweeps)

    @cached_property
    def lanes(self) -> pa.Table:
        """One row for each lane of the twin: its middle (lists ``x``, ``y``, ``z``) in the site.

        Raises:
            InputError: the twin had none, or the dataset is of a version that did not write them.
        """
        table = self._table("lanes.parquet")
        if table is None:
            raise InputError(
                "has no lanes.parquet: its twin has no streets, or its version did not write it",
                file=self.folder,
                expected="`lanes` of its twin",
            )
        return table

    @cached_property
    def paths(self) -> TrackPaths:
        """Where the body of a track is at any time: as it was driven, else from box to box."""
        from urbantwin.dataset.track_paths import paths_of_boxes
        from urbantwin.dataset.trajectories import paths_of_trajectories

        table = self._table("trajectories.parquet")
        if table is not None:
            return paths_of_trajectories(table)
        return paths_of_boxes(self.tracklets, self.times_s)

    @cached_property
    def box_range_m(self) -> NDArray[np.float64]:
        """How far (B,) the middle of each row of `boxes` is from the nearest sensor, in plan."""
        from urbantwin.dataset.box_range import box_ranges

        return box_ranges(self.boxes, self.sweeps, self.manifest)

    @cached_property
    def box_classes(self) -> tuple[str, ...]:
        """The classes that boxes may have."""
        from urbantwin.taxonomy import ACTOR_CLASSES

        own = self.manifest.get("class_names", [])
        return tuple(dict.fromkeys([*own, *ACTOR_CLASSES]))

    @cached_property
    def _rows_of_frames(self) -> dict[str, NDArray[np.int64]]:
        names, codes = frames_of(self.boxes)
        order = np.argsort(codes, kind="stable")
        cuts = np.flatnonzero(np.diff(codes[order])) + 1
        return {names[codes[own[0]]]: own for own in np.split(order, cuts) if len(own)}

    def box_rows(self, frame: str) -> NDArray[np.int64]:
        """Return the numbers of the rows of `boxes` that a frame has."""
        return self._rows_of_frames.get(frame, np.zeros(0, np.int64))

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Number of each frame by its name."""
        return {name: number for number, name in enumerate(self.names)}

    @cached_property
    def clock_ahead_s(self) -> dict[tuple[str, str], float]:
        """How far a sensor's clock is ahead, seconds, by frame and name of the sensor."""
        table = self.sweeps
        ahead = table["clock_start_s"].to_numpy() - table["start_s"].to_numpy()
        names = (table[name].to_pylist() for name in ("frame", "sensor"))
        return dict(zip(zip(*names, strict=True), ahead.tolist(), strict=True))

    def split(self, name: str) -> tuple[str, ...]:
        """Return the names of the frames of a split: those of ``ImageSets/NAME.txt``.

        Raises:
            InputError: there is no such split, or its file is damaged.
        """
        folder = self.folder / "ImageSets"
        there = sorted(path.stem for path in folder.glob("*.txt"))
        if name not in there:
            raise InputError(
                f"has no split {name!r}", file=self.folder, expected=", ".join(there) or "splits"
            )
        file = folder / f"{name}.txt"
        try:
            found = tuple(file.read_text(encoding="utf-8").split())
        except (OSError, UnicodeDecodeError):
            raise InputError("cannot be read", file=file, expected="names of frames") from None
        for number, one in enumerate(found, start=1):
            if one not in self.numbers:
                raise InputError(
                    f"names frame {one[:40]}, which is not there",
                    file=file,
                    place=f"line {number}",
                    expected="frames of the dataset",
                )
        return found

    def _table(self, name: str) -> pa.Table | None:
        """Return a table; ``None``: the dataset is of a version that did not write it."""
        path = self.folder / name
        return read_table(path) if path.is_file() else None
