"""Ground zones: a partition of the ground in plan by surface, without holes or overlaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from urbantwin.geometry import (
    area_difference,
    area_intersection,
    area_union,
    areas_of,
    closed,
    grown,
    opened,
)
from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads import RoadNetwork
from urbantwin.roads.building_ground import building_ground
from urbantwin.roads.model import CURB_HEIGHT_M
from urbantwin.roads.network import CARRIAGEWAY_KINDS, SEAM_M
from urbantwin.scene.land_use import land_covers, mapped_cover
from urbantwin.scene.water.plan import WaterBody
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["Zone", "deck_zones", "ground_zones"]

#: Gaps between carriageways up to this wide are raised medians or islands.
MEDIAN_M = 8.0
#: Gaps smaller than this are paved if they are along footways, square metres: if less than the
#: first share of their border is along carriageways. Larger gaps below the second share are not
#: islands.
PAVED_M2, KERB_SHARES = 4.0, (0.9, 0.25)
#: Maximum distance from a carriageway of borders along it, metres.
AT_KERB_M = 0.05
#: Kinds of raised lanes without pedestrians.
RAISED = ("median", "island")
#: Width of terrain beyond the region, so that beams at its border hit ground, metres.
MARGIN_M = 25.0
#: Width of terrain beside roads outside that: the overhang of turning buses, metres.
VERGE_M = 5.0
#: Thickness of walls between water and paved ground, metres.
WALL_M = 0.4
#: Minimum distance of mapped islands from drivable lanes, metres.
ASIDE_M = 0.2

#: Widths of ways that are paved but not in the lane network, metres, and their surface.
OTHER_WAYS: dict[str, tuple[float, str, str]] = {
    "service": (4.0, "road", "asphalt"),
    "track": (3.0, "other-ground", "soil"),
    "pedestrian": (4.0, "sidewalk", "paving"),
    "footway": (2.0, "sidewalk", "paving"),
    "path": (1.5, "sidewalk", "soil"),
    "cycleway": (2.0, "sidewalk", "asphalt"),
}

#: Values of ``parking=*`` without parked cars on the ground (OSM wiki, "Key:parking").
NOT_ON_THE_GROUND = frozenset(
    {"underground", "multi-storey", "rooftop", "garage", "garages", "sheds"}
)


@dataclass(frozen=True)
class Zone:
    """A surface in plan.

    Attributes:
        kind: carriageway, footway, island, paved (flush with the terrain), water or terrain.
        area: its area, site frame.
        semantic: its semantic class.
        material: its material.
        measured_step_m: its measured height above the carriageway, metres; ``None`` if not
            measured.
    """

    kind: str
    area: shapely.Geometry
    semantic: int
    material: int
    measured_step_m: float | None = None

    @property
    def step(self) -> float | None:
        """Height above the carriageway; ``None`` if the zone follows the terrain."""
        if self.measured_step_m is not None:
            return self.measured_step_m
        return {"carriageway": 0.0, "footway": CURB_HEIGHT_M, "island": CURB_HEIGHT_M}.get(
            self.kind
        )


def ground_zones(
    network: RoadNetwork,
    region: shapely.Polygon,
    features: Sequence[OsmFeature],
    waters: Sequence[WaterBody] = (),
    drivable: shapely.Geometry | None = None,
    country: str = "",
    tell: Progress = untold,
) -> list[Zone]:
    """Return the zones of the ground level; together they tile the region and its margin.

    Args:
        network: the lanes.
        region: region of interest, site frame.
        features: the map's features.
        waters: bodies of water.
        drivable: area mapped as drivable. Gaps between carriageways are carriageway within it, not
            median; beside carriageways it is asphalt flush with the terrain.
        country: ISO 3166-1 alpha-2; empty if unknown.
        tell: called with the share done (0..1) and the current task.
    """
    tell(0.0, "carriageways")
    drivable = shapely.MultiPolygon() if drivable is None else drivable
    carriageway = network.carriageway(0)
    tell(0.15, "footways")
    footway = network.footway(0)
    tell(0.3, "islands")
    paved = area_union([carriageway, footway])
    gaps = area_difference(closed(paved, MEDIAN_M), paved)
    decks = [network.carriageway(level) for level in network.levels[1:]]
    if decks:
        # There is no island between the ends of a bridge.
        gaps = area_difference(gaps, area_union(decks))
    islands, verges = _sorted_out(opened(area_difference(gaps, drivable), SEAM_M), carriageway)
    footway = area_union([footway, *(part for part in verges if part.area < PAVED_M2)])
    # Medians and islands of the lane model are raised, whatever the gap around them.
    raised = _raised(network, 0)
    islands = area_union([islands, area_difference(raised, footway)])
    carriageway = area_difference(carriageway, raised)
    mapped = _mapped_islands(network, features, carriageway)
    if not mapped.is_empty:
        islands, carriageway = area_union([islands, mapped]), area_difference(carriageway, mapped)
    tell(0.5, "gaps between lanes")
    # Gaps too narrow for an island are asphalt between lanes, otherwise paving.
    slits = area_difference(area_intersection(closed(paved, 2 * SEAM_M), gaps), islands)
    driven = area_difference(area_intersection(gaps, drivable), raised)
    seams = area_intersection(slits, closed(carriageway, 2 * SEAM_M))
    carriageway = area_union([carriageway, seams, driven])
    footway = area_difference(area_union([footway, slits]), carriageway)
    tell(0.6, "verges")
    taken = area_union([carriageway, footway, islands])
    everything = area_union(
        [shapely.buffer(region, MARGIN_M, join_style="mitre"), shapely.buffer(taken, VERGE_M)]
    )
    parking = area_intersection(carriageway, network.area_of(("parking",), 0))
    tell(0.7, "ground beside roads")
    zones = [
        _zone("carriageway", area_difference(carriageway, parking), "road", "asphalt"),
        _zone("carriageway", parking, "parking", "asphalt"),
        _zone("footway", footway, "sidewalk", "paving"),
        _zone("island", islands, "other-ground", "concrete"),
    ]
    beside = opened(area_difference(drivable, taken), SEAM_M)
    flush = [(beside, "road", "asphalt"), *_flush_areas(features, waters)]
    for area, semantic, material in each(flush, between(tell, 0.7, 0.95), "ground beside roads"):
        free = area_difference(area_intersection(area, everything), taken)
        if not free.is_empty:
            kind = "terrain" if semantic == "terrain" else "paved"
            if material == "water":
                # Next to paved ground, water has a wall; otherwise its border would be a slope.
                kind, wall = "water", area_intersection(free, grown(taken, WALL_M))
                zones.append(_zone("paved", wall, "other-ground", "concrete"))
                free = area_difference(free, wall)
                taken = area_union([taken, wall])
            zones.append(_zone(kind, free, semantic, material))
            taken = area_union([taken, free])
    tell(0.95, "terrain")
    rest = area_difference(everything, taken)
    zones += [
        _zone("terrain" if semantic == "terrain" else "paved", area, semantic, material)
        for area, (semantic, material) in land_covers(features, rest, country)
    ]
    return [zone for zone in zones if not zone.area.is_empty]


def _sorted_out(
    gaps: shapely.Geometry, carriageway: shapely.Geometry
) -> tuple[shapely.Geometry, list[shapely.Polygon]]:
    """Return the gaps between carriageways, and those beside or behind footways."""
    parts = shapely.get_parts(areas_of(gaps))
    border = shapely.boundary(parts)
    at_kerb = shapely.length(shapely.intersection(border, grown(carriageway, AT_KERB_M)))
    least = np.where(shapely.area(parts) < PAVED_M2, KERB_SHARES[0], KERB_SHARES[1])
    kerb = at_kerb >= least * shapely.length(border)
    return area_union(parts[kerb]), list(parts[~kerb])


def _mapped_islands(
    network: RoadNetwork, features: Sequence[OsmFeature], carriageway: shapely.Geometry
) -> shapely.Geometry:
    """Return the map's raised islands in the carriageway, outside lanes and crossings."""
    found = [
        one.geometry
        for one in features
        if one.tags.get("area:highway") == "traffic_island"
        and one.tags.get("kerb") == "raised"
        and one.geometry.area > 0.0
    ]
    if not found:
        return shapely.MultiPolygon()
    used = network.area_of((*CARRIAGEWAY_KINDS, "connection", "crossing"), 0)
    free = area_difference(area_intersection(area_union(found), carriageway), grown(used, ASIDE_M))
    return opened(free, SEAM_M)


def deck_zones(network: RoadNetwork, level: int) -> list[Zone]:
    """Return the zones of the decks of one level above the ground."""
    raised = _raised(network, level)
    carriageway = area_difference(network.carriageway(level), raised)
    footway = area_difference(network.footway(level), carriageway)
    zones = [
        _zone("carriageway", carriageway, "road", "asphalt"),
        _zone("footway", area_difference(footway, raised), "sidewalk", "paving"),
        _zone("island", raised, "other-ground", "concrete"),
    ]
    return [zone for zone in zones if not zone.area.is_empty]


def _raised(network: RoadNetwork, level: int) -> shapely.Geometry:
    """Return raised medians and islands in plan, outside lanes and crossings."""
    used = network.area_of((*CARRIAGEWAY_KINDS, "connection", "crossing"), level)
    return area_difference(network.area_of(RAISED, level), used)


def _zone(kind: str, area: shapely.Geometry, semantic: str, material: str) -> Zone:
    return Zone(kind, areas_of(area), semantic_id(semantic), material_id(material))


def _flush_areas(
    features: Sequence[OsmFeature], waters: Sequence[WaterBody]
) -> list[tuple[shapely.Geometry, str, str]]:
    """Mapped surfaces beside the lane network, the more important first."""
    groups: dict[tuple[str, str], list[shapely.Geometry]] = {}
    standing = area_union(building_ground(features))
    for feature in features:
        tags, shape = feature.tags, feature.geometry
        if _is_below(tags):
            continue
        is_area = shape.geom_type in ("Polygon", "MultiPolygon")
        highway = tags.get("highway", "")
        if highway in OTHER_WAYS and tags.get("bridge", "no") == "no":
            width, semantic, material = OTHER_WAYS[highway]
            area = shape if is_area else shape.buffer(width / 2, cap_style="flat")
            groups.setdefault((semantic, material), []).append(area)
        elif tags.get("amenity") == "parking" and is_area and _is_open(tags):
            groups.setdefault(("parking", "asphalt"), []).append(shape)
        elif is_area and (cover := mapped_cover(tags)) is not None:
            groups.setdefault(cover, []).append(shape)
    for body in waters:
        groups.setdefault(("other-ground", "water"), []).append(body.area)
        if not body.wall.is_empty:
            groups.setdefault(("other-ground", "concrete"), []).append(body.wall)
    # Ways mapped through a building without a passage are inside it.
    areas = {key: closed(area_union(shapes), SEAM_M) for key, shapes in groups.items()}
    for key, area in areas.items():
        if key[0] in ("road", "sidewalk"):
            areas[key] = area_difference(area, standing)
    order = ["road", "parking", "sidewalk", "other-ground", "terrain"]
    return [
        (areas[key], *key) for key in sorted(areas, key=lambda key: (order.index(key[0]), key[1]))
    ]


def _is_open(tags: dict[str, str]) -> bool:
    """Return whether a car park is on the ground in the open."""
    return tags.get("parking", "surface") not in NOT_ON_THE_GROUND and "building" not in tags


def _is_below(tags: dict[str, str]) -> bool:
    """Return whether a feature is below the ground."""
    if tags.get("tunnel") not in (None, "no", "building_passage"):
        return True
    return tags.get("layer", "0").startswith("-") or tags.get("location") == "underground"
