"""The ground that buildings stand on: no sidewalk, no parking and no pole is there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import shapely

from urbantwin.geometry import area_difference, area_union
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.passage import passages_of
from urbantwin.site.extract import OsmFeature

__all__ = ["building_ground"]

#: Values of ``building`` that are roofs without walls: one walks under them.
ROOFS = ("roof", "carport", "canopy")
#: A building or part whose underside is higher than this stands over the ground, metres.
HEADROOM_M = 2.0


def building_ground(
    features: Iterable[OsmFeature], touching: shapely.Geometry | None = None
) -> list[shapely.Polygon]:
    """Return the ground under buildings in plan, apart from passages and arcades.

    Roofs on posts, what is underground and what hangs over the ground are left out.

    Args:
        features: the map's features, site frame.
        touching: buildings that do not touch it are left out.
    """
    features = list(features)
    standing = [
        feature.geometry
        for feature in features
        if feature.geometry.geom_type in ("Polygon", "MultiPolygon")
        and _stands(feature.tags)
        and (touching is None or touching.intersects(feature.geometry))
    ]
    passages = [passage.corridor for passage in passages_of(features)]
    ground = area_difference(area_union(standing), area_union(passages))
    return [part for part in shapely.get_parts(ground) if not part.is_empty]


def _stands(tags: Mapping[str, str]) -> bool:
    """Return whether a feature is a building whose walls stand on the ground."""
    kind = tags.get("building", "no")
    if kind == "no" or kind in (*ROOFS, "underground") or tags.get("location") == "underground":
        return False
    if tags.get("layer", "0").strip().startswith("-"):
        return False
    lowest = metres(tags.get("min_height")) or 0.0
    storeys = tags.get("building:min_level", "0").strip()
    return lowest < HEADROOM_M and storeys in ("0", "")
