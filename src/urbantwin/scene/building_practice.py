"""How buildings usually look: tags that nobody mapped, drawn by country, kind and size.

A street of equal boxes is no street. What mappers left out of a building's material, colours and
roof is drawn from what is usual where it stands, with a generator of random numbers that its id
seeds: the same building looks the same in every twin, and its neighbour does not. All shares and
colours are estimates, from photographs of streets: they say what is common, not what stands there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Geometry, Polygon

from urbantwin.scene.building_height import ROOF_TYPES, building_materials, building_type
from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["Neighbours", "usual_tags"]

SEED = 2
Shares = Mapping[str, float]

PLASTERS = ("#e8e0d0", "#f0ece2", "#e3d3b0", "#d9c7a2", "#d8d8d4", "#cfd6d3", "#e6c9b0", "#c9b79c")
BRIGHT = ("#e9d8a6", "#d9e0c4", "#e7b98f", "#c4d4dc", "#efe6e0", "#d7a98c", "#e8e0d0")
#: Colours of walls by their material.
WALL_COLOURS: Mapping[str, Sequence[str]] = {
    "brick": ("#8a5a4a", "#9b6a56", "#a67a63", "#7c5346", "#a1806a", "#b39a7c"),
    "plaster": PLASTERS,
    "concrete": ("#c4c1b9", "#b3b1ab", "#d0cdc5", "#a7a7a3", "#c9c2b2"),
    "stone": ("#b9b09c", "#a8a192", "#c9bda0", "#9b9588"),
    "wood": ("#f1efe8", "#c9d2d6", "#8a6f55", "#7f8f7a", "#d9cfae", "#6d7b86", "#b9a58c"),
    "metal-painted": ("#c8ccce", "#9aa5ad", "#b7b3a8", "#7f8b93", "#e3e3df", "#8fa3b0"),
    "glass": ("#6f8ea6", "#7d98a8"),
}
#: Colours of roofs by their material.
ROOF_COLOURS: Mapping[str, Sequence[str]] = {
    "roof-tile": ("#9c5f49", "#8c5646", "#a76d50", "#7a5347", "#5b4d48", "#4c4b4d"),
    "slate": ("#54595f", "#61656b", "#474c52", "#6a6a6e"),
    "roofing-felt": ("#6a6c6e", "#7b7c7b", "#5f5a55", "#75685c", "#4f5357", "#8b8a86"),
    "gravel": ("#9c988e", "#a9a59b", "#8d8a82"),
    "concrete": ("#aaa79f", "#b9b6ae", "#9d9a93"),
    "metal-painted": ("#8d979d", "#a7adb0", "#6f7a80", "#66706b", "#76554c"),
    "grass": ("#7f9f52",),
    "glass": ("#8ba3b1",),
}


@dataclass(frozen=True)
class Practice:
    """What is usual in some countries, in shares of 1.

    Attributes:
        house: materials of the walls of small houses.
        block: materials of the walls of larger buildings where people live.
        shapes: of the roofs of small houses.
        sloped: materials of sloped roofs.
        level: materials of level roofs.
        plasters: colours of plaster.
    """

    house: Shares
    block: Shares
    shapes: Shares
    sloped: Shares
    level: Shares
    plasters: Sequence[str] = PLASTERS


FELT = {"tar_paper": 0.6, "gravel": 0.3, "concrete": 0.1}
SLABS = {"concrete": 0.8, "tar_paper": 0.2}
CENTRAL = Practice(
    house={"plaster": 0.85, "brick": 0.1, "wood": 0.05},
    block={"plaster": 0.75, "brick": 0.1, "concrete": 0.15},
    shapes={"gabled": 0.6, "hipped": 0.2, "half-hipped": 0.1, "flat": 0.1},
    sloped={"roof_tiles": 0.85, "slate": 0.15},
    level=FELT,
)
BRITISH = Practice(
    house={"brick": 0.72, "plaster": 0.2, "stone": 0.08},
    block={"brick": 0.65, "plaster": 0.15, "concrete": 0.15, "stone": 0.05},
    shapes={"gabled": 0.68, "hipped": 0.28, "flat": 0.04},
    sloped={"roof_tiles": 0.6, "slate": 0.4},
    level=FELT,
)
LOW = Practice(
    house={"brick": 0.85, "plaster": 0.15},
    block={"brick": 0.7, "plaster": 0.1, "concrete": 0.2},
    shapes={"gabled": 0.65, "hipped": 0.1, "flat": 0.25},
    sloped={"roof_tiles": 0.9, "slate": 0.1},
    level=FELT,
)
NORDIC = Practice(
    house={"wood": 0.65, "plaster": 0.2, "brick": 0.15},
    block={"plaster": 0.5, "brick": 0.25, "concrete": 0.25},
    shapes={"gabled": 0.75, "hipped": 0.1, "flat": 0.15},
    sloped={"metal": 0.45, "roof_tiles": 0.4, "tar_paper": 0.15},
    level=FELT,
)
LATIN = Practice(
    house={"plaster": 0.75, "stone": 0.15, "brick": 0.1},
    block={"plaster": 0.7, "stone": 0.15, "concrete": 0.1, "brick": 0.05},
    shapes={"gabled": 0.4, "hipped": 0.35, "flat": 0.25},
    sloped={"roof_tiles": 0.95, "slate": 0.05},
    level={"concrete": 0.4, "tar_paper": 0.3, "gravel": 0.3},
    plasters=(*PLASTERS, *BRIGHT),
)
NORTH_AMERICA = Practice(
    house={"wood": 0.65, "brick": 0.2, "plaster": 0.15},
    block={"brick": 0.4, "plaster": 0.25, "wood": 0.15, "concrete": 0.2},
    shapes={"gabled": 0.6, "hipped": 0.32, "flat": 0.08},
    sloped={"tar_paper": 0.92, "metal": 0.08},
    level=FELT,
)
OCEANIA = Practice(
    house={"brick": 0.55, "wood": 0.3, "plaster": 0.15},
    block={"brick": 0.4, "plaster": 0.3, "concrete": 0.3},
    shapes={"hipped": 0.5, "gabled": 0.42, "flat": 0.08},
    sloped={"metal": 0.5, "roof_tiles": 0.5},
    level={"metal": 0.5, "concrete": 0.3, "tar_paper": 0.2},
)
JAPAN = Practice(
    house={"plaster": 0.6, "wood": 0.15, "metal": 0.25},
    block={"concrete": 0.55, "plaster": 0.3, "brick": 0.15},
    shapes={"gabled": 0.45, "hipped": 0.3, "flat": 0.25},
    sloped={"roof_tiles": 0.35, "slate": 0.45, "metal": 0.2},
    level=SLABS,
)
EAST_ASIA = Practice(
    house={"concrete": 0.35, "plaster": 0.4, "brick": 0.25},
    block={"concrete": 0.5, "plaster": 0.35, "brick": 0.15},
    shapes={"flat": 0.75, "gabled": 0.2, "hipped": 0.05},
    sloped={"metal": 0.6, "roof_tiles": 0.4},
    level=SLABS,
)
WARM = Practice(
    house={"plaster": 0.75, "brick": 0.15, "concrete": 0.1},
    block={"plaster": 0.65, "concrete": 0.3, "brick": 0.05},
    shapes={"flat": 0.75, "gabled": 0.15, "hipped": 0.1},
    sloped={"roof_tiles": 0.55, "metal": 0.45},
    level=SLABS,
    plasters=BRIGHT,
)
#: Country (ISO 3166-1 alpha-2) -> what is usual there; the practice of warm countries elsewhere.
PRACTICES: Mapping[str, Practice] = {
    **dict.fromkeys("DE AT CH LI LU CZ SK PL HU SI HR LT LV EE UA BY RU".split(), CENTRAL),
    **dict.fromkeys("GB IE IM JE GG".split(), BRITISH),
    **dict.fromkeys("NL BE DK".split(), LOW),
    **dict.fromkeys("SE NO FI IS FO AX GL".split(), NORDIC),
    **dict.fromkeys("FR ES PT IT GR MT CY MC SM AD RO BG RS BA ME MK AL TR".split(), LATIN),
    **dict.fromkeys("US CA".split(), NORTH_AMERICA),
    **dict.fromkeys("AU NZ".split(), OCEANIA),
    "JP": JAPAN,
    **dict.fromkeys("TW KR CN HK MO SG".split(), EAST_ASIA),
    "": CENTRAL,
}
#: Walls of buildings that are used for something else than living, whatever the country.
HALLS = {"metal": 0.6, "concrete": 0.25, "brick": 0.15}
OFFICES = {"concrete": 0.4, "stone": 0.2, "plaster": 0.25, "brick": 0.15}
PUBLIC = {"brick": 0.35, "plaster": 0.35, "concrete": 0.3}
SACRED = {"stone": 0.6, "brick": 0.4}
BARE = {"concrete": 1.0}
SMALL = {"concrete": 0.4, "brick": 0.3, "wood": 0.2, "plaster": 0.1}
WALLS_OF_KIND: Mapping[str, Shares] = {
    **dict.fromkeys(("industrial", "warehouse", "hangar", "manufacture", "factory"), HALLS),
    **dict.fromkeys(("supermarket", "sports_hall", "barn", "farm_auxiliary", "stable"), HALLS),
    **dict.fromkeys(("office", "commercial", "retail", "hotel", "bank", "mixed_use"), OFFICES),
    **dict.fromkeys(("parking", "train_station", "transportation"), BARE),
    **dict.fromkeys(("school", "university", "college", "hospital", "kindergarten"), PUBLIC),
    **dict.fromkeys(("public", "civic", "government", "fire_station"), PUBLIC),
    **dict.fromkeys(("church", "chapel", "cathedral", "monastery"), SACRED),
    **dict.fromkeys(("garage", "garages", "shed", "hut", "service", "toilets"), SMALL),
}
#: Kinds of houses, and of buildings that may be houses, whose roof is drawn.
HOUSES = frozenset(
    "house detached semidetached_house terrace residential bungalow farm villa cabin yes".split()
)
#: No roof is drawn that is higher, or covers less or more, than those of houses: metres, m2.
HIGHEST_M, LEVELS, SMALLEST_M2, LARGEST_M2 = 11.0, 3.0, 30.0, 350.0
#: Nor one of a plan of more corners, or that fills less of its tightest rectangle.
CORNERS, FULL = 14, 0.62
#: Walls this near to another building's are party walls, metres; a house with this share of them is
#: one of a row.
PARTY_M, ROW = 0.4, 0.25
#: Colours of one kind differ by this share in brightness.
SHADES = 0.07
#: Tags that say what a roof is like.
ROOF_KEYS = ("roof:shape", "building:roof:shape", "roof:height", "roof:angle", "roof:levels")


class Neighbours:
    """The footprints of a place's buildings, to tell which houses are built in rows."""

    def __init__(self, plans: Sequence[Geometry]) -> None:
        self._plans = list(plans)
        self._tree = shapely.STRtree(self._plans)

    def party_walls(self, number: int) -> Geometry:
        """Return the parts of a building's outline that other buildings touch."""
        plan = self._plans[number]
        near = self._tree.query(plan, predicate="dwithin", distance=PARTY_M)
        others = [self._plans[k] for k in np.sort(near).tolist() if k != number]
        return plan.boundary.intersection(shapely.union_all(others).buffer(PARTY_M))


def usual_tags(
    building: MappedBuilding, country: str, number: int, neighbours: Neighbours
) -> dict[str, str]:
    """Return tags for what the map does not say of a building: materials, colours, its roof.

    Args:
        building: the building.
        country: ISO 3166-1 alpha-2; empty if unknown.
        number: its place among the ``neighbours``.
        neighbours: the footprints of all buildings.
    """
    kind = building_type(building.tags)
    if kind in ROOF_TYPES or kind in ("greenhouse", "conservatory"):
        return {}
    rng = np.random.default_rng([SEED, abs(building.id)])
    draws = rng.random(7)  # always as many, so that a tag that is mapped changes no other
    practice = PRACTICES.get(country, WARM)
    tags = building.tags
    found: dict[str, str] = {}
    house = _is_house(building, kind)
    shape = _drawn(practice.shapes, draws[0]) if house else "flat"
    if house and not any(key in tags for key in ROOF_KEYS):
        walls = neighbours.party_walls(number)
        if walls.length > ROW * building.plan().boundary.length and shape != "flat":
            shape = "gabled"
            if _runs_along(walls, building.footprints[0]):
                found["roof:orientation"] = "across"
        found["roof:shape"] = shape
    elif "roof:shape" in tags:
        shape = tags["roof:shape"]
    elif any(key in tags for key in ROOF_KEYS):
        shape = "gabled"
    walls_of = WALLS_OF_KIND.get(kind, practice.house if house else practice.block)
    found["building:material"] = _drawn(walls_of, draws[1])
    found["roof:material"] = _drawn(
        practice.level if shape == "flat" else practice.sloped, draws[2]
    )
    wall, roof = building_materials({**found, **tags}, {})
    colours = practice.plasters if wall == "plaster" else WALL_COLOURS.get(wall, PLASTERS)
    found["building:colour"] = _shade(colours, draws[3], draws[4])
    colours = ROOF_COLOURS.get(roof, ROOF_COLOURS["roofing-felt"])
    found["roof:colour"] = _shade(colours, draws[5], draws[6])
    return {key: value for key, value in found.items() if key not in tags}


def _is_house(building: MappedBuilding, kind: str) -> bool:
    """Return whether a building may be a small house, with a roof as those have."""
    if kind not in HOUSES or building.parts or len(building.footprints) != 1:
        return False
    plan = building.footprints[0]
    height = length_m_of(building.tags.get("height"))
    levels = count_of(building.tags.get("building:levels"))
    return (
        SMALLEST_M2 <= plan.area <= LARGEST_M2
        and not plan.interiors
        and len(plan.exterior.coords) - 1 <= CORNERS
        and plan.area > FULL * plan.minimum_rotated_rectangle.area
        and (height is None or height <= HIGHEST_M)
        and (levels is None or levels <= LEVELS)
        and "min_height" not in building.tags
    )


def _runs_along(walls: Geometry, plan: Polygon) -> bool:
    """Return whether party walls run along the longer side of a plan more than across it."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(plan))
    sides = np.diff(corners[:3], axis=0)
    length = np.hypot(*sides.T)
    longer = sides[int(length[1] > length[0])] / max(float(length.max()), 1e-9)
    along = across = 0.0
    for line in shapely.get_parts(walls):
        leg = np.diff(shapely.get_coordinates(line), axis=0)
        along += float(np.abs(leg @ longer).sum())
        across += float(np.abs(leg @ [-longer[1], longer[0]]).sum())
    return along > across


def _drawn(shares: Shares, draw: float) -> str:
    """Return what a number from 0 to 1 draws from shares."""
    names = list(shares)
    sums = np.cumsum(list(shares.values()))
    return names[min(int(np.searchsorted(sums / sums[-1], draw, side="right")), len(names) - 1)]


def _shade(colours: Sequence[str], draw: float, shade: float) -> str:
    """Return one of some colours, a little lighter or darker."""
    colour = colours[min(int(draw * len(colours)), len(colours) - 1)]
    bright = 1 + SHADES * (2 * shade - 1)
    levels = [min(round(int(colour[k : k + 2], 16) * bright), 255) for k in (1, 3, 5)]
    return "#" + "".join(f"{level:02x}" for level in levels)
