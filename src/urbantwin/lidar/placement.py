"""Placement of a rig on its site: sensor model, options and pose of every sensor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
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

if TYPE_CHECKING:
    from urbantwin.scene.preview import ScenePreview

__all__ = ["place_rig", "refuse_places"]

#: Sensors within this horizontal distance share a pole, metres.
_SAME_POLE_M = 0.5
#: Accuracy of ground and roofs before the scene is built, metres.
_NEARLY_M = 0.5


def place_rig(
    spec: RigSpec,
    mesh: LabelledMesh,
    *,
    file: str | Path | None = None,
    anchor_height_m: float | None = None,
) -> Rig:
    """Place a rig on a site.

    A sensor's height is measured from the highest ground surface (`taxonomy.GROUND_CLASSES`) at its
    position, so on a bridge it is above the deck; a sensor under a bridge is placed by ``up_m``.

    Args:
        spec: the rig as written.
        mesh: the static world, site frame.
        file: the rig's file, for errors.
        anchor_height_m: height of the anchor's ground in the datum of altitudes, if known.

    Raises:
        InputError: unknown model; columns, returns or rate that the model does not offer; a
            position without ground, below it, or inside an object. Names file and field.
    """
    models = check_models(spec, file=file)
    window_s = window_of(spec, models)
    site = _Site(mesh, file, anchor_height_m)
    sensors: list[MountedSensor] = []
    for index, (written, model) in enumerate(zip(spec.sensors, models, strict=True)):
        angles = np.radians([written.yaw_deg, written.pitch_deg, written.roll_deg])
        if written.rides:
            position = np.array(
                [written.forward_m, written.left_m, written.height_m or 0.0], np.float64
            )
            height_m = float(position[2])
        else:
            position, height_m = site.position(written, f"sensors[{index}]")
        pose = Pose.from_ypr(position, *angles)
        sway = spec.sway if written.sway is None else written.sway
        sensors.append(
            MountedSensor(
                name=written.name,
                sensor=model,
                columns=columns_of(model, written, spec.rate_hz),
                site_SE3_sensor=pose,
                effects=written.effects,
                rate_hz=spec.rate_hz,
                number=index,
                turns_per_second=turns_per_second_of(model, written, spec.rate_hz),
                frame_window_s=window_s,
                phase_deg=written.phase_deg,
                phase_lock=written.phase_lock,
                clock_offset_s=written.clock_offset_s,
                clock_drift_ppm=written.clock_drift_ppm,
                framed_by_clock=spec.frames_by == "clock",
                time_jitter_s=written.time_jitter_s,
                latency_s=written.latency_s,
                dropped_frames=written.dropped_frames,
                returns=returns_of(model, written),
                outages=tuple(written.outages),
                sway=sway if sway is not None and sway.rms_m > 0 else None,
                swings_with=_pole_of(pose, sensors),
                sway_height_m=height_m,
                pose_error=written.pose_error,
                carrier_SE3_sensor=pose if written.rides else None,
                above_roof_m=written.above_roof_m,
                deskew=spec.deskew,
                calibration=written.calibration,
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
        boxes=spec.boxes,
        label_range_m=spec.label_range_m,
    )


def refuse_places(
    spec: RigSpec,
    scene: ScenePreview,
    *,
    file: str | Path | None = None,
    anchor_height_m: float | None = None,
) -> None:
    """Reject invalid sensor positions before the scene is built.

    Errors below half a metre, and positions on or under a bridge, are left to `place_rig`. Proposed
    positions are not checked: they may still change.

    Args:
        spec: the rig as written.
        scene: preview of the scene around the sensors.
        file: the rig's file, for errors.
        anchor_height_m: height of the anchor's ground in the datum of altitudes, if known.

    Raises:
        InputError: a sensor without ground, below it, or inside a building. Names file and field.
    """
    for index, written in enumerate(spec.sensors):
        if written.east_m is None or written.north_m is None or written.proposed:
            continue
        field, place = (
            f"sensors[{index}]",
            f"{written.east_m:g} m east, {written.north_m:g} m north",
        )
        here = shapely.Point(written.east_m, written.north_m)
        if here.distance(scene.extent) > _NEARLY_M:
            raise _no_ground(place, field, file)
        if scene.decks.intersects(here):
            continue
        ground = float(scene.ground_height(np.array([[written.east_m, written.north_m]]))[0])
        name, up = _given_height(written, field, ground, anchor_height_m, file)
        if up <= ground - _NEARLY_M:
            ground_m = ground - up + float(getattr(written, name))
            raise _under_ground(written, name, field, ground_m, file)
        # Inside at its own height and half a metre above: not merely close to the roof.
        points = np.array([written.east_m, written.north_m, up]) + [[0, 0, 0], [0, 0, _NEARLY_M]]
        around = [enclosing(point, scene.buildings) for point in points]
        if all(around):
            raise _inside(f"{up - ground:g} m above {place}", str(around[0]), name, field, file)


class _Site:
    """Checks positions of sensors against the static world."""

    def __init__(
        self, mesh: LabelledMesh, file: str | Path | None, anchor_height_m: float | None
    ) -> None:
        ground = mesh.select(mesh.is_ground)
        self._probe = DownwardProbe(ground) if len(ground.faces) else None
        self._above = float(mesh.vertices[:, 2].max()) + 1.0 if len(mesh.vertices) else 0.0
        self._mesh = mesh
        self._file = file
        self._anchor_height_m = anchor_height_m

    def position(self, written: SensorSpec, field: str) -> tuple[NDArray[np.float64], float]:
        """Return the position of a sensor, site frame, and its height above the ground below it."""
        assert written.east_m is not None
        assert written.north_m is not None
        place = f"{written.east_m:g} m east, {written.north_m:g} m north"
        top = self._ground_below(written.east_m, written.north_m, self._above)
        if np.isnan(top):
            raise _no_ground(place, field, self._file)
        name, up = _given_height(written, field, top, self._anchor_height_m, self._file)
        under = self._ground_below(written.east_m, written.north_m, up)
        if np.isnan(under) or up <= under:
            raise _under_ground(
                written, name, field, top - up + float(getattr(written, name)), self._file
            )
        position = np.array([written.east_m, written.north_m, up])
        around = enclosing(position, self._mesh)
        if around is not None:
            raise _inside(f"{up - top:g} m above {place}", around, name, field, self._file)
        return position, up - under

    def _ground_below(self, east_m: float, north_m: float, up_m: float) -> float:
        if self._probe is None:
            return float("nan")
        return float(self._probe.height_below(np.array([[east_m, north_m, up_m]]))[0])


def _given_height(
    written: SensorSpec,
    field: str,
    ground: float,
    anchor_height_m: float | None,
    file: str | Path | None,
) -> tuple[str, float]:
    """Return the field that gives a sensor's height, and its z in the site frame."""
    if written.height_m is not None:
        return "height_m", ground + written.height_m
    if written.up_m is not None:
        return "up_m", written.up_m
    assert written.altitude_m is not None
    if anchor_height_m is None:
        raise InputError(
            "the site has no DEM, so altitudes are not known",
            file=file,
            place=f"{field}.altitude_m",
            expected="height_m, or a site with a DEM",
        )
    return "altitude_m", written.altitude_m - anchor_height_m


def _no_ground(place: str, field: str, file: str | Path | None) -> InputError:
    return InputError(
        f"no ground at {place} of the anchor",
        file=file,
        place=f"{field}.east_m",
        expected="a place on the site's ground",
    )


def _under_ground(
    written: SensorSpec, name: str, field: str, ground: float, file: str | Path | None
) -> InputError:
    """Return the error; ``ground`` is the ground's height in terms of the field ``name``."""
    problem = f"{getattr(written, name):g} m is under the ground"
    if name != "height_m":
        problem += f", which is at {ground:.2f} m there"
    return InputError(
        problem,
        file=file,
        place=f"{field}.{name}",
        expected="a height above the ground there, in m",
    )


def _inside(where: str, around: str, name: str, field: str, file: str | Path | None) -> InputError:
    return InputError(
        f"{where} is inside {around}",
        file=file,
        place=f"{field}.{name}",
        expected="a place outside, or a height above it",
    )


def _pole_of(pose: Pose, before: list[MountedSensor]) -> int:
    """Return the index of the first sensor on the same pole."""
    for other in before:
        offset = (other.site_SE3_sensor.translation - pose.translation)[:2]
        if np.hypot(*offset) <= _SAME_POLE_M:
            return other.swings_with
    return len(before)
