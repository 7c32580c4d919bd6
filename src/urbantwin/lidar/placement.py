"""Placement of a rig on its site: every sensor with its beams and its pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.lidar.enclosure import enclosing
from urbantwin.lidar.rig import MountedSensor, Rig, dataset_frame
from urbantwin.lidar.sensor_options import (
    check_models,
    columns_of,
    returns_of,
    turns_per_second_of,
    window_of,
)
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.taxonomy import semantic_id

__all__ = ["GROUND_CLASSES", "place_rig"]

#: What a sensor's height is measured from.
GROUND_CLASSES: tuple[str, ...] = ("road", "parking", "sidewalk", "terrain", "other-ground")
#: Sensors nearer to each other in plan than this stand on one pole, metres.
_SAME_POLE_M = 0.5


def place_rig(
    spec: RigSpec,
    mesh: LabelledMesh,
    *,
    file: str | Path | None = None,
    anchor_height_m: float | None = None,
) -> Rig:
    """Stand a rig on a site.

    A sensor's height is measured from the highest ground surface (`GROUND_CLASSES`) at its
    place, so a sensor named on a bridge stands on the bridge; one under it is placed by ``up_m``.

    Args:
        spec: the rig as written.
        mesh: the static world, site frame.
        file: the rig's file, for errors.
        anchor_height_m: of the anchor's ground above the zero of altitudes, where it is known.

    Raises:
        InputError: unknown model, columns, returns or a rate that the model does not offer, a
            place without ground, under it, or inside something. Names file and field.
    """
    models = check_models(spec, file=file)
    window_s = window_of(spec, models)
    site = _Site(mesh, file, anchor_height_m)
    sensors: list[MountedSensor] = []
    for index, (one, model) in enumerate(zip(spec.sensors, models, strict=True)):
        angles = np.radians([one.yaw_deg, one.pitch_deg, one.roll_deg])
        if one.rides:
            position = np.array([one.forward_m, one.left_m, one.height_m or 0.0], np.float64)
            height_m = float(position[2])
        else:
            position, height_m = site.position(one, f"sensors[{index}]")
        pose = Pose.from_ypr(position, *angles)
        sway = spec.sway if one.sway is None else one.sway
        sensors.append(
            MountedSensor(
                name=one.name,
                sensor=model,
                columns=columns_of(model, one, spec.rate_hz),
                site_SE3_sensor=pose,
                effects=one.effects,
                rate_hz=spec.rate_hz,
                number=index,
                turns_per_second=turns_per_second_of(model, one, spec.rate_hz),
                frame_window_s=window_s,
                phase_deg=one.phase_deg,
                phase_lock=one.phase_lock,
                clock_offset_s=one.clock_offset_s,
                clock_drift_ppm=one.clock_drift_ppm,
                time_jitter_s=one.time_jitter_s,
                latency_s=one.latency_s,
                dropped_frames=one.dropped_frames,
                returns=returns_of(model, one),
                outages=tuple(one.outages),
                sway=sway if sway is not None and sway.rms_m > 0 else None,
                swings_with=_pole_of(pose, sensors),
                sway_height_m=height_m,
                carrier_SE3_sensor=pose if one.rides else None,
                above_roof_m=one.above_roof_m,
                deskew=spec.deskew,
                calibration=one.calibration,
                reflectivity=spec.reflectivity,
            )
        )
    return Rig(
        tuple(sensors),
        spec.frame,
        spec.rate_hz,
        dataset_frame(spec.frame, sensors[0].site_SE3_sensor).inverse(),
        conditions=spec.conditions,
        ride=spec.ride,
        carrier=None if spec.ride is None else spec.ride.track,
        fused=spec.fused,
    )


class _Site:
    """Where sensors can stand."""

    def __init__(
        self, mesh: LabelledMesh, file: str | Path | None, anchor_height_m: float | None
    ) -> None:
        kinds = [semantic_id(name) for name in GROUND_CLASSES]
        ground = mesh.select(np.isin(mesh.semantic, kinds))
        self._probe = DownwardProbe(ground) if len(ground.faces) else None
        self._above = float(mesh.vertices[:, 2].max()) + 1.0 if len(mesh.vertices) else 0.0
        self._mesh = mesh
        self._file = file
        self._anchor_height_m = anchor_height_m

    def position(self, one: SensorSpec, field: str) -> tuple[NDArray[np.float64], float]:
        """Return where a sensor is, site frame, and how high above the ground there."""
        assert one.east_m is not None
        assert one.north_m is not None
        place = f"{one.east_m:g} m east, {one.north_m:g} m north"
        top = self._ground_below(one.east_m, one.north_m, self._above)
        if np.isnan(top):
            raise self._error(
                f"no ground at {place} of the anchor",
                f"{field}.east_m",
                "a place on the site's ground",
            )
        name, up = self._up(one, field, top)
        given = float(getattr(one, name))
        under = self._ground_below(one.east_m, one.north_m, up)
        if np.isnan(under) or up <= under:
            problem = f"{given:g} m is under the ground"
            if name != "height_m":
                problem += f", which is at {given + top - up:.2f} m there"
            raise self._error(problem, f"{field}.{name}", "a height above the ground there, in m")
        position = np.array([one.east_m, one.north_m, up])
        around = enclosing(position, self._mesh)
        if around is not None:
            raise self._error(
                f"{up - top:g} m above {place} is inside {around}",
                f"{field}.{name}",
                "a place outside, or a height above it",
            )
        return position, up - under

    def _up(self, one: SensorSpec, field: str, top: float) -> tuple[str, float]:
        """Return the field that gives a sensor's height, and its z in the site frame."""
        if one.height_m is not None:
            return "height_m", top + one.height_m
        if one.up_m is not None:
            return "up_m", one.up_m
        assert one.altitude_m is not None
        if self._anchor_height_m is None:
            raise self._error(
                "the site has no DEM, so altitudes are not known",
                f"{field}.altitude_m",
                "height_m, or a site with a DEM",
            )
        return "altitude_m", one.altitude_m - self._anchor_height_m

    def _ground_below(self, east_m: float, north_m: float, up_m: float) -> float:
        if self._probe is None:
            return float("nan")
        return float(self._probe.height_below(np.array([[east_m, north_m, up_m]]))[0])

    def _error(self, problem: str, place: str, expected: str) -> InputError:
        return InputError(problem, file=self._file, place=place, expected=expected)


def _pole_of(pose: Pose, before: list[MountedSensor]) -> int:
    """Return the number of the first sensor that stands on the same pole."""
    for other in before:
        offset = (other.site_SE3_sensor.translation - pose.translation)[:2]
        if np.hypot(*offset) <= _SAME_POLE_M:
            return other.swings_with
    return len(before)
