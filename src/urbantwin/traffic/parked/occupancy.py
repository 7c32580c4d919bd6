"""Occupancy of parking spaces: random spaces, each with a vehicle of the fleet that fits.

Each space has its own random stream for whether it is taken, by which vehicle, and how accurately:
further spaces change no other, and moving traffic changes no parked vehicle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads import RoadNetwork
from urbantwin.traffic.assets import Asset, Fleet
from urbantwin.traffic.parked.spaces import (
    Space,
    car_park_spaces,
    rectangle,
    service_ground,
    street_spaces,
)
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.obstacles import Obstacles
from urbantwin.traffic.paths.placement import Ground, stand

__all__ = ["FIRST_PARKED_TRACK", "ParkedVehicles", "park"]

#: First track id of parked vehicles, so that moving traffic does not renumber them.
FIRST_PARKED_TRACK = 30_001
#: Least distance of parked vehicles from a bus stop, metres (StVO, sign 224: 15 m to each side).
STOP_M = 15.0
#: Distance of the wheels' side from the kerb: mean and standard deviation, metres. Laws require
#: less than 0.3 m, if anything (US Uniform Vehicle Code 11-1004: 12 inches).
KERB_M = (0.22, 0.07)
#: Standard deviations of a vehicle's heading in its space, rad, and of its position along it, as a
#: share of the remaining room (assumed).
ASKEW_RAD, ALONG_SHARE = 0.012, 0.25
#: Share of vehicles parked backwards in spaces across the road (assumed).
BACKWARDS = 0.3
#: Room left along the kerb, and between vehicles in a row, so that doors open, metres.
GAP_ALONG_M, DOOR_M = 0.5, 0.55
#: Share of vans, as `site.usual_traffic.VANS`; number of vehicles tried until one fits.
VANS, TRIES = 0.10, 6
_STREAM = 8_000_000_000


@dataclass(frozen=True, eq=False)
class ParkedVehicles:
    """The parked vehicles.

    Attributes:
        rows: rows of the motion's actors, one per vehicle.
        notes: by kind of space, the numbers of all and of taken ones, and reasons for others.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    notes: dict[str, dict[str, int]] = field(default_factory=dict)

    def table(self, schema: pa.Schema) -> pa.Table:
        """Return the rows as a table of a schema."""
        return pa.Table.from_pylist(self.rows, schema=schema)


def park(
    network: RoadNetwork,
    mesh: LabelledMesh,
    ground: Ground,
    share: Mapping[str, float],
    *,
    fleet: Fleet,
    asset: Callable[[str], Asset],
) -> ParkedVehicles:
    """Fill the parking spaces of a site.

    Spaces on a crossing, at a driveway, within 15 m of a bus stop, at a wall, pole or tree, or
    overlapping another vehicle stay empty.

    Args:
        network: the lanes.
        mesh: the static world.
        ground: ground below the vehicles.
        share: by kind of space, share of the usable spaces that is taken, 0..1.
        fleet: fleet of the region, whose seed is used.
        asset: returns an asset's dimensions and contacts by name.
    """
    spaces = [
        *(street_spaces(network) if share.get("street", 0) > 0 else ()),
        *(car_park_spaces(mesh, network) if share.get("car_park", 0) > 0 else ()),
    ]
    if not spaces:
        return ParkedVehicles()
    counts: dict[str, Counter[str]] = {}
    tried: list[_Candidate] = []
    driveways = service_ground(mesh, network)
    for number, space in enumerate(spaces):
        count = counts.setdefault(space.kind, Counter(spaces=0, taken=0))
        count["spaces"] += 1
        random = np.random.Generator(np.random.Philox(key=[fleet.seed, _STREAM + number]))
        if random.random() >= share[space.kind]:
            continue
        if space.kind == "street" and driveways.intersects(space.beyond()):
            count["driveway"] += 1
            continue
        candidate = _vehicle(space, number, random, fleet, asset)
        if candidate is None:
            count["too_small"] += 1
        else:
            tried.append(candidate)
    for vehicle, why in zip(tried, _hindrances(tried, network, mesh), strict=True):
        counts[vehicle.space.kind][why or "taken"] += 1
        vehicle.stays = not why
    rows: list[dict[str, Any]] = []
    for vehicle in (vehicle for vehicle in tried if vehicle.stays):
        ceiling = np.array([vehicle.space.place[2] + 1.5])
        contacts, yaw = vehicle.asset.contacts, np.array([vehicle.yaw])
        z, pitch, roll = stand(ground, contacts, vehicle.xy[None], yaw, ceiling)
        if not np.isfinite(z[0]):
            counts[vehicle.space.kind].update(taken=-1, no_ground=1)
            continue
        rows.append(
            {
                "track": FIRST_PARKED_TRACK + len(rows),
                "class": vehicle.asset.actor_class,
                "asset": vehicle.asset.name,
                "phase": vehicle.asset.standing,
                **dict(zip("xy", vehicle.xy.tolist(), strict=True)),
                "z": float(z[0]),
                "yaw": float(np.angle(np.exp(1j * vehicle.yaw))),
                "pitch": float(pitch[0]),
                "roll": float(roll[0]),
                "length": vehicle.asset.length,
                "width": vehicle.asset.width,
                "height": vehicle.asset.height,
                "speed": 0.0,
                "lane": vehicle.space.lane,
                "time_s": 0.0,
            }
        )
    return ParkedVehicles(
        rows, {kind: dict(sorted(counter.items())) for kind, counter in counts.items()}
    )


@dataclass(eq=False)
class _Candidate:
    """A vehicle that fits a space: its pose, and whether it stays."""

    space: Space
    asset: Asset
    xy: NDArray[np.float64]
    yaw: float
    stays: bool = True

    def outline(self) -> shapely.Polygon:
        """Return its area in plan."""
        return rectangle(self.xy, self.yaw, self.asset.length, self.asset.width)


def _hindrances(tried: Sequence[_Candidate], network: RoadNetwork, mesh: LabelledMesh) -> list[str]:
    """Return, for each vehicle, the reason why it cannot stand there; empty if it can."""
    if not tried:
        return []
    kept_free = _no_parking_areas(network)
    outlines = [vehicle.outline() for vehicle in tried]
    boxes = PlanBoxes(
        np.zeros(len(tried), np.int64),
        np.array([vehicle.xy for vehicle in tried]),
        np.array([vehicle.yaw for vehicle in tried]),
        np.array([[vehicle.asset.length, vehicle.asset.width] for vehicle in tried]) / 2 + 0.05,
    )
    z = np.array([vehicle.space.place[2] for vehicle in tried])
    obstacle_classes = Obstacles(mesh).met(
        boxes, z, np.array([vehicle.asset.height for vehicle in tried])
    )
    why = [
        "kept_free" if kept_free.intersects(outline) else "in_the_way" if what else ""
        for outline, what in zip(outlines, obstacle_classes, strict=True)
    ]
    # The first vehicle stays.
    pairs = shapely.STRtree(outlines).query(outlines, predicate="intersects").T
    for first, second in sorted(pairs.tolist()):
        if first < second and not why[first] and not why[second]:
            why[second] = "next_to_another"
    return why


def _vehicle(
    space: Space,
    number: int,
    random: np.random.Generator,
    fleet: Fleet,
    asset: Callable[[str], Asset],
) -> _Candidate | None:
    """Return the vehicle that takes a space; ``None`` if none fits."""
    off = random.normal(size=3)
    backwards = space.kerb == 0 and not space.slanted and random.random() < BACKWARDS
    for attempt in range(TRIES):
        kind = "van" if random.random() < VANS else "car"
        name = fleet.body(kind, 1_000_000 + number * TRIES + attempt, bends=False)
        size = asset(name)
        if space.kerb:
            room = space.length - GAP_ALONG_M - size.length
            fits = room >= 0 and size.width <= space.width + 0.15
        else:
            room = space.length + 0.2 - size.length
            fits = room >= 0 and size.width <= space.width - DOOR_M
        if fits:
            break
    else:
        return None
    ahead = np.array([np.cos(space.yaw), np.sin(space.yaw)])
    left = np.array([-ahead[1], ahead[0]])
    xy = space.place[:2] + ahead * np.clip(off[0] * ALONG_SHARE, -0.5, 0.5) * room
    if space.kerb:
        away = max(KERB_M[0] + KERB_M[1] * float(off[1]), 0.08)
        xy = xy + left * space.kerb * (space.width / 2 - away - size.width / 2)
    else:
        play = (space.width - DOOR_M - size.width) / 2
        xy = xy + left * np.clip(off[1] * 0.4, -1.0, 1.0) * max(play, 0.0)
    yaw = space.yaw + float(np.clip(off[2], -2.5, 2.5)) * ASKEW_RAD
    return _Candidate(space, size, xy, yaw + (np.pi if backwards else 0.0))


def _no_parking_areas(network: RoadNetwork) -> shapely.Geometry:
    """Return areas without parking: crossings, paths through junctions, around bus stops."""
    areas = [lane.polygon for lane in network.lanes if lane.kind == "crossing"]
    areas = [area.buffer(1.0) for area in areas]
    areas += [lane.polygon.buffer(-0.3) for lane in network.lanes if lane.kind == "connection"]
    for stop in network.stops:
        lane = network.lane_by_id.get(stop.lane)
        if lane is not None:
            line = shapely.LineString(lane.centre[:, :2])
            places = [line.interpolate(station_m) for station_m in (stop.start_m, stop.end_m)]
            areas.append(shapely.LineString(places).buffer(STOP_M))
    free_area = shapely.union_all([part for part in areas if not part.is_empty], grid_size=1e-3)
    shapely.prepare(free_area)
    return free_area
