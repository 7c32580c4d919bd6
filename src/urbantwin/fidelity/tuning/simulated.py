"""Frames of a rig as `record` makes them, in memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, frame_of_points
from urbantwin.lidar import PosedActor, Rig, Scanner
from urbantwin.lidar.timing import span_of
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["SimulatedFrames"]


class SimulatedFrames:
    """Frames of a rig in a twin, each made when it is asked for.

    Args:
        twin: the twin.
        rig: with the values of its knobs.
        points_in: the frame of the points.
        motion: the traffic; ``None``: the streets are empty.
        seed: of all random numbers.
    """

    def __init__(
        self, twin: Twin, rig: Rig, points_in: PointsIn, motion: Motion | None, seed: int
    ) -> None:
        self._rig = replace(
            rig, frame=points_in, dataset_SE3_site=frame_of_points(rig, points_in).inverse()
        )
        self._seed, self._motion = seed, motion
        self._scanner = Scanner(
            twin.mesh,
            self._rig,
            seed,
            meshes=None if motion is None else motion.mesh,
            surface=twin.surface_materials,
            region=twin.region,
        )
        self._motions = None if motion is None else FrameMotions(motion)
        #: How many frames the motion lasts; as many as one likes without one.
        self.count: int | None = None
        if motion is not None:
            self.count = 1 + int(motion.times()[-1] * rig.rate_hz + 1e-6)

    def frame(self, number: int) -> Frame:
        """Return a frame; beyond the motion's end it begins again."""
        actors: list[PosedActor] = []
        if self._motions is not None and self.count is not None:
            number %= self.count
            span = span_of(self._rig.sensors, number, self._seed)
            moving = self._motions.around(number / self._rig.rate_hz, *span)
            actors = posed_actors(moving.rows, moving.paths())
        found = self._scanner.scan(number, actors)
        places = np.array([one.site_SE3_sensor.translation for one in self._rig.sensors])
        return Frame(
            found.points[:, :3].astype(np.float64),
            found.points[:, 3].astype(np.float64),
            ring=found.ring.astype(np.int64),
            column=found.column.astype(np.int64),
            sensor=found.sensor.astype(np.int64),
            instance=found.instance.astype(np.int64),
            sensor_places=self._rig.dataset_SE3_site.apply(places),
            name=f"{number:06d}",
        )
