"""Usual appearance of buildings: tags that are not mapped, drawn by country, kind and size.

A street of equal boxes is not realistic. Materials, colours and roofs that are not mapped are drawn
from those usual in the country, with a random generator seeded by the building's id. So the same
building has the same appearance in every twin, but its neighbour differs. All shares and colours
are estimates from photographs of streets: they describe common buildings, not the actual ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import shapely
import yaml
from shapely import Geometry, Polygon

from urbantwin.scene.building_height import ROOF_TYPES, building_materials, building_type
from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["Neighbours", "usual_tags"]

SEED = 2
Shares = Mapping[str, float]


@dataclass(frozen=True)
class Practice:
    """Usual appearance in some countries, in shares of 1.

    Attributes:
        house: materials of the walls of small houses.
        block: materials of the walls of larger residential buildings.
        shapes: roof shapes of small houses.
        sloped: materials of sloped roofs.
        level: materials of level roofs.
        plasters: colours of plaster.
    """

    house: Shares
    block: Shares
    shapes: Shares
    sloped: Shares
    level: Shares
    plasters: Sequence[str]


@dataclass(frozen=True)
class _Table:
    """``building_practice.yaml``: colours by material, practices by country, walls by kind."""

    wall_colours: Mapping[str, Sequence[str]]
    roof_colours: Mapping[str, Sequence[str]]
    practices: Mapping[str, Practice]
    elsewhere: Practice
    walls_of_kind: Mapping[str, Shares]


@cache
def _table() -> _Table:
    file = files("urbantwin.scene") / "building_practice.yaml"
    read = yaml.safe_load(file.read_text(encoding="utf-8"))
    practices, plasters = {}, read["wall_colours"]["plaster"]
    found: dict[str, Practice] = {}
    for name, row in read["practices"].items():
        countries = row.pop("countries").split()
        practices[name] = Practice(**{"plasters": plasters, **row})
        found |= dict.fromkeys(countries, practices[name])
    return _Table(
        read["wall_colours"],
        read["roof_colours"],
        {"": practices["central"], **found},
        practices["warm"],
        {kind: row["walls"] for row in read["walls_of_kind"] for kind in row["kinds"]},
    )


#: Kinds of houses, and of buildings that may be houses, with a drawn roof.
HOUSES = frozenset(
    "house detached semidetached_house terrace residential bungalow farm villa cabin yes".split()
)
#: Limits of height, levels and area, m and m2, for buildings with a drawn roof: those of houses.
HIGHEST_M, LEVELS, SMALLEST_M2, LARGEST_M2 = 11.0, 3.0, 30.0, 350.0
#: Limits of the number of corners, and of the share of the smallest rectangle, for the same.
CORNERS, FULL = 14, 0.62
#: Maximum distance of party walls from another building, metres; minimum share of party walls of a
#: house in a row.
PARTY_M, ROW = 0.4, 0.25
#: Maximum relative difference in brightness of colours of one kind.
SHADES = 0.07
#: Tags that describe a roof.
ROOF_KEYS = ("roof:shape", "building:roof:shape", "roof:height", "roof:angle", "roof:levels")


class Neighbours:
    """The footprints of all buildings, to detect houses built in rows."""

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
    """Return tags for properties of a building that are not mapped: materials, colours, roof.

    Args:
        building: the building.
        country: ISO 3166-1 alpha-2; empty if unknown.
        number: its index among the ``neighbours``.
        neighbours: the footprints of all buildings.
    """
    kind = building_type(building.tags)
    if kind in ROOF_TYPES or kind in ("greenhouse", "conservatory"):
        return {}
    rng = np.random.default_rng([SEED, abs(building.id)])
    draws = rng.random(7)  # a fixed number, so that a mapped tag does not change other draws
    table = _table()
    practice = table.practices.get(country, table.elsewhere)
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
    walls_of = table.walls_of_kind.get(kind, practice.house if house else practice.block)
    found["building:material"] = _drawn(walls_of, draws[1])
    found["roof:material"] = _drawn(
        practice.level if shape == "flat" else practice.sloped, draws[2]
    )
    wall, roof = building_materials({**found, **tags}, {})
    colours = (
        practice.plasters
        if wall == "plaster"
        else table.wall_colours.get(wall, table.wall_colours["plaster"])
    )
    found["building:colour"] = _shade(colours, draws[3], draws[4])
    colours = table.roof_colours.get(roof, table.roof_colours["roofing-felt"])
    found["roof:colour"] = _shade(colours, draws[5], draws[6])
    return {key: value for key, value in found.items() if key not in tags}


def _is_house(building: MappedBuilding, kind: str) -> bool:
    """Return whether a building may be a small house with a typical roof."""
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
    """Return the name selected from shares by a number from 0 to 1."""
    names = list(shares)
    sums = np.cumsum(list(shares.values()))
    return names[min(int(np.searchsorted(sums / sums[-1], draw, side="right")), len(names) - 1)]


def _shade(colours: Sequence[str], draw: float, shade: float) -> str:
    """Return one of several colours, slightly lighter or darker."""
    colour = colours[min(int(draw * len(colours)), len(colours) - 1)]
    bright = 1 + SHADES * (2 * shade - 1)
    levels = [min(round(int(colour[k : k + 2], 16) * bright), 255) for k in (1, 3, 5)]
    return "#" + "".join(f"{level:02x}" for level in levels)
