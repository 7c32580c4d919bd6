"""A frame among the others: what its points do next, where it was seen from, past and future."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.interface.point_fields import PointFields

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.geometry import Pose
    from urbantwin.interface.dataset import Frame

__all__ = ["FrameSequence"]


class FrameSequence(PointFields):
    """What a frame knows by the other frames of its dataset."""

    time_s: float

    if TYPE_CHECKING:  # what who has these fields brings

        @property
        def boxes(self) -> pa.Table: ...  # noqa: D102

        @property
        def site_SE3_dataset(self) -> Pose: ...  # noqa: D102, N802

    @property
    def next(self) -> Frame | None:
        """The frame after it in the dataset; ``None`` of the last one."""
        number = self.dataset.numbers[self.name] + 1
        return self.dataset[number] if number < len(self.dataset.names) else None

    @property
    def on_boxes(self) -> NDArray[np.bool_]:
        """Which points (N,) are on an actor whose box is in `boxes`."""
        tracks = self.boxes["track"].to_numpy()
        return np.isin(self.instance, tracks[tracks > 0])

    def measured_s(self) -> NDArray[np.float64]:
        """Return when each point (N,) was measured, true, seconds from the motion's start."""
        ahead = np.zeros(256)
        for number, one in enumerate(self.dataset.manifest["rig"]["sensors"]):
            key = (self.name, one["name"])
            ahead[one.get("number", number)] = self.dataset.clock_ahead_s.get(key, 0.0)
        return self.time_s + self.time.astype(np.float64) - ahead[self.sensor]

    def flow(self, *, ego: bool = False) -> NDArray[np.float32]:
        """Return where each point (N, 3) goes until the next frame sees it, metres.

        A point goes with the body that it is on, rigidly, from where the body was when the point
        was measured to where the next frame's box has it; the static world stays. It is ``nan``
        where nobody knows it: of points beside actors (class ``outlier``), of an actor that is not
        in the next frame, and of all points of the last frame. See docs/sequences.md.

        Args:
            ego: with the motion of who looks: the flow goes from where a point is in this frame's
                coordinates to where it will be in the next one's (Argoverse 2). Without it, both
                are in this frame's (Waymo). Of a rig that stands, they are the same.
        """
        from urbantwin.dataset.point_flow import flow_of

        then = self.next
        if then is None:
            return np.full((len(self.points), 3), np.nan, np.float32)
        rows = self.dataset.boxes.take(self.dataset.box_rows(then.name))
        seen_s = then.time_s + rows["observed_s"].to_numpy()
        return flow_of(
            self.points[:, :3],
            self.semantic,
            self.instance,
            self.measured_s(),
            self.dataset.paths,
            dict(zip(rows["track"].to_pylist(), seen_s.tolist(), strict=True)),
            self.site_SE3_dataset,
            then.site_SE3_dataset.inverse() if ego else None,
        )

    def trajectories(self, past: float = 2.0, future: float = 6.0) -> pa.Table:
        """Return where the actors of `boxes` were before this frame and will be after it.

        Args:
            past: seconds before the frame.
            future: seconds after it.

        Returns:
            The rows of `Dataset.trajectories` between these times, by time, then track.

        Raises:
            InputError: a time is negative, or the dataset is of a version without trajectories.
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
        mine = np.isin(some["track"].to_numpy(), self.boxes["track"].to_numpy())
        return some.filter(pa.array(mine))

    @property
    def site_SE3_ego(self) -> Pose:  # noqa: N802
        """Where the vehicle was that carries the sensors; of a rig that stands, `site_SE3_dataset`.

        It is the true pose at the beginning of the first turn in the frame.
        """
        from urbantwin.dataset.pose_table import EGO

        return self._pose(EGO, reported=False)

    def site_SE3_sensor(  # noqa: N802
        self, sensor: str | None = None, *, reported: bool = False
    ) -> Pose:
        """Return where a sensor was at the beginning of its first turn in the frame.

        Args:
            sensor: its name in the rig; the first one if not given.
            reported: where points were computed from, as far as the sensor knew; else where it was.

        Raises:
            InputError: there is no such sensor in this frame.
        """
        names = [one["name"] for one in self.dataset.manifest["rig"]["sensors"]]
        name = names[0] if sensor is None else sensor
        if name not in names:
            raise InputError(
                f"there is no sensor {name!r}", file=self.dataset.folder, expected=", ".join(names)
            )
        return self._pose(name, reported=reported)

    def _pose(self, name: str, *, reported: bool) -> Pose:
        import pyarrow.compute as pc

        from urbantwin.dataset.pose_table import true_and_reported

        table = self.dataset.poses
        mine = pc.and_(pc.equal(table["frame"], self.name), pc.equal(table["name"], name))
        rows = table.filter(mine).slice(0, 1).to_pylist()
        if not rows:
            raise InputError(
                f"has no pose of {name}",
                file=self.dataset.folder,
                place=f"frame {self.name}",
                expected="a sensor that took a turn in the frame",
            )
        return true_and_reported(rows[0])[reported]
