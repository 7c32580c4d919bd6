"""A truck that blocks the view of a sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError, StageError
from urbantwin.geometry import rotation_from_ypr
from urbantwin.geometry.rays import RayScene
from urbantwin.traffic.assets import asset, asset_mesh, asset_names
from urbantwin.traffic.events.scenario import BlockedSensor
from urbantwin.traffic.events.scripted import CLEAR_M, Scripted, Setting
from urbantwin.traffic.events.surroundings import passage_of_path
from urbantwin.traffic.prescribed import PrescribedPath

__all__ = ["blocked_sensor"]

#: Least and largest distance of the truck from the sensor, metres.
_MIN_DISTANCE_M, _MAX_DISTANCE_M = 2.0, 18.0
#: A lane whose edge is within this distance of the kerb is the outermost, metres.
_OUTERMOST_LANE_M = 1.0
#: Streets within this distance of the anchor are the junction that the sensor shall see, metres.
_JUNCTION_M = 35.0
#: Least share of the requested duration that is accepted if no place is free for all of it, and
#: spacing of the times that are tried, seconds.
_MIN_SHARE, _TIME_SPACING_S = 0.25, 5.0


def blocked_sensor(event: BlockedSensor, setting: Setting) -> Scripted:
    """Place a truck where it hides most of the junction from the sensor.

    Candidates are the lanes that trucks use around the sensor, and the kerbs beside them. The
    hidden share is computed by rays to the streets around the anchor that are visible without the
    truck.
    """
    twin = setting.twin
    standing = {name: (east, north) for name, east, north in twin.rig_spec().standing()}
    name = event.sensor or next(iter(standing), "")
    if name not in standing:
        raise InputError(
            f"the rig has no static sensor {name!r:.40}",
            place="sensor",
            expected=", ".join(standing) or "a static rig",
        )
    spec = next(sensor for sensor in twin.rig_spec().sensors if sensor.name == name)
    foot, above_m = np.array(standing[name]), spec.height_m or 5.0
    eye = np.array([*foot, np.nan_to_num(setting.solid.ground(foot[None]))[0] + above_m])
    seen = _seen_places(setting, eye)
    if not len(seen):
        raise StageError(f"blocked_sensor: {name} sees nothing of the junction as it is")
    tried = []
    for truck in asset_names("truck"):
        if asset(truck).bodies:
            continue  # a single rigid truck suffices
        scene = RayScene(asset_mesh(truck).vertices, asset_mesh(truck).faces)
        for xy, yaw in _truck_places(setting, truck, eye):
            hidden = _hidden_share(scene, eye, seen, xy, yaw)
            tried.append((-round(hidden, 6), truck, tuple(xy[:2].tolist()), yaw))
    if not tried:
        raise StageError(
            f"blocked_sensor at {event.at_s:g} s cannot be staged: within {_MAX_DISTANCE_M:g} m of "
            f"{name} is no lane that trucks use, nor a kerb beside one: name another sensor"
        )
    hiding = [place for place in sorted(tried) if -place[0] >= event.least_share]
    for from_s, until_s in _spans(event, setting.until_s):
        for minus, truck, (x, y), yaw in hiding:
            path = PrescribedPath(
                "truck",
                truck,
                np.array([from_s, until_s]),
                np.array([(x, y), (x, y)]),
                yaw=np.array([yaw, yaw]),
                speed=np.zeros(2),
            )
            other = setting.others.nearest(passage_of_path(path, setting.others.motion))
            if other is None or other.gap_m >= CLEAR_M:
                report = {"sensor": name, "share_of_junction_hidden": -minus}
                return Scripted((path,), from_s, until_s, told=report)
    most = -min(tried)[0]
    prefix = f"blocked_sensor at {event.at_s:g} s cannot be staged: "
    if not hiding:
        raise StageError(
            f"{prefix}a truck beside {name}, {above_m:.1f} m above the ground, hides "
            f"{most:.1%} of the junction at the most, and {event.least_share:.1%} are requested: "
            f"least_share: {np.floor(most * 1000) / 1000:.3f}, or a sensor that hangs lower"
        )
    raise StageError(
        f"{prefix}none of the {len(hiding)} places beside {name} where a truck hides "
        f"{event.least_share:.1%} of the junction or more ({most:.1%} at the most) is free for "
        f"{event.lasts_s * _MIN_SHARE:g} s within {event.within_s:g} s of it: a longer within_s, a "
        "shorter lasts_s, or another at_s"
    )


def _spans(event: BlockedSensor, until_s: float) -> Iterator[tuple[float, float]]:
    """Yield the intervals in which the truck may stand, those of the full duration first."""
    later = np.arange(0.0, event.within_s + 1e-6, _TIME_SPACING_S)
    times = event.at_s + np.unique([*-later, *later])
    long_enough = times + _MIN_SHARE * event.lasts_s <= until_s
    times = times[(times >= 0) & (long_enough | (times == event.at_s))]
    for part in (1.0, 0.5, _MIN_SHARE):
        for from_s in sorted(times.tolist(), key=lambda at_s: abs(at_s - event.at_s)):
            yield from_s, min(from_s + part * event.lasts_s, until_s)


def _seen_places(setting: Setting, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 3) on the streets of the junction that the sensor sees."""
    spread = np.arange(-_JUNCTION_M, _JUNCTION_M + 1, 2.0)
    x, y = (grid.ravel() for grid in np.meshgrid(spread, spread))
    on_road = shapely.contains_xy(setting.twin.roads.carriageway(0), x, y)
    on_road &= np.hypot(x, y) <= _JUNCTION_M
    xy = np.column_stack([x[on_road], y[on_road]])
    z = setting.solid.ground(xy) + 0.8
    places = np.column_stack([xy, z])[np.isfinite(z)]
    mesh = setting.twin.mesh
    rays = places - eye
    reach = np.linalg.norm(rays, axis=1)
    origins = np.tile(eye.astype(np.float32), (len(rays), 1))
    scene = RayScene(mesh.vertices, mesh.faces)
    hit = scene.cast_single(origins, (rays / reach[:, None]).astype(np.float32))
    return np.asarray(places[hit.range_m > reach - 0.3])


def _truck_places(
    setting: Setting, truck: str, eye: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], float]]:
    """Return possible positions (3,), metres, and headings of a truck around a sensor.

    They are on lanes, and beside them at the kerb, half or fully on the sidewalk as for deliveries,
    where there is ground and no obstacle.
    """
    twin, kerb = setting.twin, setting.twin.roads.carriageway(0)
    side = -1.0 if twin.roads.driving_side == "right" else 1.0
    body = asset(truck)
    points, yaws = [], []
    for lane in twin.roads.lanes:
        parks, turns = lane.kind == "parking", lane.kind == "connection"
        drives = turns or lane.kind in ("driving", "bus")
        if not parks and not (drives and "truck" in lane.allowed):
            continue
        line = shapely.LineString(lane.centre[:, :2])
        for along in np.arange(3.0, line.length - 3.0, 2.0):
            ends = [
                shapely.get_coordinates(line.interpolate(along + offset_m))[0]
                for offset_m in (-1.0, 0, 1.0)
            ]
            if np.hypot(*(ends[1] - eye[:2])) > _MAX_DISTANCE_M + _OUTERMOST_LANE_M:
                continue
            ahead = (ends[2] - ends[0]) / np.hypot(*(ends[2] - ends[0]))
            out = side * np.array([-ahead[1], ahead[0]])
            places = [] if turns else [ends[1]]  # no standing within a junction
            across = shapely.LineString([ends[1], ends[1] + 2 * lane.width * out])
            paved = shapely.get_parts(shapely.intersection(across, kerb))
            paved = paved[shapely.distance(paved, shapely.Point(ends[1])) < _OUTERMOST_LANE_M / 2]
            kerb_m = float(shapely.length(paved).max(initial=0.0)) or np.inf
            if kerb_m < lane.width / 2 + _OUTERMOST_LANE_M:
                shares = (0, 1) if turns else (-1, 0, 1)
                places += [ends[1] + (kerb_m + k * body.width / 2) * out for k in shares]
            points += places
            yaws += [float(np.arctan2(*ahead[::-1]))] * len(places)
    xy, yaw = np.array(points).reshape(-1, 2), np.array(yaws)
    away = np.hypot(*(xy - eye[:2]).T)
    is_near = (away > _MIN_DISTANCE_M) & (away < _MAX_DISTANCE_M)
    xy, yaw = xy[is_near], yaw[is_near]
    z = setting.solid.ground(xy)
    size = body.length, body.width, body.height
    free = np.isfinite(z) & ~setting.solid.met(xy, yaw, size)
    return list(zip(np.column_stack([xy, z])[free], yaw[free].tolist(), strict=True))


def _hidden_share(
    scene: RayScene,
    eye: NDArray[np.float64],
    seen: NDArray[np.float64],
    at: NDArray[np.float64],
    yaw: float,
) -> float:
    """Return the share of points (N, 3) that a truck at a pose hides from a sensor."""
    turn = rotation_from_ypr(yaw, 0.0, 0.0)
    origin = (eye - at) @ turn
    rays = (seen - eye) @ turn
    reach = np.linalg.norm(rays, axis=1)
    hit = scene.cast_single(
        np.tile(origin.astype(np.float32), (len(rays), 1)),
        (rays / reach[:, None]).astype(np.float32),
    )
    return float((hit.range_m < reach).mean())
