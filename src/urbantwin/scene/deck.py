"""Decks of roads that cross over others: slabs with parapets on piers."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, row_keys
from urbantwin.roads import RoadNetwork, RoadSurface
from urbantwin.scene.solids import Assembly, GroundHeight, box
from urbantwin.scene.surface import Spacing, surface_mesh
from urbantwin.scene.zones import deck_zones
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["deck_area", "deck_height", "deck_mesh", "deck_pier_mesh"]

THICKNESS_M = 1.0
PARAPET_M, PARAPET_THICK_M = 1.1, 0.3
#: Piers: spacing, thickness, clearance to roads below, minimum height of decks, depth, metres.
PIER_STEP_M, PIER_M, CLEAR_M, LOWEST_PIER_M, BURIED_M = 22.0, 1.0, 0.8, 2.5, 0.5
#: No parapet where the deck's border is within these distances (plan, height) of another road.
JOIN_M, STEP_M = 1.0, 0.6


def deck_mesh(network: RoadNetwork, surface: RoadSurface, spacing: Spacing) -> LabelledMesh:
    """Return every deck above the ground: road, underside, sides and parapets."""
    meshes = []
    for level in network.levels[1:]:
        zones = [zone for zone in deck_zones(network, level) if not zone.area.is_empty]
        if not zones:
            continue

        def height(xy: NDArray[np.float64], level: int = level) -> NDArray[np.float64]:
            return surface.height(xy, level)

        top = surface_mesh(
            zones,
            road_height=height,
            terrain_height=height,
            spacing=spacing,
            lines=surface.ridges(level),
        )
        a, b = _border(top)
        goes_on = _goes_on((a + b) / 2, network, surface, level)
        meshes += [top, _underside(top), _sides(a, b), _parapets(a, b, ~goes_on)]
    return LabelledMesh.concatenate(meshes)


def deck_area(network: RoadNetwork) -> shapely.Geometry:
    """Return the decks of all levels in plan."""
    return shapely.union_all([_roads(network, level) for level in network.levels[1:]])


def deck_height(
    network: RoadNetwork, surface: RoadSurface, ground_height: GroundHeight
) -> GroundHeight:
    """Return a function for the height of the uppermost deck at a point, or of the ground."""
    decks = [(level, _roads(network, level)) for level in network.levels[1:]]
    for _, area in decks:
        shapely.prepare(area)

    def height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        z = np.array(ground_height(xy), np.float64)
        for level, area in decks:
            on = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
            if on.any():
                z[on] = np.fmax(z[on], surface.height(xy[on], level))
        return z

    return height


def _roads(network: RoadNetwork, level: int) -> shapely.Geometry:
    return shapely.union(network.carriageway(level), network.footway(level))


def _goes_on(
    places: NDArray[np.float64], network: RoadNetwork, surface: RoadSurface, level: int
) -> NDArray[np.bool_]:
    """Return the points (N, 3) of a deck's border at which a road of another level continues."""
    found = np.zeros(len(places), bool)
    for other in network.levels:
        if other == level:
            continue
        near = shapely.buffer(_roads(network, other), JOIN_M)
        shapely.prepare(near)
        at = shapely.contains_xy(near, places[:, 0], places[:, 1])
        if at.any():  # a road far below crosses under the deck
            gap = np.abs(surface.height(places[at, :2], other) - places[at, 2])
            found[np.flatnonzero(at)[gap < STEP_M]] = True
    return found


def _underside(top: LabelledMesh) -> LabelledMesh:
    return LabelledMesh.build(
        top.vertices - [0, 0, THICKNESS_M],
        top.faces[:, ::-1],
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def _sides(a: NDArray[np.float64], b: NDArray[np.float64]) -> LabelledMesh:
    """Return faces under a deck's border, the edges a -> b (N, 3)."""
    down = np.array([0.0, 0.0, THICKNESS_M])
    i, count = np.arange(len(a)), len(a)
    return LabelledMesh.build(
        np.concatenate([a - down, b - down, b, a]),
        np.concatenate(
            [
                np.column_stack([i, i + count, i + 2 * count]),
                np.column_stack([i, i + 2 * count, i + 3 * count]),
            ]
        ),
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def _parapets(
    a: NDArray[np.float64], b: NDArray[np.float64], wanted: NDArray[np.bool_]
) -> LabelledMesh:
    """Return walls outside of the edges a -> b (N, 3), with the deck on their left."""
    keys = np.round(np.concatenate([a, b]) * 1e3).astype(np.int64)
    _, place = np.unique(row_keys(keys), axis=0, return_inverse=True)
    place = place.ravel()
    way = (b - a)[:, :2]
    out = np.column_stack([way[:, 1], -way[:, 0]])
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    total = np.zeros((int(place.max(initial=-1)) + 1, 2))
    np.add.at(total, place, np.concatenate([out, out]))
    # Mitred, so that walls of adjacent edges join; at hairpins at most twice the thickness.
    total *= 2 / np.maximum((total**2).sum(axis=1, keepdims=True), 1.0)
    mitre = np.column_stack([total, np.zeros(len(total))])[place] * PARAPET_THICK_M
    near, far = (np.column_stack([e, e]).reshape(-1, 2, 3)[wanted] for e in (a, b))
    near[:, 1] += mitre[: len(a)][wanted]
    far[:, 1] += mitre[len(a) :][wanted]
    low, high = np.array([0, 0, -THICKNESS_M]), np.array([0, 0, PARAPET_M])
    corners = np.concatenate(
        [near + low, far + low, near + high, far + high], axis=1
    )  # near inner, near outer, far inner, far outer; below, then above
    walls = np.array(
        [
            *([0, 1, 3], [0, 3, 2]),  # under
            *([4, 6, 7], [4, 7, 5]),  # on top
            *([0, 2, 6], [0, 6, 4]),  # towards the deck
            *([1, 5, 7], [1, 7, 3]),  # outside
            *([0, 4, 5], [0, 5, 1]),  # ends
            *([2, 3, 7], [2, 7, 6]),
        ]
    )
    shift = 8 * np.arange(len(corners))[:, None, None]
    return LabelledMesh.build(
        corners.reshape(-1, 3),
        (walls[None] + shift).reshape(-1, 3),
        semantic_id("other-structure"),
        material_id("concrete"),
    )


def deck_pier_mesh(
    network: RoadNetwork,
    surface: RoadSurface,
    *,
    region: shapely.Polygon,
    ground_height: GroundHeight,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Return piers below the decks of roads, across their width, none of them on a road below.

    Args:
        network: the lanes.
        surface: height of the roads.
        region: the region.
        ground_height: heights of the ground.

    Returns:
        The mesh, ``part`` 1, 2, ... per pier, and the number of piers.
    """
    assembly = Assembly()
    for level in network.levels[1:]:
        below = [network.carriageway(k).buffer(CLEAR_M) for k in network.levels if k < level]
        blocked = shapely.union_all(below)
        deck = _roads(network, level)
        lines = [
            shapely.LineString(lane.centre[:, :2])
            for lane in network.lane_by_id.values()
            if lane.level == level and lane.kind == "driving" and lane.length > PIER_STEP_M / 2
        ]
        placed: list[shapely.Point] = []
        for line in lines:
            count = max(round(line.length / PIER_STEP_M), 1)
            for station in ((np.arange(count) + 0.5) / count * line.length).tolist():
                at = line.interpolate(station)
                if any(at.distance(other) < PIER_STEP_M / 2 for other in placed):
                    continue
                chord = _across(line, station, deck)
                if chord is None or not region.covers(chord):
                    continue
                wall = chord.buffer(PIER_M / 2, cap_style="flat")
                if wall.intersects(blocked):
                    continue
                middle = shapely.get_coordinates(chord.interpolate(0.5, normalized=True))
                ends = shapely.get_coordinates(chord)
                under = float(surface.height(ends, level).min()) - THICKNESS_M
                foot = float(np.nanmin(ground_height(np.concatenate([ends, middle]))))
                if not under - foot > LOWEST_PIER_M:
                    continue
                placed.append(at)
                tall = under - foot + BURIED_M + 0.1
                centre = [*middle[0], foot - BURIED_M + tall / 2]
                way = ends[1] - ends[0]
                pier = box(centre, [chord.length, PIER_M, tall], np.arctan2(way[1], way[0]))
                assembly.add(pier, "other-structure", "concrete", assembly.new_part())
    return assembly.mesh(), {"piers": assembly.parts} if assembly.parts else {}


def _across(
    line: shapely.LineString, station: float, deck: shapely.Geometry
) -> shapely.LineString | None:
    """Return the middle 70 % of the line across a deck at a station of a lane."""
    a, b = (shapely.get_coordinates(line.interpolate(station + d))[0] for d in (-0.5, 0.5))
    way = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
    left = np.array([-way[1], way[0]])
    middle = (a + b) / 2
    whole = shapely.LineString([middle - 40 * left, middle + 40 * left]).intersection(deck)
    for piece in shapely.get_parts(whole):
        if piece.distance(shapely.Point(middle)) < 0.1 and piece.length > 2.0:
            ends = shapely.get_coordinates(piece)[[0, -1]]
            return shapely.LineString([0.85 * ends[0] + 0.15 * ends[1],
                                       0.15 * ends[0] + 0.85 * ends[1]])  # fmt: skip
    return None


def _border(mesh: LabelledMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return starts and ends (N, 3) of the edges with one triangle, the mesh on their left."""
    keys = np.round(mesh.vertices * 1e4).astype(np.int64)
    _, first, same = np.unique(row_keys(keys), axis=0, return_index=True, return_inverse=True)
    directed = same.ravel()[mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
    directed = directed[directed[:, 0] != directed[:, 1]]
    _, index, uses = np.unique(
        np.sort(directed, axis=1), axis=0, return_index=True, return_counts=True
    )
    once = directed[np.sort(index[uses == 1])]
    return mesh.vertices[first[once[:, 0]]], mesh.vertices[first[once[:, 1]]]
