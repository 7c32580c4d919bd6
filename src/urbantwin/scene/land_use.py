"""Land use: the ground cover beside roads and ways, from the map and from surrounding buildings.

Mapped covers (grass, sand, a paved square) are used as they are. Mapped land use gives the use of
the ground but not its cover, which is then estimated between and around buildings. Yards and town
centres are paved, gardens have grass and a paved strip along the building, and open land has grass,
or soil in desert countries. Where no land use is mapped, it is derived from the density, the use
and the size of the buildings.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import shapely

from urbantwin.geometry import (
    area_difference,
    area_intersection,
    area_union,
    grown,
)
from urbantwin.scene.building_height import building_type
from urbantwin.scene.building_outline import building_footprints
from urbantwin.site.extract import OsmFeature

__all__ = ["TOWN", "Cover", "land_covers", "mapped_cover", "use_of_building"]

#: A cover: its semantic class and its material.
Cover = tuple[str, str]

GRASS, SOIL = ("terrain", "grass"), ("terrain", "soil")
PAVING, CONCRETE = ("other-ground", "paving"), ("other-ground", "concrete")
ASPHALT, GRAVEL = ("other-ground", "asphalt"), ("other-ground", "gravel")

#: Values of ``surface`` and their covers.
SURFACES = {
    **dict.fromkeys(("asphalt", "tartan", "paved", "chipseal"), ASPHALT),
    **dict.fromkeys(("concrete", "concrete:plates", "acrylic"), CONCRETE),
    **dict.fromkeys(("paving_stones", "sett", "cobblestone", "bricks", "tiles"), PAVING),
    **dict.fromkeys(("gravel", "fine_gravel", "pebblestone", "compacted", "rock"), GRAVEL),
    **dict.fromkeys(("ground", "dirt", "earth", "sand", "clay", "unpaved", "mud"), SOIL),
    **dict.fromkeys(("grass", "grass_paver", "artificial_turf", "woodchips"), GRASS),
}
#: Tags that define the ground cover.
COVERS: Mapping[str, Mapping[str, Cover]] = {
    "landuse": {
        **dict.fromkeys(("grass", "forest", "meadow", "village_green", "orchard"), GRASS),
        **dict.fromkeys(("recreation_ground", "cemetery", "vineyard", "allotments"), GRASS),
        **dict.fromkeys(("flowerbed", "greenfield", "greenery"), GRASS),
        **dict.fromkeys(("construction", "brownfield", "landfill", "farmland"), SOIL),
        **dict.fromkeys(("railway", "quarry"), GRAVEL),
    },
    "leisure": {
        **dict.fromkeys(("park", "garden", "pitch", "golf_course", "dog_park"), GRASS),
        "playground": SOIL,
    },
    "natural": {
        **dict.fromkeys(("grassland", "wood", "scrub", "heath", "wetland", "shrubbery"), GRASS),
        **dict.fromkeys(("sand", "beach"), SOIL),
        **dict.fromkeys(("bare_rock", "scree", "shingle"), GRAVEL),
    },
}
#: Tags that define the use of the ground.
USES: Mapping[str, Mapping[str, str]] = {
    "landuse": {
        **dict.fromkeys(("residential",), "dwellings"),
        **dict.fromkeys(("commercial", "retail"), "business"),
        **dict.fromkeys(("industrial", "garages", "depot", "port", "farmyard"), "industry"),
        **dict.fromkeys(("education", "institutional", "religious", "civic_admin"), "institution"),
    },
    "amenity": dict.fromkeys(
        ("school", "university", "college", "kindergarten", "hospital", "place_of_worship"),
        "institution",
    ),
    "place": {"square": "square"},
}
#: Use of the ground around kinds of buildings; for other kinds it is dwellings.
USE_OF_BUILDING = {
    **dict.fromkeys(("retail", "commercial", "office", "supermarket", "hotel"), "business"),
    **dict.fromkeys(("train_station", "mall", "kiosk", "mixed_use"), "business"),
    **dict.fromkeys(("industrial", "warehouse", "hangar", "manufacture", "factory"), "industry"),
    **dict.fromkeys(("school", "university", "college", "hospital", "church"), "institution"),
    **dict.fromkeys(("public", "civic", "government", "kindergarten"), "institution"),
}
#: Larger buildings of no mapped use are not dwellings, square metres.
LARGE_M2 = 900.0
#: Maximum distance of ground that belongs to a building; width of the paved strip along walls,
#: metres.
AROUND_M, STRIP_M = 12.0, 1.5
#: If buildings cover more than this share of the ground beside the roads, within this distance of a
#: piece, all ground between them is paved: rows of houses with gardens are below it.
DENSE, DENSITY_M = 0.4, 25.0
#: Minimum share of the ground beside the roads covered by buildings in a town.
TOWN = 0.1
#: Pieces of a town's ground smaller than this are paved if nothing is on them, square metres.
SMALL_M2 = 250.0
#: Countries in whose towns yards are paved rather than green (an estimate, from street-level
#: photographs), and those whose open land is desert: ISO 3166-1 alpha-2.
PAVED_YARDS = frozenset("JP TW KR CN HK MO SG IN BD PK LK NP TH VN KH MY ID PH EG MA NG GH".split())
DESERT = frozenset("AE SA QA KW BH OM YE EG LY JO IQ NE TD MR EH DJ".split())


def mapped_cover(tags: Mapping[str, str]) -> Cover | None:
    """Return the cover defined by the tags of an area, or ``None``."""
    for key, values in COVERS.items():
        if tags.get(key) in values:
            return SURFACES.get(tags.get("surface", ""), values[tags[key]])
    return None


def land_covers(
    features: Sequence[OsmFeature], ground: shapely.Geometry, country: str = ""
) -> list[tuple[shapely.Geometry, Cover]]:
    """Return the covers of ground without a mapped cover, as a partition of it.

    Args:
        features: the map's features, site frame.
        ground: the ground, including ground below buildings.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    buildings = area_union(building_footprints(features))
    taken = area_intersection(buildings, ground).area
    town = taken > TOWN * ground.area if not ground.is_empty else False
    around, strip = grown(buildings, AROUND_M), grown(buildings, STRIP_M)
    built, open_or_built = (
        shapely.STRtree(shapely.get_parts(area))
        for area in (area_intersection(buildings, ground), ground)
    )
    found: dict[Cover, list[shapely.Geometry]] = defaultdict(list)
    for use, area in _uses(features, ground, buildings, around):
        near = area_intersection(area, around)
        far = area_difference(area, near)
        if use == "square":
            found[PAVING].append(area)
        elif use == "business":
            found[PAVING].append(near)
            found[ASPHALT].append(far)
        elif use == "industry":
            found[CONCRETE].append(near)
            found[ASPHALT].append(far)
        elif use == "institution":
            found[PAVING].append(near)
            found[GRASS].append(far)
        else:
            for block in near.geoms:
                about = block.buffer(DENSITY_M)
                if _area_in(about, built) > DENSE * _area_in(about, open_or_built):
                    found[PAVING].append(block)
                else:
                    yard = CONCRETE if country in PAVED_YARDS else GRASS
                    found[PAVING].append(area_intersection(block, strip))
                    found[yard].append(area_difference(block, strip))
            for piece in far.geoms:
                found[_open_ground(piece, country, town=town)].append(piece)
    covers = [(area_union(areas), cover) for cover, areas in sorted(found.items())]
    return [(area, cover) for area, cover in covers if not area.is_empty]


def _uses(
    features: Sequence[OsmFeature],
    ground: shapely.Geometry,
    buildings: shapely.Geometry,
    around: shapely.Geometry,
) -> Iterable[tuple[str, shapely.MultiPolygon]]:
    """Yield parts of the ground with their use; smaller mapped areas come first."""
    mapped = [
        (feature.geometry.area, number, USES[key][feature.tags[key]])
        for number, feature in enumerate(features)
        for key in USES
        if feature.geometry.geom_type in ("Polygon", "MultiPolygon")
        and "building" not in feature.tags
        and feature.tags.get(key) in USES[key]
    ]
    rest = ground
    for _, number, use in sorted(mapped):
        own = area_intersection(rest, features[number].geometry)
        if not own.is_empty:
            yield use, own
            rest = area_difference(rest, own)
    kinds = _kinds(features)
    near = area_intersection(rest, around)
    for block in near.geoms:
        yield _use_of_buildings(block, kinds), shapely.MultiPolygon([block])
    yield "open", area_difference(rest, near)


def use_of_building(feature: OsmFeature) -> str:
    """Return the use of the ground around a building."""
    kind = building_type(feature.tags)
    plain = "business" if kind == "yes" and feature.geometry.area > LARGE_M2 else "dwellings"
    if "shop" in feature.tags or "office" in feature.tags:
        plain = "business"
    return USE_OF_BUILDING.get(kind, plain)


def _kinds(features: Iterable[OsmFeature]) -> tuple[shapely.STRtree, list[str]]:
    """Return buildings, and the use of the ground around each."""
    shapes, uses = [], []
    for feature in features:
        if feature.tags.get("building", "no") == "no" or not feature.geometry.area:
            continue
        shapes.append(feature.geometry)
        uses.append(use_of_building(feature))
    return shapely.STRtree(shapes), uses


def _use_of_buildings(block: shapely.Polygon, kinds: tuple[shapely.STRtree, Sequence[str]]) -> str:
    """Return the use of the largest share of the built area of a block."""
    tree, uses = kinds
    area: dict[str, float] = defaultdict(float)
    for k in np.sort(tree.query(block, predicate="intersects")).tolist():
        area[uses[k]] += shapely.area(tree.geometries[k])
    return max(sorted(area), key=lambda use: area[use], default="dwellings")


def _area_in(about: shapely.Geometry, parts: shapely.STRtree) -> float:
    """Return the total area of some areas within another, square metres."""
    near = parts.geometries[parts.query(about, predicate="intersects")]
    return float(shapely.area(shapely.intersection(near, about)).sum())


def _open_ground(piece: shapely.Polygon, country: str, *, town: bool) -> Cover:
    """Return the cover of ground away from buildings."""
    if town and (piece.area < SMALL_M2 or country in PAVED_YARDS):
        return PAVING if piece.area < SMALL_M2 else CONCRETE
    return SOIL if country in DESERT else GRASS
