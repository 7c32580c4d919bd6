"""A rig with changed parameter values: in memory, as a file, and its simulated frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.fidelity.alignment import write_aligned_rig
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.tuning.knobs import Values
from urbantwin.geometry import Pose, ypr_from_rotation
from urbantwin.lidar import PosedActor, Rig, Scanner
from urbantwin.lidar.rig import MountedSensor, dataset_frame
from urbantwin.lidar.timing import span_of
from urbantwin.site.rig import Calibration
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["PointsIn", "SimulatedFrames", "frame_of_points", "tuned_rig", "write_tuned_rig"]

#: Frame of the real points, see ``frame:`` of a rig.
PointsIn = Literal["sensor", "level", "site"]
_MOVES = ("east_m", "north_m", "up_m", "yaw_deg", "pitch_deg", "roll_deg")


def frame_of_points(rig: Rig, points_in: PointsIn) -> Pose:
    """Return ``site_SE3_points`` of real points in the frame of a rig."""
    return dataset_frame(points_in, rig.sensors[0].site_SE3_sensor)


def tuned_rig(rig: Rig, values: Values) -> Rig:
    """Return a rig with changed parameter values; values not given are unchanged.

    ``move.*`` moves the first sensor along the axes of the site and adds to its yaw, pitch and
    roll; the other sensors move with it.
    """
    sensors = [_calibrated(one, values) for one in rig.sensors]
    moves = np.array([values.get(f"move.{name}", 0.0) for name in _MOVES])
    if moves.any():
        before = rig.sensors[0].site_SE3_sensor
        angles = np.array(ypr_from_rotation(before.rotation)) + np.radians(moves[3:])
        move = Pose.from_ypr(before.translation + moves[:3], *angles) @ before.inverse()
        sensors = [
            replace(one, site_SE3_sensor=move @ one.site_SE3_sensor) if number else one
            for number, one in enumerate(sensors)
        ]
        sensors[0] = replace(
            sensors[0], site_SE3_sensor=Pose.from_ypr(before.translation + moves[:3], *angles)
        )
    return replace(
        rig,
        sensors=tuple(sensors),
        dataset_SE3_site=dataset_frame(rig.frame, sensors[0].site_SE3_sensor).inverse(),
    )


def _calibrated(one: MountedSensor, values: Values) -> MountedSensor:
    own = f"sensors.{one.name}.calibration."
    fitted = {k.removeprefix(own): v for k, v in values.items() if k.startswith(own)}
    bright = _reflectivity(values)
    if not fitted and not bright:
        return one
    unit = one.calibration.model_dump() | fitted
    return replace(
        one,
        calibration=Calibration.model_validate(unit),
        reflectivity={**one.reflectivity, **bright},
    )


def _reflectivity(values: Values) -> dict[str, float]:
    head = "reflectivity."
    return {name.removeprefix(head): v for name, v in values.items() if name.startswith(head)}


def write_tuned_rig(source: Path, target: Path, rig: Rig, values: Values) -> None:
    """Write a rig's file with changed parameter values; all else is unchanged.

    Args:
        source: the rig's file, valid.
        target: the file to write.
        rig: the rig of ``source``.
        values: parameter values; without ``move.*``, positions stay as written.
    """
    found = tuned_rig(rig, values)
    if any(values.get(f"move.{name}", 0.0) for name in _MOVES):
        write_aligned_rig(source, target, [one.site_SE3_sensor for one in found.sensors])
        source = target
    document: dict[str, Any] = yaml.safe_load(source.read_text(encoding="utf-8"))
    for entry, one in zip(document["sensors"], rig.sensors, strict=True):
        own = f"sensors.{one.name}.calibration."
        fitted = {
            name.removeprefix(own): round(value, 6)
            for name, value in values.items()
            if name.startswith(own)
        }
        _update(entry, "calibration", fitted)
    _update(document, "reflectivity", {k: round(v, 6) for k, v in _reflectivity(values).items()})
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True)
    target.write_text(text, encoding="utf-8")


def _update(document: dict[str, Any], name: str, values: Mapping[str, float]) -> None:
    if values:
        document[name] = {**(document.get(name) or {}), **values}


class SimulatedFrames:
    """Frames of a rig in a twin, simulated on request.

    Args:
        twin: the twin.
        rig: the rig with its parameter values.
        points_in: frame of the points.
        motion: the traffic; ``None``: empty streets.
        seed: seed of all random numbers.
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
        #: Number of frames of the motion; None without a motion: unlimited.
        self.count: int | None = None
        if motion is not None:
            self.count = 1 + int(motion.times()[-1] * rig.rate_hz + 1e-6)

    def frame(self, number: int) -> Frame:
        """Return a frame; beyond the motion's end it starts again."""
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
