"""One labelled frame of a dataset: points, boxes, poses, flow and trajectories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.columns import POINT
from urbantwin.dataset.reading.frame_files import FrameFiles, ray_place
from urbantwin.dataset.reading.manifest import pose_of_matrix
from urbantwin.dataset.reading.tables import box_array
from urbantwin.errors import InputError

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from urbantwin.dataset.reading.dataset import Dataset
    from urbantwin.dataset.reading.objects import LabelledObjects
    from urbantwin.geometry import Pose

__all__ = ["Frame"]


@dataclass(frozen=True, eq=False)
class Frame:
    """One labelled frame of a dataset; arrays are read at first use.

    Attributes:
        dataset: the dataset.
        name: name of the frame, also of its files.
        time_s: seconds from the start of the motion.
        chosen: returns a mask of the dataset's boxes that a filter selects (`Dataset.where`).

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
        """Labels (N,) as in the file: class in the low 16 bits, track in the high."""
        return self._files.labels

    @cached_property
    def semantic(self) -> NDArray[np.uint16]:
        """Class id (N,) of each point; `Dataset.class_names` has the names."""
        return (self.labels & 0xFFFF).astype(np.uint16)

    @cached_property
    def instance(self) -> NDArray[np.uint16]:
        """Track (N,) of the actor of each point; 0 for the static world."""
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
        """Labelled boxes, one row each: the frame's selected rows of `Dataset.boxes`."""
        rows = self.dataset.box_rows(self.name)
        selected = None if self.chosen is None else self.chosen()
        return self.dataset.boxes.take(rows if selected is None else rows[selected[rows]])

    @cached_property
    def box_array(self) -> NDArray[np.float64]:
        """Boxes (B, 7): centre x, y, z, length, width, height in metres, yaw in radians."""
        return box_array(self.boxes)

    @cached_property
    def objects(self) -> LabelledObjects:
        """All labelled boxes of the frame as arrays, ignoring filters."""
        return self.dataset.objects.of_frame(self.name)

    @property
    def number(self) -> int:
        """Index of the frame in the dataset, from 0."""
        return self.dataset.numbers[self.name]

    @cached_property
    def site_SE3_dataset(self) -> Pose:  # noqa: N802
        """Pose of the frame of the points in the site.

        Raises:
            InputError: the manifest lacks it.
        """
        manifest = self.dataset.manifest
        entry = manifest["frames"][self.number]
        rows = entry.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
        if rows is None:
            raise InputError(
                "does not say where the points are",
                file=self.dataset.folder / "dataset.json",
                place=f"frames: {self.name}",
                expected="dataset_SE3_site",
            )
        return pose_of_matrix(rows).inverse()

    @property
    def xyz(self) -> NDArray[np.float32]:
        """Positions (N, 3) of the points, metres."""
        return self.points[:, :3]

    @property
    def x(self) -> NDArray[np.float32]:
        """X (N,) of each point, metres."""
        return self.points[:, 0]

    @property
    def y(self) -> NDArray[np.float32]:
        """Y (N,) of each point, metres."""
        return self.points[:, 1]

    @property
    def z(self) -> NDArray[np.float32]:
        """Z (N,) of each point, metres."""
        return self.points[:, 2]

    @property
    def intensity(self) -> NDArray[np.float32]:
        """Intensity (N,) of each point, 0..1."""
        return self.points[:, 3]

    @property
    def sensor(self) -> NDArray[np.uint8]:
        """Index (N,) of the sensor in the rig."""
        return self._of_rays("sensor")

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Channel (N,) of each point, in the maker's numbering."""
        return self._of_rays("ring")

    @property
    def column(self) -> NDArray[np.uint16]:
        """Firing (N,) of each point within the turn."""
        return self._of_rays("column")

    @property
    def time(self) -> NDArray[np.float32]:
        """Time (N,) of each point by its sensor's clock, seconds relative to the frame's."""
        return self._of_rays("time")

    @property
    def echo(self) -> NDArray[np.uint8]:
        """Number (N,) of each point's return within its beam: 0, the first reported, or 1."""
        return self._of_rays("echo")

    @cached_property
    def cloud(self) -> NDArray[np.void]:
        """All point data (N,) as a structured array: ``cloud["ring"]``, ``cloud[cloud["x"] > 3]``.

        Fields are ``x``, ``y``, ``z``, ``intensity``, those of the rays (``sensor``, ``ring``,
        ``column``, ``time``, ``echo``; datasets of older versions lack some), ``semantic`` and
        ``instance``.
        """
        rays = self.rays
        kinds: list[tuple[str, Any]] = [(name, "<f4") for name in POINT]
        kinds += [(name, rays.dtype[name]) for name in rays.dtype.names or ()]
        kinds += [("semantic", "<u2"), ("instance", "<u2")]
        cloud = np.empty(len(self.points), kinds)
        for axis, name in enumerate(POINT):
            cloud[name] = self.points[:, axis]
        for name in rays.dtype.names or ():
            cloud[name] = rays[name]
        cloud["semantic"], cloud["instance"] = self.semantic, self.instance
        return cloud

    def rays_of(self, *fields: str, sensors: int = 256) -> NDArray[np.void]:
        """Return the ray (N,) of each point, validated.

        Args:
            fields: required fields.
            sensors: number of sensors of the rig.

        Raises:
            InputError: a field is missing, or a sensor's index is out of range.
        """
        file = self._files.rays_file
        for name in fields:
            if name not in (self.rays.dtype.names or ()):
                raise InputError(
                    f"does not say the {name} of its points",
                    file=file,
                    expected="rays as they are recorded now; this dataset is of an older version",
                )
        if "sensor" in fields and len(self.rays) and int(self.rays["sensor"].max()) >= sensors:
            row = int(np.argmax(self.rays["sensor"]))
            place = ray_place(file, self.rays, "sensor", row) if self._files.is_plain else None
            raise InputError(
                "names a sensor that is not there",
                file=file,
                place=place,
                expected=f"numbers below {sensors}",
            )
        return self.rays

    def _of_rays(self, name: str) -> NDArray[Any]:
        return self.rays_of(name)[name]

    @property
    def next(self) -> Frame | None:
        """The next frame of the dataset; ``None`` for the last one."""
        number = self.number + 1
        return self.dataset[number] if number < len(self.dataset.names) else None

    @property
    def on_boxes(self) -> NDArray[np.bool_]:
        """Which points (N,) are on an actor whose box is in `boxes`."""
        tracks = self.boxes["track"].to_numpy()
        return np.isin(self.instance, tracks[tracks > 0])

    def measured_s(self) -> NDArray[np.float64]:
        """Return the true time of each point (N,), seconds from the motion's start."""
        ahead = np.zeros(256)
        for number, entry in enumerate(self.dataset.manifest["rig"]["sensors"]):
            key = (self.name, entry["name"])
            ahead[entry.get("number", number)] = self.dataset.clock_ahead_s.get(key, 0.0)
        return self.time_s + self.time.astype(np.float64) - ahead[self.sensor]

    def flow(self, *, ego: bool = False) -> NDArray[np.float32]:
        """Return the scene flow (N, 3) of each point to the next frame, metres.

        A point moves rigidly with its actor, from the actor's pose when the point was measured to
        its box in the next frame; the static world does not move. ``nan`` where unknown: points
        beside actors (class ``outlier``), on an actor that is not in the next frame, and all points
        of the last frame. See docs/reference/labels.md.

        Args:
            ego: include the sensor's own motion: the flow is from a point's coordinates in this
                frame to those in the next one (Argoverse 2); otherwise both are in this frame's
                coordinates (Waymo). For a fixed rig they are the same.
        """
        from urbantwin.dataset.point_flow import flow_of

        following = self.next
        if following is None:
            return np.full((len(self.points), 3), np.nan, np.float32)
        rows = self.dataset.boxes.take(self.dataset.box_rows(following.name))
        seen_s = following.time_s + rows["observed_s"].to_numpy()
        return flow_of(
            self.points[:, :3],
            self.semantic,
            self.instance,
            self.measured_s(),
            self.dataset.paths,
            dict(zip(rows["track"].to_pylist(), seen_s.tolist(), strict=True)),
            self.site_SE3_dataset,
            following.site_SE3_dataset.inverse() if ego else None,
        )

    def trajectories(self, past: float = 2.0, future: float = 6.0) -> pa.Table:
        """Return the trajectories of the actors of `boxes` before and after this frame.

        Args:
            past: seconds before the frame.
            future: seconds after it.

        Returns:
            The rows of `Dataset.trajectories` between these times, by time, then track.

        Raises:
            InputError: a time is negative, or the dataset's version has no trajectories.
        """
        import pyarrow as pa

        for name, value in (("past", past), ("future", future)):
            if not value >= 0:
                raise InputError(f"is {value}", place=name, expected="seconds, 0 or more")
        table = self.dataset.trajectories
        times = table["time_s"].to_numpy()
        first = int(np.searchsorted(times, self.time_s - past - 1e-6))
        last = int(np.searchsorted(times, self.time_s + future + 1e-6, side="right"))
        some = table.slice(first, last - first)
        of_boxes = np.isin(some["track"].to_numpy(), self.boxes["track"].to_numpy())
        return some.filter(pa.array(of_boxes))

    @property
    def site_SE3_ego(self) -> Pose:  # noqa: N802
        """Pose of the vehicle that carries the sensors; for a fixed rig, `site_SE3_dataset`.

        The true pose at the start of the first turn in the frame.
        """
        from urbantwin.dataset.pose_table import EGO

        return self._pose(EGO, reported=False)

    def site_SE3_sensor(  # noqa: N802
        self, sensor: str | None = None, *, reported: bool = False
    ) -> Pose:
        """Return the pose of a sensor at the start of its first turn in the frame.

        Args:
            sensor: its name in the rig; the first one if not given.
            reported: the reported pose, with which points are computed, rather than the true one.

        Raises:
            InputError: no such sensor in this frame.
        """
        names = [entry["name"] for entry in self.dataset.manifest["rig"]["sensors"]]
        name = names[0] if sensor is None else sensor
        if name not in names:
            raise InputError(
                f"there is no sensor {name!r}", file=self.dataset.folder, expected=", ".join(names)
            )
        return self._pose(name, reported=reported)

    @cached_property
    def site_SE3_sensors(self) -> dict[str, Pose]:  # noqa: N802
        """Reported pose of every sensor at its first turn, by name; without a turn, at rest."""
        poses = self.dataset.turns.first_poses(self.name, "reported")
        for entry in self.dataset.manifest["rig"]["sensors"]:
            if entry["name"] not in poses:
                poses[entry["name"]] = pose_of_matrix(entry["site_SE3_sensor"])
        return poses

    def _pose(self, name: str, *, reported: bool) -> Pose:
        import pyarrow.compute as pc

        from urbantwin.dataset.pose_table import true_and_reported

        table = self.dataset.poses
        selected = pc.and_(pc.equal(table["frame"], self.name), pc.equal(table["name"], name))
        rows = table.filter(selected).slice(0, 1).to_pylist()
        if not rows:
            raise InputError(
                f"has no pose of {name}",
                file=self.dataset.folder,
                place=f"frame {self.name}",
                expected="a sensor that took a turn in the frame",
            )
        return true_and_reported(rows[0])[reported]

    def __repr__(self) -> str:
        """Return name, time and counts."""
        return (
            f"Frame {self.name} at {self.time_s:g} s: {len(self.points):,} points, "
            f"{self.boxes.num_rows} boxes"
        )

    def plot(self, picture: str = "birdseye") -> Figure:
        """Draw the frame; see `Dataset.plot`."""
        return self.dataset.plot(self.name, picture)
