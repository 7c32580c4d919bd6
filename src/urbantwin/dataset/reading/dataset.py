"""A dataset on disk: its frames in order of time, and the tables of its actors and sensors."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.pose_table import frame_poses, pose_of_frame
from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.dataset.reading.selection import Frames, Located
from urbantwin.dataset.reading.tables import read_table, rows_by_frame
from urbantwin.dataset.reading.turns import SensorTurns
from urbantwin.dataset.split import image_sets
from urbantwin.errors import InputError
from urbantwin.result_warning import ResultWarning, warnings_of

if TYPE_CHECKING:
    import os

    import pyarrow as pa
    from matplotlib.figure import Figure

    from urbantwin.dataset.track_paths import TrackPaths

__all__ = ["Dataset"]


class Dataset(Frames):
    """A dataset on disk; `urbantwin.Dataset` adds a summary and pictures.

    Attributes:
        folder: its folder.
        manifest: content of ``dataset.json``.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_manifest(self.folder)

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Self:
        """Open a dataset's folder.

        Raises:
            InputError: not a dataset, or its manifest is damaged.
        """
        return cls(folder)

    @cached_property
    def parts(self) -> dict[str, Self]:
        """Dataset of each sensor by name; empty if the sensors are fused."""
        names: list[str] = self.manifest.get("datasets", [])
        return {name: type(self)(self.folder / name) for name in names}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(entry["name"] for entry in self._frames)

    @cached_property
    def times_s(self) -> NDArray[np.float64]:
        """Times (F,) of the frames, seconds from the start of the motion."""
        return np.array([entry["time_s"] for entry in self._frames], np.float64)

    @cached_property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``: one row per frame and box; columns in docs/reference/labels.md."""
        self.check_single()
        return read_table(self.folder / "boxes.parquet")

    @cached_property
    def sweeps(self) -> pa.Table:
        """``sweeps.parquet``: one row per turn of a sensor."""
        self.check_single()
        return read_table(self.folder / "sweeps.parquet")

    @cached_property
    def objects(self) -> LabelledObjects:
        """The rows of `boxes` as arrays.

        Raises:
            InputError: the table is damaged.
        """
        return LabelledObjects.of_table(self.boxes, self.folder)

    @cached_property
    def turns(self) -> SensorTurns:
        """The rows of `sweeps` as arrays."""
        return SensorTurns.of_table(self.sweeps, self.folder)

    @cached_property
    def class_names(self) -> dict[int, str]:
        """Class name of each value of `Frame.semantic`."""
        from urbantwin.taxonomy import semantic_classes

        return {entry.id: entry.name for entry in semantic_classes().values()}

    @cached_property
    def tracks(self) -> pa.Table:
        """One row per track: class, size, first and last frame, visibility."""
        from urbantwin.dataset.tracklets import track_table

        return self._table("tracks.parquet") or track_table(self.tracklets, self.boxes)

    @cached_property
    def tracklets(self) -> pa.Table:
        """One row per track and labelled frame, by track: its box in the site."""
        from urbantwin.dataset.pose_table import frame_poses
        from urbantwin.dataset.tracklets import tracklet_table

        table = self._table("tracklets.parquet")
        return table or tracklet_table(self.boxes, frame_poses(self.manifest))

    @cached_property
    def trajectories(self) -> pa.Table:
        """One row per track and step of the motion, also before and after the frames.

        Raises:
            InputError: the dataset's version did not write them.
        """
        table = self._table("trajectories.parquet")
        if table is None:
            raise InputError(
                "has no trajectories.parquet: it is of a version that did not write it",
                file=self.folder,
                expected="`urbantwin dataset sequence dataset/ --motion motion/`, which writes it, "
                "or `tracklets`, which have the frames alone",
            )
        return table

    @cached_property
    def poses(self) -> pa.Table:
        """One row per frame for the ego, and one per turn of a sensor: poses."""
        from urbantwin.dataset.pose_table import pose_table

        return self._table("poses.parquet") or pose_table(self.manifest, self.sweeps)

    @cached_property
    def lanes(self) -> pa.Table:
        """One row per lane of the twin: its centre line (lists ``x``, ``y``, ``z``) in the site.

        Raises:
            InputError: the twin had none, or the dataset's version did not write them.
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
        """Poses of the tracks at any time: from trajectories, else interpolated between boxes."""
        from urbantwin.dataset.track_paths import paths_of_boxes
        from urbantwin.dataset.trajectories import paths_of_trajectories

        table = self._table("trajectories.parquet")
        if table is not None:
            return paths_of_trajectories(table)
        return paths_of_boxes(self.tracklets, self.times_s)

    @cached_property
    def box_range_m(self) -> NDArray[np.float64]:
        """Horizontal distance (B,) from the centre of each row of `boxes` to the nearest sensor."""
        poses = frame_poses(self.manifest)
        is_mounted = self.manifest["dataset_SE3_site"] is None
        fixed = [
            rows_of_pose["site_SE3_sensor"] for rows_of_pose in self.manifest["rig"]["sensors"]
        ]
        sensors = np.array([pose_of_matrix(rows_of_pose).translation for rows_of_pose in fixed])
        range_m = np.zeros(len(self.objects))
        for name in self.objects.frame_names:
            rows, pose = self.objects.rows_of(name), pose_of_frame(poses, name)
            if is_mounted:
                turns = self.turns.of_frame(name)
                sensors = self.turns.reported[turns, :3] if len(turns) else pose.translation[None]
            away = pose.apply(self.objects.box[rows, :3])[:, None, :2] - sensors[None, :, :2]
            range_m[rows] = np.linalg.norm(away, axis=2).min(axis=1)
        return range_m

    @cached_property
    def box_classes(self) -> tuple[str, ...]:
        """Classes that boxes may have."""
        from urbantwin.taxonomy import ACTOR_CLASSES

        own = self.manifest.get("class_names", [])
        return tuple(dict.fromkeys([*own, *ACTOR_CLASSES]))

    @cached_property
    def _rows_of_frames(self) -> dict[str, NDArray[np.int64]]:
        return rows_by_frame(self.boxes)

    def box_rows(self, frame: str) -> NDArray[np.int64]:
        """Return the row numbers of a frame in `boxes`."""
        return self._rows_of_frames.get(frame, np.zeros(0, np.int64))

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Index of each frame by name."""
        return {name: number for number, name in enumerate(self.names)}

    @cached_property
    def clock_ahead_s(self) -> dict[tuple[str, str], float]:
        """Offset of a sensor's clock from true time, seconds, by frame and name of the sensor."""
        table = self.sweeps
        ahead = table["clock_start_s"].to_numpy() - table["start_s"].to_numpy()
        names = (table[name].to_pylist() for name in ("frame", "sensor"))
        return dict(zip(zip(*names, strict=True), ahead.tolist(), strict=True))

    @cached_property
    def splits(self) -> dict[str, tuple[str, ...]]:
        """Names of the frames of each split: ``train``, ``val``, ``test``, and others by name.

        Raises:
            InputError: a list is damaged, or names a missing frame.
        """
        lists = image_sets(self.folder)
        for part, names in lists.items():
            for number, frame in enumerate(names, start=1):
                if frame not in self.numbers:
                    raise InputError(
                        f"names frame {frame[:40]}, which is not there",
                        file=self.folder / "ImageSets" / f"{part}.txt",
                        place=f"line {number}",
                        expected="frames of the dataset",
                    )
        return {part: tuple(names) for part, names in sorted(lists.items())}

    def split(self, name: str) -> tuple[str, ...]:
        """Return the names of the frames of a split, from ``ImageSets/NAME.txt``.

        Raises:
            InputError: no such split, or a damaged list.
        """
        if name not in self.splits:
            available = ", ".join(self.splits) or "splits"
            raise InputError(f"has no split {name!r}", file=self.folder, expected=available)
        return self.splits[name]

    def _table(self, name: str) -> pa.Table | None:
        """Return a table; ``None`` if the dataset's version did not write it."""
        path = self.folder / name
        return read_table(path) if path.is_file() else None

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings of the dataset, and of the dataset of each sensor."""
        of_parts = (warning for part in self.parts.values() for warning in part.warnings)
        return (*warnings_of(self.manifest), *of_parts)

    @property
    def _frames(self) -> list[dict[str, Any]]:
        frames: list[dict[str, Any]] = self.manifest.get("frames", [])
        return frames

    def check_single(self) -> None:
        """Raise an error for a folder with one dataset per sensor.

        Raises:
            InputError: it is such a folder.
        """
        if self.parts:
            raise InputError(
                "holds a dataset for each sensor",
                file=self.folder,
                expected=f"one of them: .parts[{next(iter(self.parts))!r}]",
            )

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """The dataset itself: see `Frames`."""
        return (self,)

    @cached_property
    def _located(self) -> list[Located]:
        self.check_single()
        name = self.folder.resolve().name
        return [(self, name, number) for number in range(len(self._frames))]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return counts, times, sensors and folder."""
        if self.parts:
            return f"Dataset for each of {', '.join(self.parts)} ({self.folder})"
        counts = self.manifest["counts"]
        sensors = ", ".join(
            f"{entry['name']} ({entry['model']})" for entry in self.manifest["rig"]["sensors"]
        )
        return (
            f"Dataset of {len(self)} frames from {self.times_s[0]:g} to {self.times_s[-1]:g} s: "
            f"{counts['points']:,} points, {sum(counts['boxes'].values()):,} boxes, by {sensors} "
            f"({self.folder})"
        )

    def plot(self, frame: int | str | None = None, picture: str = "birdseye") -> Figure:
        """Draw a frame, or the number of points and boxes per class.

        Drawing is defined in `urbantwin.interface.dataset`: `urbantwin.open` returns datasets that
        can be drawn.

        Args:
            frame: index or name of the frame; by default the frame with the most labelled actors.
            picture: ``birdseye``, top view with boxes; ``range_image``, view of the sensor nearest
                to the centre of the points; or ``histogram``, of all frames.

        Raises:
            InputError: no such frame or picture.
        """
        raise NotImplementedError
