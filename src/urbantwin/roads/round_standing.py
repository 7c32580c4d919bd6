"""Paths through a junction that avoid posts and islands, where a car can drive so."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence

import numpy as np
import shapely
import shapely.ops
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, resampled, stations_of_points, tightest_bend
from urbantwin.ground import Elevation
from urbantwin.result_warning import ResultWarning
from urbantwin.roads.model.curve import Curve, aside, splined
from urbantwin.roads.network import RoadNetwork
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import semantic_classes

__all__ = ["islands", "round_standing", "standing_on_ground", "warnings_of_ways"]

#: Half the width of a car without mirrors (EU fleet: 1.8 m), metres.
HALF_CAR_M = 0.9
#: Classes of static obstacles except buildings, which roads avoid by other means.
SOLID = ("fence", "other-structure", "trunk", "pole", "traffic-sign", "other-object")
#: Obstacles below knee height are driven over, and above head height under, metres.
KNEE_M, HEAD_M = 0.45, 2.0
#: Paths closer to an obstacle than the first distance are moved to the second, metres.
NEAR_M, CLEAR_M = HALF_CAR_M + 0.1, HALF_CAR_M + 0.3
#: Obstacles closer to each other are avoided as one, metres.
ONE_THING_M = 1.0
#: Maximum displacement, its step, and the lengths of the transition before and behind, metres.
MOST_M, STEP_M, REACHES_M = 3.0, 0.2, (8.0, 12.0, 18.0, 25.0)
#: Minimum radius of displaced paths, unless the original is tighter (turning circles of cars are 10
#: to 12 m), metres.
TIGHTEST_M = 4.5
#: Length at the ends of a path that is not moved, because it lies in the lanes, metres.
END_M = 1.0
#: Spacing of the points that a curve passes through, metres.
SPACING_M = 2.0
#: Maximum number of places in a warning.
NAMED = 3


def standing_on_ground(mesh: LabelledMesh, elevation: Elevation) -> list[shapely.Geometry]:
    """Return the outlines in plan of the triangles of static obstacles.

    Args:
        mesh: labelled mesh of static objects, site frame.
        elevation: the ground.
    """
    solid = np.isin(mesh.semantic, [semantic_classes()[name].id for name in SOLID])
    corners = mesh.vertices[mesh.faces[solid]]
    ground = elevation.raw_at(corners[..., :2].mean(axis=1))
    low, high = corners[..., 2].min(axis=1) - ground, corners[..., 2].max(axis=1) - ground
    obstructing = corners[(high > KNEE_M) & (low < HEAD_M)]
    return list(shapely.convex_hull(shapely.linestrings(obstructing[..., :2])))


def islands(features: Iterable[OsmFeature]) -> list[shapely.Geometry]:
    """Return the traffic islands that are mapped as areas."""
    return [
        feature.geometry
        for feature in features
        if feature.tags.get("area:highway") == "traffic_island"
        and feature.geometry.geom_type in ("Polygon", "MultiPolygon")
    ]


def warnings_of_ways(
    network: RoadNetwork, standing: Sequence[shapely.Geometry]
) -> tuple[ResultWarning, ...]:
    """Return a warning for connections through junctions that pass over static obstacles."""
    tree = shapely.STRtree(standing)
    contacts: list[NDArray[np.float64]] = []
    for lane in network.lanes:
        if lane.kind != "connection" or "car" not in lane.allowed:
            continue
        line = shapely.LineString(lane.centre[:, :2])
        near_index = tree.query(line, predicate="dwithin", distance=HALF_CAR_M)
        if len(near_index):
            contact = shapely.shortest_line(line, standing[int(near_index[0])])
            contacts.append(shapely.get_coordinates(contact)[0])
    if not contacts:
        return ()
    places = ", ".join(f"{x:.1f}, {y:.1f} m" for x, y in contacts[:NAMED])
    more_text = f" and {len(contacts) - NAMED} more" if len(contacts) > NAMED else ""
    return (
        ResultWarning(
            "ways through junctions",
            f"{len(contacts)} lead through static objects, at {places}{more_text}",
            "no path around them is drivable for a car",
            "draw them as turns of a sketch, or correct the objects' positions",
        ),
    )


def round_standing(
    curves: Sequence[Curve],
    beside: Sequence[Hashable],
    standing: Sequence[shapely.Geometry],
) -> dict[int, Curve]:
    """Return curves for paths that would hit static obstacles but can avoid them.

    Parallel lanes are moved alike, by the minimum that clears all of them.

    Args:
        curves: paths through junctions.
        beside: key of each path, equal for parallel ones.
        standing: outlines of static obstacles, site frame.
    """
    obstacles = _merged_obstacles(standing, curves)
    if not obstacles:
        return {}
    groups: dict[Hashable, list[int]] = defaultdict(list)
    for k, name in enumerate(beside):
        groups[name].append(k)
    tree = shapely.STRtree(obstacles)
    moved_curves: dict[int, Curve] = {}
    for group in groups.values():
        old_lines = {k: _line(curves[k]) for k in group}
        linestrings = [shapely.LineString(line) for line in old_lines.values()]
        near_index = tree.query(linestrings, predicate="dwithin", distance=CLEAR_M + MOST_M)[1]
        lines = old_lines
        # Obstacles are processed one by one; a displaced path may come close to the next.
        for number in np.unique(near_index).tolist():
            obstacle = obstacles[number]
            if any(_inner(line).distance(obstacle) < NEAR_M for line in lines.values()):
                lines = _moved(lines, obstacle) or lines
        if lines is not old_lines:
            for k in group:
                start, end = curves[k].at([0.0, curves[k].length])[:, 2]
                moved_curves[k] = splined(resampled(lines[k], SPACING_M), float(start), float(end))
    return moved_curves


def _merged_obstacles(
    standing: Sequence[shapely.Geometry], curves: Sequence[Curve]
) -> list[shapely.Geometry]:
    """Return obstacles near paths, merged if near each other, in a fixed order."""
    if not len(standing) or not len(curves):
        return []
    lines = [curve.line for curve in curves]
    near_index = shapely.STRtree(standing).query(
        lines, predicate="dwithin", distance=CLEAR_M + MOST_M
    )[1]
    close = [standing[k] for k in np.unique(near_index)]
    if not close:
        return []
    tree = shapely.STRtree(close)
    grown = shapely.union_all([obstacle.buffer(ONE_THING_M / 2) for obstacle in close])
    parts = sorted(shapely.get_parts(grown), key=lambda part: part.bounds)
    return [
        shapely.union_all([close[k] for k in np.sort(tree.query(part, "intersects"))])
        for part in parts
    ]


def _line(curve: Curve) -> NDArray[np.float64]:
    stations = np.linspace(0.0, curve.length, max(8, round(curve.length / 0.5) + 1))
    return curve.at(stations)[:, :2]


def _inner(line: NDArray[np.float64]) -> shapely.LineString:
    """Return a line without its ends, which lie in lanes."""
    polyline = shapely.LineString(line)
    return shapely.ops.substring(polyline, END_M, max(polyline.length - END_M, END_M))


def _moved(
    lines: Mapping[int, NDArray[np.float64]], thing: shapely.Geometry
) -> dict[int, NDArray[np.float64]] | None:
    """Return lines moved around an obstacle; ``None`` if no displacement clears it."""
    before = {index: _radius(line) for index, line in lines.items()}
    for displacement_m, reach in _displacements():
        moved = {
            index: _displaced(line, thing, displacement_m, reach) for index, line in lines.items()
        }
        if all(
            _inner(line).distance(thing) >= CLEAR_M
            and _radius(line) >= min(TIGHTEST_M, before[index])
            for index, line in moved.items()
        ):
            return moved
    return None


def _displacements() -> Iterator[tuple[float, float]]:
    """Yield displacement to the left and transition length, in order of increasing cost."""
    for k in range(1, round(MOST_M / STEP_M) + 1):
        for reach in REACHES_M[::-1]:
            for sign in (1.0, -1.0):
                yield sign * k * STEP_M, reach


def _displaced(
    line: NDArray[np.float64], thing: shapely.Geometry, by: float, reach: float
) -> NDArray[np.float64]:
    """Return a line moved ``by`` metres to the left at an obstacle, with a smooth transition."""
    along = stations_of_points(line)
    distance = shapely.distance(shapely.points(line), thing)
    station_m = float(along[int(distance.argmin())])
    room = np.where(along < station_m, station_m, along[-1] - station_m)
    share = np.clip(np.abs(along - station_m) / np.maximum(np.minimum(reach, room), 1e-6), 0.0, 1.0)
    leg = np.gradient(line, axis=0)
    pose = np.column_stack([line, np.arctan2(leg[:, 1], leg[:, 0])])
    return aside(pose, by * (1.0 - share * share * (3.0 - 2.0 * share)))


def _radius(line: NDArray[np.float64]) -> float:
    return tightest_bend(resampled(line, 1.0))[0]
