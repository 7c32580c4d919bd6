"""A dataset on disk, and its frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.frame_files import FrameFiles
from urbantwin.dataset.manifest_schema import pose_of_matrix, read_manifest
from urbantwin.dataset.table_form import read_table
from urbantwin.errors import InputError
from urbantwin.interface.dataset_sequence import DatasetSequence
from urbantwin.interface.frame_sequence import FrameSequence
from urbantwin.interface.outcome import outcome_of_dataset
from urbantwin.interface.place import AnyPath
from urbantwin.interface.selection import Frames, Located
from urbantwin.interface.summary import Summary
from urbantwin.result_warning import ResultWarning, warnings_of

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from urbantwin.geometry import Pose

__all__ = ["Dataset", "Frame"]

_BOX = ("x", "y", "z", "length", "width", "height", "yaw")


@dataclass(frozen=True, eq=False)
class Frame(FrameSequence):
    """One labelled frame of a dataset; each array is read when it is first asked for.

    Attributes:
        dataset: that it is of.
        name: of the frame, which its files have.
        time_s: seconds from the start of the motion.
        chosen: tells which rows of the dataset's boxes somebody asked for (`Dataset.where`).

    Example:
        >>> frame = dataset[3]
        >>> frame.points[frame.instance > 0]  # those on actors
    """

    dataset: Dataset
    name: str
    time_s: float
    chosen: Callable[[], NDArray[np.bool_] | None] | None = None

    @cached_property
    def points(self) -> NDArray[np.float32]:
        """Points (N, 4): x, y, z in metres, dataset frame, and intensity 0..1."""
        return self._files.points

    @cached_property
    def labels(self) -> NDArray[np.uint32]:
        """Labels (N,) as they are in the file: class in the low 16 bits, track in the high."""
        return self._files.labels

    @cached_property
    def semantic(self) -> NDArray[np.uint16]:
        """Number (N,) of each point's class; `Dataset.class_names` has their names."""
        return (self.labels & 0xFFFF).astype(np.uint16)

    @cached_property
    def instance(self) -> NDArray[np.uint16]:
        """Track (N,) of the actor that each point is on; 0 for the static world."""
        return (self.labels >> 16).astype(np.uint16)

    @cached_property
    def rays(self) -> NDArray[np.void]:
        """The ray (N,) of each point: ``sensor``, ``ring``, ``column``, ``time``, ``echo``."""
        return self._files.rays

    @cached_property
    def _files(self) -> FrameFiles:
        return FrameFiles(self.dataset.folder, self.name)

    @cached_property
    def boxes(self) -> pa.Table:
        """Labelled boxes, one row each: the frame's rows of `Dataset.boxes` that were asked for."""
        rows = self.dataset.box_rows(self.name)
        kept = None if self.chosen is None else self.chosen()
        return self.dataset.boxes.take(rows if kept is None else rows[kept[rows]])

    @cached_property
    def box_array(self) -> NDArray[np.float64]:
        """Boxes (B, 7): centre x, y, z, length, width, height in metres, yaw in radians."""
        return np.column_stack([self.boxes[name].to_numpy() for name in _BOX]).reshape(-1, 7)

    @cached_property
    def site_SE3_dataset(self) -> Pose:  # noqa: N802
        """The pose that takes the frame's points to the site."""
        manifest = self.dataset.manifest
        told = manifest["frames"][self.dataset.numbers[self.name]]
        rows = told.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
        return pose_of_matrix(rows).inverse()

    def __repr__(self) -> str:
        """Return name, time and counts."""
        return (
            f"Frame {self.name} at {self.time_s:g} s: {len(self.points):,} points, "
            f"{self.boxes.num_rows} boxes"
        )

    def plot(self, picture: str = "birdseye") -> Figure:
        """Draw the frame; see `Dataset.plot`."""
        return self.dataset.plot(self.name, picture)


class Dataset(DatasetSequence, Frames):
    """A dataset on disk: its frames in the order of time.

    It stands for its folder wherever a path is asked for. A rig whose sensors are not fused leaves
    a dataset for each sensor, which `parts` has; the dataset itself then has no frames.

    Attributes:
        folder: where it is.
        manifest: ``dataset.json``.

    Example:
        >>> dataset = ut.open("out/dataset")
        >>> dataset[0].points.shape, dataset.boxes.num_rows
        >>> dataset.plot(3).savefig("frame.png")
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_manifest(self.folder)

    @classmethod
    def open(cls, folder: AnyPath) -> Dataset:
        """Open a dataset's folder.

        Raises:
            InputError: it is not a dataset, or its manifest is damaged.
        """
        return cls(folder)

    @cached_property
    def parts(self) -> dict[str, Dataset]:
        """The dataset of each sensor by its name; empty where the sensors are fused."""
        names: list[str] = self.manifest.get("datasets", [])
        return {name: Dataset(self.folder / name) for name in names}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return tuple(one["name"] for one in self._frames)

    @cached_property
    def times_s(self) -> NDArray[np.float64]:
        """Times (F,) of the frames, seconds from the start of the motion."""
        return np.array([one["time_s"] for one in self._frames], np.float64)

    @cached_property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``: one row for each frame and box; see docs/labels.md for its columns."""
        return read_table(self._own("boxes.parquet"))

    @cached_property
    def sweeps(self) -> pa.Table:
        """``sweeps.parquet``: one row for each turn of a sensor."""
        return read_table(self._own("sweeps.parquet"))

    @cached_property
    def class_names(self) -> dict[int, str]:
        """Name of each number in `Frame.semantic`."""
        from urbantwin.taxonomy import semantic_classes

        return {one.id: one.name for one in semantic_classes().values()}

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """What is wrong with it, and with the dataset of each sensor."""
        of_parts = (one for part in self.parts.values() for one in part.warnings)
        return (*warnings_of(self.manifest), *of_parts)

    @property
    def _frames(self) -> list[dict[str, Any]]:
        frames: list[dict[str, Any]] = self.manifest.get("frames", [])
        return frames

    def _own(self, name: str) -> Path:
        if self.parts:
            raise InputError(
                "holds a dataset for each sensor",
                file=self.folder,
                expected=f"one of them: .parts[{next(iter(self.parts))!r}]",
            )
        return self.folder / name

    @property
    def datasets(self) -> tuple[Dataset, ...]:
        """Itself: see `Frames`."""
        return (self,)

    @cached_property
    def _located(self) -> list[Located]:
        self._own("")
        name = self.folder.resolve().name
        return [(self, name, number) for number in range(len(self._frames))]

    def __len__(self) -> int:
        """Return how many frames there are."""
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
            f"{one['name']} ({one['model']})" for one in self.manifest["rig"]["sensors"]
        )
        return (
            f"Dataset of {len(self)} frames from {self.times_s[0]:g} to {self.times_s[-1]:g} s: "
            f"{counts['points']:,} points, {sum(counts['boxes'].values()):,} boxes, by {sensors} "
            f"({self.folder})"
        )

    def summary(self) -> Summary:
        """Return what the dataset holds in a few values."""
        from urbantwin.dataset.description import describe

        told = [str(one) for one in self.warnings]
        return Summary(
            path=str(self.folder),
            **describe(self.folder),
            **outcome_of_dataset(self),
            warnings=told,
        )

    def plot(self, frame: int | str | None = None, picture: str = "birdseye") -> Figure:
        """Draw a frame, or how many points and boxes of each class there are.

        Args:
            frame: its number or its name; the one with the most labelled actors when not given.
            picture: ``birdseye``, from above with boxes; ``range_image``, as the sensor in the
                middle of the frame's points saw it; or ``histogram``, of all frames.

        Raises:
            InputError: there is no such frame or picture.
        """
        from urbantwin.view.pictures import figure_of_dataset

        self._own("")
        name = frame if frame is None or isinstance(frame, str) else self[frame].name
        return figure_of_dataset(self.folder, name, picture)
