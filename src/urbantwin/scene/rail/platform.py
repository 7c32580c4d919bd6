"""Platforms of stations and stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from urbantwin.scene.placement import on_ground
from urbantwin.scene.slab import plain_polygons, plan_of, slab
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["add_platforms"]

#: Heights above the rails' ground: trains 0.55 m (TSI PRM: 0.55 or 0.76), trams 0.25 m.
TRAIN_M, TRAM_M = 0.55, 0.25
#: Width of platforms that are mapped as a line; and clearance beside a track, metres.
WIDTH_M, TRACK_M, KERB_M = 3.0, 1.35, 0.05
BURIED_M, FINE_M = 0.3, 4.0
NEAR_TRACK_M = 8.0


def add_platforms(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    buildings: Sequence[Polygon] = (),
) -> int:
    """Add the raised platforms of trains and trams; return how many.

    Bus stops without a mapped height are the sidewalk itself and are not drawn; nor is what lies
    in a building.
    """
    tracks: dict[str, list[Geometry]] = {"tram": [], "train": []}
    for feature in features:
        if isinstance(feature.geometry, LineString) and _is_open(feature.tags):
            railway = feature.tags.get("railway", "")
            if railway in ("tram", "light_rail", "rail", "narrow_gauge", "subway"):
                tracks["tram" if railway == "tram" else "train"].append(feature.geometry)
    lines = {kind: shapely.union_all(found) for kind, found in tracks.items()}
    clear = shapely.union_all([
        carriageway.buffer(KERB_M),
        *(line.buffer(TRACK_M) for line in lines.values()),
        *buildings,
    ])  # fmt: skip
    count = 0
    for feature in features:
        if not _is_platform(feature.tags):
            continue
        height = _height(feature, lines)
        if height is None:
            continue
        area = feature.geometry
        if isinstance(area, LineString):
            width = min(max(length_m_of(feature.tags.get("width")) or WIDTH_M, 1.0), 12.0)
            area = area.buffer(width / 2, cap_style="flat", join_style="mitre")
        if not area.geom_type.endswith("Polygon"):
            continue
        area = shapely.intersection(shapely.difference(area, clear), region)
        part = assembly.new_part()
        shapes = plain_polygons(area.simplify(0.05), smallest_m2=1.0)
        for shape in shapes:
            fine = shapely.segmentize(shape, FINE_M)
            xy, _, _ = plan_of(fine)
            ground = on_ground(xy, ground_height(xy))[:, 2]
            body = slab(fine, ground - BURIED_M, ground + height)
            top = body.rises() > 0.5
            kinds = np.where(top, semantic_id("sidewalk"), semantic_id("other-structure"))
            matter = np.where(top, material_id("paving"), material_id("concrete"))
            assembly.add(body, kinds, matter, part)
        count += bool(shapes)
    return count


def _is_open(tags: Mapping[str, str]) -> bool:
    return (
        tags.get("tunnel", "no") == "no"
        and tags.get("location") not in ("underground", "indoor")
        and tags.get("indoor", "no") == "no"
        and not tags.get("layer", "0").startswith("-")
        and not tags.get("level", "0").startswith("-")
        and tags.get("subway") != "yes"
    )


def _is_platform(tags: Mapping[str, str]) -> bool:
    named = "platform" in (tags.get("railway"), tags.get("public_transport"), tags.get("highway"))
    return named and _is_open(tags) and "building" not in tags


def _height(feature: OsmFeature, lines: Mapping[str, Geometry]) -> float | None:
    """Return a platform's height; ``None`` for one that is not raised."""
    tags = feature.tags
    said = length_m_of(tags.get("height") or tags.get("platform:height"))
    if said is not None:
        return min(max(said, 0.05), 1.4)
    if tags.get("bus") == "yes" and tags.get("tram") != "yes" and tags.get("train") != "yes":
        return None
    near = {
        kind: line.distance(feature.geometry) if not line.is_empty else np.inf
        for kind, line in lines.items()
    }
    if tags.get("train") == "yes" or near["train"] < min(near["tram"], NEAR_TRACK_M):
        return TRAIN_M
    if tags.get("tram") == "yes" or near["tram"] < NEAR_TRACK_M:
        return TRAM_M
    return TRAIN_M if tags.get("railway") == "platform" else None
