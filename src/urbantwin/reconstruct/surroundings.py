"""Known data of a site before import: the reference for fitting and comparing imports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.number_text import whole_number
from urbantwin.site import OsmFeature, RigSpec

__all__ = ["Surroundings", "surroundings_of"]

#: Widths of carriageways by OSM highway class, metres, where only their centre lines are known: two
#: lanes of the usual width and parking. Registration and the search for parked cars need no more
#: detail.
WIDTHS_M = {
    **dict.fromkeys(("motorway", "trunk"), 11.0),
    **dict.fromkeys(("primary", "secondary"), 9.0),
    **dict.fromkeys(("tertiary", "unclassified", "residential", "living_street"), 7.0),
    **dict.fromkeys(("motorway_link", "trunk_link", "primary_link", "secondary_link"), 5.0),
    **dict.fromkeys(("tertiary_link", "service"), 4.5),
}
LANE_M = 3.2
MOST_LANES = 12


@dataclass(frozen=True)
class Surroundings:
    """Known data of a site before geometry is imported; site frame, metres.

    Attributes:
        region: the region of interest.
        roads: carriageways in plan (mapped lines with their widths), may be empty.
        footprints: outlines of mapped buildings.
        sensors: (S, 3) sensor positions.
    """

    region: shapely.Polygon
    roads: shapely.Geometry
    footprints: tuple[shapely.Polygon, ...]
    sensors: NDArray[np.float64]


def surroundings_of(
    features: Sequence[OsmFeature],
    region: shapely.Polygon,
    rig: RigSpec,
    carriageway: shapely.Geometry | None = None,
) -> Surroundings:
    """Return the data of a site from the map and the rig.

    Args:
        features: the map's features, site frame.
        region: the region of interest, site frame.
        rig: the sensors; their heights are assumed above level ground.
        carriageway: the carriageways in plan of a lane map, used instead of the features' lines.
    """
    roads, footprints = [], []
    for feature in features:
        tags, shape = feature.tags, feature.geometry
        if tags.get("highway") in WIDTHS_M and shape.geom_type == "LineString":
            if tags.get("tunnel", "no") == "no" and tags.get("bridge", "no") == "no":
                roads.append(shape.buffer(_width_m(tags) / 2, cap_style="flat"))
        elif tags.get("building", "no") != "no" and shape.geom_type.endswith("Polygon"):
            # before parking, as a multi-storey car park is both
            footprints += [part for part in shapely.get_parts(shape) if part.area > 1.0]
        elif (
            tags.get("amenity") == "parking"
            and tags.get("parking") != "underground"
            and shape.geom_type.endswith("Polygon")
        ):
            roads.append(shape)
    # Heights above the anchor's ground suffice to find what the sensors see.
    places = [
        [s.east_m, s.north_m, s.height_m or s.up_m or 0.0] for s in rig.sensors if not s.rides
    ]
    return Surroundings(
        region,
        area_union(roads) if carriageway is None else carriageway,
        tuple(footprints),
        np.array(places, np.float64).reshape(-1, 3),
    )


def _width_m(tags: dict[str, str]) -> float:
    lanes = whole_number(tags.get("lanes"))
    if lanes is not None and 1 <= lanes <= MOST_LANES:
        return max(lanes * LANE_M, WIDTHS_M[tags["highway"]] / 2)
    return WIDTHS_M[tags["highway"]]
