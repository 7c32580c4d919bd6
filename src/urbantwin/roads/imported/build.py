"""The lane network of a site from an imported map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads.build import BuiltRoads
from urbantwin.roads.grade_separation import Lift
from urbantwin.roads.heights import RoadSurface, with_heights
from urbantwin.roads.imported.closed_loop import closed_model
from urbantwin.roads.imported.crop import cropped, has_traffic, main_part
from urbantwin.roads.imported.heights import (
    ModelSurface,
    elevation_of_model,
    is_flat,
    on_one_level,
    raised,
    with_levels,
)
from urbantwin.roads.imported.plain_xml import origin_of
from urbantwin.roads.imported.read import ImportedMap
from urbantwin.roads.imported.sumo import sumo_network_of_model
from urbantwin.roads.lane_polylines import network_of_model
from urbantwin.roads.model import LaneModel
from urbantwin.roads.signals.programs import set_programs, with_programs
from urbantwin.roads.sumo_geometry import redraw_sumo_network
from urbantwin.roads.sumo_network import read_sumo_network
from urbantwin.site.signals import SignalPlan

__all__ = ["PreparedMap", "build_imported_roads", "check_meets", "prepared_map"]

#: Extension of cut streets beyond the border before they turn round, metres.
BEYOND_M = 20.0
_NOT_LIFTED = Lift(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0))


@dataclass(frozen=True)
class PreparedMap:
    """A map cut to the region, with heights of the site, and the corresponding ground.

    Attributes:
        model: the lane model, site frame.
        elevation: the ground.
        notes: assumptions and omissions.
    """

    model: LaneModel
    elevation: Elevation
    notes: dict[str, object]


def prepared_map(
    imported: ImportedMap,
    region: shapely.Polygon,
    elevation: Elevation | None,
    *,
    closed_loop: bool = False,
) -> PreparedMap:
    """Crop a map to a region and to its main component, and determine its heights.

    Heights of the map are kept, with one shift for the whole map: the road nearest to the anchor is
    at zero or, with a DEM, the median of road minus ground is zero. A map without heights takes
    those of the DEM, if any. So does one with heights only at the corners of its lines, unless one
    of its roads passes over another.

    Args:
        imported: the map, site frame.
        region: the region to build, site frame.
        elevation: the ground, from a DEM; ``None`` without one.
        closed_loop: whether outer roads beyond the region lead each exit back to an entry.

    Raises:
        InputError: the map has no lanes with traffic, or none in the region.
    """
    check_meets(imported, region)
    uncut = imported.model
    beyond = BEYOND_M if closed_loop else 0.0
    model, left_out = main_part(cropped(uncut, region, beyond=beyond))
    if not has_traffic(model):
        raise InputError(
            "has no lanes that traffic could use within the region",
            file=imported.path,
            expected="lanes of the type driving",
        )
    flat = is_flat(model)
    notes: dict[str, object] = {
        "map": imported.notes,
        "roads_of_the_map": sum(road.junction < 0 for road in uncut.roads),
        "heights": "none in the map" if flat else "the map's own",
    }
    if flat:
        model = on_one_level(raised(model, -_first_height(model)))
        if elevation is not None:
            model, _ = with_heights(model, elevation, _NOT_LIFTED)
            notes["heights"] = "the DEM's: the map has none"
        ground = elevation or Elevation.flat()
    else:
        model = with_levels(model)
        shift = _shift(model, elevation)
        level = all(road.level == 0 for road in model.roads)
        if elevation is not None and imported.heights_at_corners and level:
            model, _ = with_heights(model, elevation, _NOT_LIFTED)
            notes["heights"] = "the DEM's: the map has them at the corners of its lines only"
        else:
            model = raised(model, shift)
            notes["heights_moved_by_m"] = round(shift, 3)
        ground = elevation or elevation_of_model(model, region)
    if closed_loop:
        model, notes["closed_loop"] = closed_model(model, region.buffer(beyond))
    notes["left_out"] = [item.as_note() for item in left_out]
    return PreparedMap(model, ground, notes)


def build_imported_roads(
    prepared: PreparedMap,
    frame: SiteFrame,
    *,
    out: Path,
    plans: Sequence[SignalPlan] = (),
) -> BuiltRoads:
    """Build the lane network of a prepared map and write SUMO's network.

    Args:
        prepared: the map.
        frame: the site frame.
        out: the ``.net.xml`` to write.
        plans: signal programs that replace those of the map or assumed ones.

    Raises:
        InputError: a signal plan cannot be used.
        StageError: netconvert failed.
    """
    places = [plan.spec.place for plan in plans]
    signal_places = [frame.site_from_lonlat([(place[1], place[0])])[0] for place in places if place]
    sumo = sumo_network_of_model(prepared.model, out, lit=signal_places)
    planned = set_programs(out, plans, frame)
    model = sumo.model
    raw = read_sumo_network(
        out,
        driving_side=model.driving_side,
        level_of_way={origin_of(road): road.level for road in prepared.model.roads},
        origin={},
    )
    model = with_programs(model, raw.programs)
    surface = RoadSurface(model, ModelSurface(model))
    network = network_of_model(model, raw, surface.height)
    redraw_sumo_network(out, network)
    notes: dict[str, object] = {
        "roads": len(network.roads),
        "junctions": len(network.junctions),
        "signal_programs": len(network.programs),
        "signal_programs_set": planned,
        **prepared.notes,
        **sumo.notes,
        "netconvert_warnings": len(sumo.warnings),
    }
    return BuiltRoads(model, network, surface, notes)


def check_meets(imported: ImportedMap, region: shapely.Polygon) -> None:
    """Check that a map has a road in a region.

    Raises:
        InputError: it has none; the message gives the distance of the nearest road.
    """
    streets = [road for road in imported.model.roads if road.junction < 0]
    if not has_traffic(imported.model):
        raise InputError(
            "holds no lanes that traffic could use",
            file=imported.path,
            expected="roads with lanes of the type driving",
        )
    lines = np.array([road.curve.line for road in streets], dtype=object)
    nearest = float(shapely.distance(lines, region).min())
    if nearest > 0.0:
        away = f"{nearest / 1000:.1f} km" if nearest >= 1000 else f"{nearest:.0f} m"
        raise InputError(
            f"has no road within the region: the nearest is {away} away",
            file=imported.path,
            expected="an anchor on the map",
        )


def _first_height(model: LaneModel) -> float:
    return float(model.roads[0].elevation.at([0.0])[0])


def _shift(model: LaneModel, elevation: Elevation | None) -> float:
    """Return the upward shift of a map with heights, metres."""
    on_ground = [road for road in model.roads if road.level == 0] or list(model.roads)
    points = np.vstack(
        [
            road.place(s, 0.0)
            for road in on_ground
            for s in [np.linspace(0.0, road.length, max(2, int(road.length) + 1))]
        ]
    )
    if elevation is None:
        nearest = int(np.argmin(np.linalg.norm(points[:, :2], axis=1)))
        return -float(points[nearest, 2])
    return float(np.median(elevation.raw_at(points[:, :2]) - points[:, 2]))
