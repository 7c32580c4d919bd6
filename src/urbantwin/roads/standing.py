"""What stands on streets in plan: posts and islands, which ways through junctions lead round."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.ground import Elevation
from urbantwin.result_warning import ResultWarning
from urbantwin.roads.network import RoadNetwork
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_classes

__all__ = ["HALF_CAR_M", "islands", "standing_on_ground", "warnings_of_ways"]

#: Half of what a car takes, its mirrors left out (EU fleet: 1.8 m), metres.
HALF_CAR_M = 0.9
#: What nobody drives through, but buildings: roads keep clear of these by themselves.
SOLID = ("fence", "other-structure", "trunk", "pole", "traffic-sign", "other-object")
#: Lower than the knee it is driven over, higher than the head of a driver under, metres.
KNEE_M, HEAD_M = 0.45, 2.0
#: How many ways a warning names.
NAMED = 3


def standing_on_ground(mesh: LabelledMesh, elevation: Elevation) -> list[shapely.Geometry]:
    """Return the outlines in plan of the triangles that nobody drives through.

    Args:
        mesh: what stands, site frame.
        elevation: the ground.
    """
    solid = np.isin(mesh.semantic, [semantic_classes()[name].id for name in SOLID])
    corners = mesh.vertices[mesh.faces[solid]]
    ground = elevation.raw_at(corners[..., :2].mean(axis=1))
    low, high = corners[..., 2].min(axis=1) - ground, corners[..., 2].max(axis=1) - ground
    met = corners[(high > KNEE_M) & (low < HEAD_M)]
    return list(shapely.convex_hull(shapely.linestrings(met[..., :2])))


def islands(features: Iterable[OsmFeature]) -> list[shapely.Geometry]:
    """Return the islands that a map draws as areas."""
    return [
        feature.geometry
        for feature in features
        if feature.tags.get("area:highway") == "traffic_island"
        and feature.geometry.geom_type in ("Polygon", "MultiPolygon")
    ]


def warnings_of_ways(
    network: RoadNetwork, standing: Sequence[shapely.Geometry]
) -> tuple[ResultWarning, ...]:
    """Return what is wrong with ways through junctions that lead over what stands."""
    tree = shapely.STRtree(standing)
    over: list[NDArray[np.float64]] = []
    for lane in network.lanes:
        if lane.kind != "connection" or "car" not in lane.allowed:
            continue
        line = shapely.LineString(lane.centre[:, :2])
        near = tree.query(line, predicate="dwithin", distance=HALF_CAR_M)
        if len(near):
            met = shapely.shortest_line(line, standing[int(near[0])])
            over.append(shapely.get_coordinates(met)[0])
    if not over:
        return ()
    places = ", ".join(f"{x:.1f}, {y:.1f} m" for x, y in over[:NAMED])
    more = f" and {len(over) - NAMED} more" if len(over) > NAMED else ""
    return (
        ResultWarning(
            "ways through junctions",
            f"{len(over)} lead over what stands there, at {places}{more}",
            "no way round it bends as gently as cars turn",
            "draw them as turns of a sketch, or correct where it stands",
        ),
    )
