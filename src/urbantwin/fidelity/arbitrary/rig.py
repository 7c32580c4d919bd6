"""The rig of the twin's dataset, placed at the arbitrary site."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.ground_plane import ground_plane
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.lidar import Rig, Sensor, sensor, sensor_names
from urbantwin.lidar.enclosure import enclosing
from urbantwin.lidar.rig import dataset_frame
from urbantwin.site.rig import RideSpec

__all__ = ["level_frame", "likely_rig", "riding", "standing"]

#: Default sensor model, and default height, metres.
_MODEL, _HEIGHT_M = "OS1-128", 5.0
#: Position of a rig of unknown pose: at the south-eastern corner, facing the centre.
_CORNER_M, _HEADING_DEG = (17.0, -19.0), 135.0
#: Height above the roof of a carrier that would enclose the sensor, metres.
_ABOVE_ROOF_M = 0.3
_FEWEST_RINGS = 4


def standing(rig: Rig, mesh: LabelledMesh) -> Rig:
    """Return a fixed rig with its pose relative to its own site, at the site of ``mesh``.

    Every sensor keeps its position relative to the centre of the site, its height above the ground
    and its attitude. If a sensor is inside an object or off the site, the whole rig is rotated
    about the centre, and moved towards it, until all are free.

    Raises:
        InputError: there is no such position.
    """
    probe = DownwardProbe(mesh.select(mesh.is_ground))
    top = float(mesh.vertices[:, 2].max()) + 1.0
    for turn, scale in _tries():
        poses = []
        for one in rig.sensors:
            place = turn @ one.site_SE3_sensor.translation
            x, y = scale * place[:2]
            ground = float(probe.height_below([[x, y, top]])[0])
            place = np.array([x, y, ground + one.sway_height_m])
            if np.isnan(ground) or enclosing(place, mesh) is not None:
                break
            poses.append(Pose(turn @ one.site_SE3_sensor.rotation, place))
        else:
            sensors = tuple(
                replace(one, site_SE3_sensor=pose)
                for one, pose in zip(rig.sensors, poses, strict=True)
            )
            frame = dataset_frame(rig.frame, poses[0])
            return replace(rig, sensors=sensors, dataset_SE3_site=frame.inverse())
    raise InputError("has no free place for the rig", file="the arbitrary site")


def _tries() -> Iterator[tuple[NDArray[np.float64], float]]:
    for scale in 0.8 ** np.arange(20):
        for turn in np.arange(0.0, 2 * np.pi, np.pi / 6):
            yield Pose.from_ypr(np.zeros(3), float(turn)).rotation, float(scale)


def riding(rig: Rig, carrier_class: str = "car") -> tuple[Rig, Rig]:
    """Return a rig mounted on an actor of a class, and the same above that actor's roof.

    The second is for carriers whose shape would enclose the sensors of the first.
    """
    free = replace(rig, ride=RideSpec.model_validate({"class": carrier_class}), carrier=None)
    raised = tuple(replace(one, above_roof_m=_ABOVE_ROOF_M) for one in rig.sensors)
    return free, replace(free, sensors=raised)


def level_frame(rig: Rig) -> Pose:
    """Return the position and heading of the first sensor of a fixed rig, site frame."""
    return dataset_frame("level", rig.sensors[0].site_SE3_sensor)


def likely_rig(frame: Frame) -> tuple[dict[str, Any], str]:
    """Return a rig specification similar to the one that recorded a frame.

    Its one sensor is the catalogue's with as many channels as the first sensor has rings (or the
    next larger number) and the nearest elevations, at the height above the ground that the frame
    shows.

    Returns:
        The specification, and a description of the assumptions.
    """
    seen = frame.points - frame.sensor_places[0]
    rings = frame.ring
    if frame.sensor is not None and rings is not None:
        mine = frame.sensor == frame.sensor.min()
        seen, rings = seen[mine], rings[mine]
    model = None if rings is None else _nearest_model(seen, rings)
    plane = ground_plane(seen)
    height_m = _HEIGHT_M if plane is None else float(np.clip(plane.height_m, 1.0, 30.0))
    chosen = sensor(_MODEL) if model is None else model
    why = "taken because the sensor is unknown" if model is None else "the nearest to its rings"
    told = f"one {chosen.name}, {why}"
    told += f", {height_m:.1f} m above the ground"
    told += ", taken because no ground is seen" if plane is None else ""
    one = {"name": "sensor", "model": chosen.name, "height_m": height_m}
    place = {"east_m": _CORNER_M[0], "north_m": _CORNER_M[1], "yaw_deg": _HEADING_DEG}
    return {"rate_hz": chosen.rate_hz, "frame": "level", "sensors": [one | place]}, told


def _nearest_model(seen: NDArray[np.float64], rings: NDArray[np.int64]) -> Sensor | None:
    names, ring = np.unique(rings, return_inverse=True)
    if len(names) < _FEWEST_RINGS:
        return None
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    order = np.lexsort((elevation, ring))
    starts = np.searchsorted(ring[order], np.arange(len(names) + 1))
    median = elevation[order][(starts[:-1] + starts[1:]) // 2]
    known = [one for one in map(sensor, sensor_names()) if one.pattern is None]
    enough = [one.channels for one in known if one.channels >= len(names)]
    if not enough:
        return None
    alike = [one for one in known if one.channels == min(enough)]
    return min(alike, key=lambda one: _apart(median, one.elevation_deg))


def _apart(seen: NDArray[np.float64], channels: NDArray[np.float64]) -> float:
    """Return the mean distance of elevations to the nearest channel, plus the reverse."""
    gap = np.abs(seen[:, None] - channels[None, :])
    return float(gap.min(axis=1).mean() + gap.min(axis=0).mean())
