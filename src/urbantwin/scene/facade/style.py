"""Facade styles by kind of building: sizes and spacing of windows.

Sizes are usual ones. A window of a dwelling is about 1.2 m wide and 1.4 m high over a sill of 0.9
m. It is recessed by half a brick or slightly less. DIN 5034-1 requires a head at 2.2 m or more and
a sill of at most 0.9 m. Offices have wider windows, halls a band under the eaves, churches tall
windows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point

from urbantwin.scene.building_height import building_type
from urbantwin.scene.building_volume import Volume
from urbantwin.scene.facade.wall import DOOR, GLASS
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["Door", "Style", "mapped_doors", "mapped_shops", "style_of"]

#: Width, height and pane by ``entrance`` value, metres.
SIZES = {
    "main": (1.4, 2.3, DOOR),
    "shop": (1.6, 2.4, GLASS),
    "garage": (2.6, 2.2, DOOR),
    "delivery": (2.0, 2.3, DOOR),
    "emergency": (1.0, 2.1, DOOR),
    "exit": (1.2, 2.1, DOOR),
}
OTHER = (1.1, 2.1, DOOR)


@dataclass(frozen=True)
class Door:
    """A door: its position in plan, its size in metres, and the kind of its pane."""

    place: Point
    width: float
    height: float
    kind: int


def mapped_doors(features: Iterable[OsmFeature]) -> list[Door]:
    """Return the mapped doors: nodes with ``entrance`` or ``door``."""
    doors = []
    for feature in features:
        tags = feature.tags
        if not isinstance(feature.geometry, Point) or not tags.keys() & {"entrance", "door"}:
            continue
        if tags.get("entrance") == "no" or tags.get("level", "0").startswith("-"):
            continue
        width, height, kind = SIZES.get(tags.get("entrance", ""), OTHER)
        width = length_m_of(tags.get("door:width", tags.get("width"))) or width
        height = length_m_of(tags.get("door:height")) or height
        doors.append(
            Door(
                shapely.force_2d(feature.geometry),
                min(max(width, 0.6), 6.0),
                min(max(height, 1.8), 5.0),
                kind,
            )
        )
    return doors


@dataclass(frozen=True)
class Style:
    """The windows of a body; lengths in metres.

    Attributes:
        width, height: size of a window.
        sill: its height above its storey's floor.
        spacing: distance between windows, centre to centre.
        depth: depth of its reveal.
        storeys: heights (S,) of the storeys' floors above the building's ground.
        ground: openings of the lowest storey: ``windows``, ``shop``, ``garage`` or ``nothing``.
    """

    width: float
    height: float
    sill: float
    spacing: float
    depth: float
    storeys: tuple[float, ...]
    ground: str = "windows"


DWELLING = Style(1.2, 1.4, 0.9, 2.7, 0.12, ())
HOUSE = Style(1.2, 1.3, 0.9, 3.3, 0.12, ())
OFFICE = Style(1.9, 1.7, 0.85, 2.8, 0.12, ())
RETAIL = replace(OFFICE, ground="shop")
HALL = Style(2.4, 1.0, 0.6, 5.0, 0.10, ())
CHURCH = Style(1.1, 0.5, 0.2, 4.5, 0.15, ())
GARAGE = Style(0.0, 0.0, 0.0, 3.0, 0.12, (), "garage")
BLIND = Style(0.0, 0.0, 0.0, 0.0, 0.12, (), "nothing")

STYLES = {
    **dict.fromkeys(("house", "detached", "semidetached_house", "terrace", "bungalow"), HOUSE),
    **dict.fromkeys(("farm", "cabin", "static_caravan", "houseboat", "villa"), HOUSE),
    **dict.fromkeys(("office", "commercial", "hotel", "public", "government", "civic"), OFFICE),
    **dict.fromkeys(("university", "school", "college", "hospital", "kindergarten"), OFFICE),
    **dict.fromkeys(("train_station", "transportation", "museum", "library"), OFFICE),
    **dict.fromkeys(("retail", "supermarket", "mall", "shop", "kiosk", "mixed_use"), RETAIL),
    **dict.fromkeys(("industrial", "warehouse", "hangar", "manufacture", "barn"), HALL),
    **dict.fromkeys(("sports_hall", "sports_centre", "stable", "factory"), HALL),
    **dict.fromkeys(("church", "chapel", "cathedral", "basilica", "monastery"), CHURCH),
    **dict.fromkeys(("mosque", "temple", "synagogue", "shrine", "religious"), CHURCH),
    **dict.fromkeys(("garage", "garages"), GARAGE),
    **dict.fromkeys(("shed", "hut", "sty", "cowshed", "toilets", "service", "tent"), BLIND),
    **dict.fromkeys(("parking", "greenhouse", "conservatory", "silo", "storage_tank"), BLIND),
    **dict.fromkeys(("tower", "water_tower", "transformer_tower", "bunker", "ruins"), BLIND),
    **dict.fromkeys(("construction", "grandstand", "stadium", "pavilion", "bridge"), BLIND),
    **dict.fromkeys(("roof", "carport", "canopy", "container", "tank", "chimney"), BLIND),
}
#: Kinds whose windows span one tall storey, with sizes as shares of it.
TALL = (HALL, CHURCH)
NO_WINDOWS = ("no", "none", "0")
SHOPS = ("restaurant", "cafe", "bar", "pub", "fast_food", "bank", "pharmacy", "marketplace")
#: Bodies lower than this have no windows; bodies higher than this above ground have no ground
#: floor.
LOWEST_M = 2.3
THINNEST_M = 1.0


def style_of(volume: Volume, outline: Mapping[str, str], rng: np.random.Generator) -> Style | None:
    """Return the windows of a body, or ``None`` if it has no facade of its own.

    Args:
        volume: the body and its tags.
        outline: tags of the building that it is a part of.
        rng: generator seeded by the building: sizes differ slightly between buildings.
    """
    tags = {**outline, **volume.tags}
    vary = rng.uniform(0.92, 1.08, 4)
    rise = volume.eaves_m - max(volume.body.low, 0.0)
    if volume.is_roof or rise < LOWEST_M or volume.materials[0] == "glass":
        return None
    if volume.body.footprint.buffer(-THINNEST_M / 2).is_empty:
        return None  # the reveals of both sides would intersect
    if any(tags.get(key) in NO_WINDOWS for key in ("window", "windows", "building:window")):
        return replace(BLIND, storeys=(0.0,))
    kind = building_type(volume.tags)
    if kind == "yes":
        kind = building_type(outline)
    style = STYLES.get(kind, DWELLING)
    if style.ground == "windows" and ("shop" in tags or tags.get("amenity") in SHOPS):
        style = replace(style, ground="shop")
    base = max(volume.body.low, 0.0)
    if style in TALL:
        style = replace(style, storeys=(base,), sill=style.sill * rise)
        return replace(style, height=max(0.5 * rise if style.width < 2 else 1.0, 0.8))
    count = max(1, round(rise / volume.storey_m))
    storey = rise / count
    floors = _floors_below(base, storey) + (base + storey * np.arange(count)).tolist()
    height = min(style.height * vary[1], storey - 1.2)
    return replace(
        style,
        width=style.width * vary[0],
        height=height,
        sill=style.sill,
        spacing=style.spacing * vary[2],
        depth=float(np.clip(style.depth * vary[3], 0.10, 0.15)),
        storeys=tuple(floors),
    )


def _floors_below(base: float, storey: float) -> list[float]:
    """Return the floors below a raised body, in line with those of the body below it."""
    count = round(base / storey)
    return (base / max(count, 1) * np.arange(count)).tolist()  # type: ignore[no-any-return]


def mapped_shops(features: Iterable[OsmFeature]) -> NDArray[np.object_]:
    """Return the points of shops and similar features mapped as nodes."""
    return np.array(
        [
            feature.geometry
            for feature in features
            if isinstance(feature.geometry, Point)
            and (
                feature.tags.get("shop", "vacant") != "vacant"
                or feature.tags.get("amenity") in SHOPS
            )
        ],
        dtype=object,
    )
