"""Statues, monuments, memorials and fountains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from shapely import Polygon

from urbantwin.scene.furniture.piece import Piece, block, drum
from urbantwin.scene.slab import plain_polygons, slab
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import length_m_of

__all__ = ["add_basin", "fountain", "monument", "monument_kind"]

BASIN_M = 2.5
#: Basins of fountains that are mapped as areas.
RIM_M, RIM_HIGH_M, WATER_BELOW_M, BURIED_M = 0.3, 0.45, 0.12, 0.3


def monument_kind(tags: Mapping[str, str]) -> str | None:
    """Return what a monument is: statue, bust, pillar, stone, sculpture; ``None`` if unknown.

    Plaques, paintings and stumbling stones are flat and not drawn.
    """
    said = tags.get("artwork_type") or tags.get("memorial") or tags.get("memorial:type", "")
    said = said.split(";")[0]
    if tags.get("historic") not in ("memorial", "monument", "wayside_cross", "boundary_stone") and (
        tags.get("tourism") != "artwork"
    ):
        return None
    known = {
        "statue": "statue", "bust": "bust", "sculpture": "sculpture", "installation": "sculpture",
        "architecture": "sculpture", "obelisk": "pillar", "column": "pillar", "stele": "stone",
        "stone": "stone", "cross": "pillar", "war_memorial": "stone", "vehicle": "sculpture",
        "totem_pole": "pillar", "fountain": "fountain",
    }  # fmt: skip
    if said in known:
        return known[said]
    if tags.get("historic") == "monument":
        return "statue"
    if tags.get("historic") == "wayside_cross":
        return "pillar"
    return "stone" if tags.get("historic") == "boundary_stone" else None


def monument(kind: str, tags: Mapping[str, str]) -> list[Piece]:
    """Return a monument; its mapped height includes the plinth."""
    usual = {"statue": 3.6, "bust": 2.2, "pillar": 4.0, "stone": 1.6, "sculpture": 2.5}[kind]
    high = min(max(length_m_of(tags.get("height")) or usual, 0.4), 60.0)
    metal = tags.get("material") in ("bronze", "metal", "steel", "iron", "brass", "copper")
    matter = "metal-dark" if metal or kind in ("statue", "bust") else "stone"
    other = "other-structure"
    if kind == "stone":
        return [block([0, 0, 0], [0.35, 0.25 * high + 0.4, high], "stone", other)]
    if kind == "pillar":
        foot = min(0.2 * high, 1.5)
        return [
            block([0, 0, 0], [0.3 * high**0.8, 0.3 * high**0.8, foot], "stone", other),
            drum([0, 0, foot], high - foot, 0.09 * high**0.8, "stone", other, 0.06 * high**0.8),
        ]
    if kind == "sculpture":
        return [
            block([0, 0, 0], [0.5 * high, 0.5 * high, 0.15 * high], "stone", other),
            drum([0, 0, 0.15 * high], 0.5 * high, 0.1 * high, matter, other, 0.24 * high, 7),
            drum([0, 0, 0.65 * high], 0.35 * high, 0.24 * high, matter, other, 0.05 * high, 7),
        ]
    share = 0.5 if kind == "statue" else 0.7
    foot, figure = share * high, (1 - share) * high
    wide = 0.55 * figure if kind == "statue" else 0.8 * figure
    plinth = [block([0, 0, 0], [wide + 0.2, wide + 0.2, foot], "stone", other)]
    if kind == "bust":
        return [
            *plinth,
            drum([0, 0, foot], 0.55 * figure, 0.45 * figure, matter, other, 0.2 * figure),
            drum([0, 0, foot + 0.55 * figure], 0.45 * figure, 0.18 * figure, matter, other),
        ]
    return [
        *plinth,
        drum([0, 0, foot], 0.48 * figure, 0.13 * figure, matter, other, 0.14 * figure),
        drum([0, 0, foot + 0.48 * figure], 0.36 * figure, 0.14 * figure, matter, other),
        drum([0, 0, foot + 0.84 * figure], 0.16 * figure, 0.07 * figure, matter, other),
    ]


def fountain(tags: Mapping[str, str]) -> list[Piece]:
    """Return a round fountain: a rim of 0.5 m, water in it, and a bowl on a pillar."""
    if tags.get("drinking_fountain") == "yes" or tags.get("fountain") in ("drinking", "bubbler"):
        return [block([0, 0, 0], [0.3, 0.3, 0.9], "stone")]
    radius = (length_m_of(tags.get("diameter")) or 2 * BASIN_M) / 2
    radius = min(max(radius, 0.5), 20.0)
    other = "other-structure"
    return [
        drum([0, 0, 0], 0.5, radius, "stone", other, sides=20),
        drum([0, 0, 0.5], 0.02, radius - 0.25, "water", "other-ground", sides=20),
        drum([0, 0, 0.52], 1.0, 0.14 * radius, "stone", other, 0.1 * radius),
        drum([0, 0, 1.52], 0.15, 0.15 * radius, "stone", other, 0.4 * radius, 14),
    ]


def add_basin(assembly: Assembly, area: Polygon, ground_height: GroundHeight) -> bool:
    """Add the basin of a fountain that is mapped as an area; return whether there is one.

    A rim 0.3 m thick, with the water 0.12 m below its top.
    """
    outer = plain_polygons(area.simplify(0.05), smallest_m2=0.5)
    if not outer:
        return False
    ground = ground_height(shapely.get_coordinates(outer))
    ground = ground[np.isfinite(ground)]
    level = float(ground.max()) if len(ground) else 0.0
    low = (float(ground.min()) if len(ground) else 0.0) - BURIED_M
    part = assembly.new_part()
    for shape in outer:
        pools = plain_polygons(shape.buffer(-RIM_M, join_style="mitre"), smallest_m2=0.2)
        rims = plain_polygons(shapely.difference(shape, shapely.union_all(pools)))
        for rim in rims:
            solid = slab(rim, low, level + RIM_HIGH_M)
            assembly.add(solid, "other-structure", "stone", part)
        for pool in pools:
            sheet = slab(pool, low, level + RIM_HIGH_M - WATER_BELOW_M)
            assembly.add(sheet, "other-ground", "water", part)
    return True
