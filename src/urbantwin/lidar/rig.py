"""A rig on its site: every sensor with its table of beams and its pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.lidar.catalogue import Sensor, sensor
from urbantwin.lidar.enclosure import enclosing
from urbantwin.lidar.mounted import MountedSensor, Rig, dataset_frame
from urbantwin.lidar.pattern_sensor import MOST_COLUMNS
from urbantwin.lidar.spin import SLOWEST_HZ, columns_at, spin_of
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.taxonomy import semantic_id

__all__ = ["GROUND_CLASSES", "MountedSensor", "Rig", "check_models", "place_rig"]

#: What a sensor's height is measured from.
GROUND_CLASSES: tuple[str, ...] = ("road", "parking", "sidewalk", "terrain", "other-ground")
#: Turns per second that a sensor may be asked for whatever its maker offers.
_SPIN_HZ = (SLOWEST_HZ, 20.0)
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
    window_s = _window_s(spec, models)
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
                columns=_columns(model, one, spec.rate_hz),
                site_SE3_sensor=pose,
                effects=one.effects,
                rate_hz=spec.rate_hz,
                number=index,
                turns_per_second=_turns_per_second(model, one, spec.rate_hz),
                frame_window_s=window_s,
                phase_deg=one.phase_deg,
                phase_lock=one.phase_lock,
                clock_offset_s=one.clock_offset_s,
                clock_drift_ppm=one.clock_drift_ppm,
                time_jitter_s=one.time_jitter_s,
                latency_s=one.latency_s,
                dropped_frames=one.dropped_frames,
                returns=one.returns,
                outages=tuple(one.outages),
                sway=sway if sway is not None and sway.rms_m > 0 else None,
                swings_with=_pole_of(pose, sensors),
                sway_height_m=height_m,
                carrier_SE3_sensor=pose if one.rides else None,
                above_roof_m=one.above_roof_m,
                deskew=spec.deskew,
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


def check_models(spec: RigSpec, *, file: str | Path | None = None) -> tuple[Sensor, ...]:
    """Return the catalogue's sensors of a rig, which needs no site.

    Raises:
        InputError: an unknown model, or something that it does not offer. Names file and field.
    """
    return tuple(
        _checked_model(one, spec.rate_hz, file, f"sensors[{index}]")
        for index, one in enumerate(spec.sensors)
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
                "the site has no DEM, so nobody knows how high the sea is",
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


def _checked_model(one: SensorSpec, rate_hz: float, file: str | Path | None, field: str) -> Sensor:
    def error(problem: str, name: str, expected: str) -> InputError:
        return InputError(problem, file=file, place=f"{field}.{name}", expected=expected)

    model = _model(one.model, file, f"{field}.model")
    columns = _columns(model, one, rate_hz)
    if model.pattern is not None:
        if one.columns is not None:
            raise error(
                f"{model.name} scans a pattern, not columns",
                "columns",
                "no columns; points_per_second in the sensor's file",
            )
        if not 1 <= columns <= MOST_COLUMNS:
            raise error(
                f"{model.name} has {columns} points per line and frame",
                "columns",
                f"1 to {MOST_COLUMNS}: another rate_hz or points_per_second",
            )
    elif one.columns is not None and columns not in model.columns_options:
        options = ", ".join(map(str, model.columns_options))
        raise error(
            f"{model.name} does not offer {columns} columns", "columns", f"one of {options}"
        )
    if one.rate_hz is not None:
        low, high = min(*_SPIN_HZ, *model.rate_options), max(*_SPIN_HZ, *model.rate_options)
        if model.pattern is not None:
            raise error(f"{model.name} does not turn", "rate_hz", "none; the rig's rate_hz")
        if not low <= one.rate_hz <= high:
            raise error(
                f"{model.name} does not turn {one.rate_hz:g} times a second",
                "rate_hz",
                f"{low:g} to {high:g}",
            )
    modes = model.return_modes
    if modes is not None and one.returns not in modes:
        raise error(
            f"{model.name} does not report {one.returns!r}", "returns", f"one of {', '.join(modes)}"
        )
    for number, outage in enumerate(one.outages):
        highest = max(outage.channels or [0])
        if highest >= model.channels:
            raise error(
                f"{model.name} has no channel {highest}",
                f"outages[{number}].channels",
                f"0 to {model.channels - 1}",
            )
    return model


def _columns(model: Sensor, one: SensorSpec, rate_hz: float) -> int:
    """Return the columns per turn, or the points per line and frame of a pattern."""
    if model.pattern is not None:
        return round((model.points_per_second or 0.0) / model.channels / rate_hz)
    if one.columns is not None:
        return one.columns
    return columns_at(model, _turns_per_second(model, one, rate_hz))


def _turns_per_second(model: Sensor, one: SensorSpec, rate_hz: float) -> float:
    return spin_of(model, rate_hz) if one.rate_hz is None else one.rate_hz


def _window_s(spec: RigSpec, models: Sequence[Sensor]) -> float:
    """Return how long a frame collects: to the next frame, or one turn now and then."""
    if spec.window_s is not None:
        return spec.window_s
    between_s = 1.0 / spec.rate_hz
    rare = any(
        one.rate_hz is None and spin_of(model, spec.rate_hz) != spec.rate_hz
        for one, model in zip(spec.sensors, models, strict=True)
    )
    if not rare:
        return between_s
    turns = (
        1.0 / _turns_per_second(model, one, spec.rate_hz)
        for one, model in zip(spec.sensors, models, strict=True)
    )
    return min(between_s, max(turns))


def _model(name: str, file: str | Path | None, place: str) -> Sensor:
    try:
        return sensor(name, folder=None if file is None else Path(file).parent)
    except InputError as error:
        if error.file is not None:  # The fault is inside a person's own sensor file.
            raise
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None
