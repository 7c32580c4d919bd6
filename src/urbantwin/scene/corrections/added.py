"""Poles, walls and trees added by the user, built in the same way as mapped ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Geometry, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.barrier import barrier_mesh
from urbantwin.scene.barrier.linear import KERB_M
from urbantwin.scene.pole import pole_mesh
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tree import tree_mesh
from urbantwin.site import OsmFeature
from urbantwin.site.corrections import AddPole, AddTree, AddWall, Correction, Outcome

__all__ = ["added_things"]

#: Maximum distance of carriageways that are used, metres: the longest reach, that of lamps.
BESIDE_M = 30.0


def added_things(
    corrections: Sequence[Correction],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    deck_height: GroundHeight,
    carriageway: Geometry,
    lane_decks: Geometry,
) -> tuple[LabelledMesh, list[Outcome]]:
    """Build added objects; the result of each correction describes what was built.

    Args:
        corrections: the corrections; other kinds are ignored.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        deck_height: heights of the uppermost decks, or of the ground.
        carriageway: area without objects.
        lane_decks: decks of the lanes in plan.

    Returns:
        The mesh, ``part`` 1, 2, ... per object, and the result of each correction.
    """
    meshes: list[LabelledMesh] = []
    outcomes: list[Outcome] = []
    first = 0
    for one in corrections:
        asked = one.asked
        if not isinstance(asked, AddPole | AddWall | AddTree):
            continue
        features = [
            OsmFeature("node", -1000 * one.number - k, asked.tags(), shape)
            for k, shape in enumerate(one.shapes)
        ]
        near = shapely.box(*shapely.total_bounds(list(one.shapes))).buffer(BESIDE_M)
        beside = shapely.intersection(carriageway, near)
        decks = shapely.intersection(lane_decks, near)
        if isinstance(asked, AddPole):
            mesh, notes = pole_mesh(
                features,
                region=region,
                ground_height=ground_height,
                carriageway=beside,
                decks=decks,
                deck_height=deck_height,
            )
        elif isinstance(asked, AddTree):
            mesh, notes = tree_mesh(
                features,
                region=region,
                ground_height=ground_height,
                carriageway=beside,
                decks=decks,
            )
        else:
            mesh, notes = barrier_mesh(
                features, region=region, ground_height=ground_height, carriageway=beside
            )
        outcomes.append(_outcome(one, asked, mesh, notes, region, beside))
        meshes.append(
            LabelledMesh(
                mesh.vertices,
                mesh.faces,
                mesh.semantic,
                mesh.material,
                mesh.part + np.int32(first),
            )
        )
        first += int(mesh.part.max(initial=0))
    return LabelledMesh.concatenate(meshes), outcomes


def _outcome(
    one: Correction,
    asked: AddPole | AddWall | AddTree,
    mesh: LabelledMesh,
    notes: dict[str, int],
    region: Polygon,
    carriageway: Geometry,
) -> Outcome:
    """Return the result of adding an object, from what was built of it."""
    if not len(mesh.faces):
        gap = shapely.distance(carriageway, shapely.GeometryCollection(list(one.shapes)))
        where = "on the carriageway" if gap < 1 else "where it cannot be built"
        return Outcome(one, False, f"lies {where}, and nothing is left of it")
    if isinstance(asked, AddWall):
        lines = shapely.union_all(list(one.shapes))
        free = shapely.difference(region, shapely.buffer(carriageway, KERB_M))
        drawn, built = lines.length, shapely.intersection(lines, free).length
        told = f"{asked.kind}, {built:.1f} m long"
        rest = f" of {drawn:.1f} m drawn: the rest is on the carriageway or outside the region"
        return Outcome(one, True, told + (rest if built < drawn - 0.5 else ""))
    tall = float(np.ptp(mesh.vertices[:, 2]))
    count = len(np.unique(mesh.part))
    told = asked.kind if isinstance(asked, AddPole) else "tree"
    told = told if count == 1 else f"{count} x {told}"
    told += f", {asked.height_m or tall:.1f} m high"
    moved = sum(number for name, number in notes.items() if "moved off" in name)
    if moved:
        told += (
            f", {moved} moved off the carriageway" if count > 1 else ", moved off the carriageway"
        )
    if (left := len(one.shapes) - count) > 0:
        told += f", {left} left out on the carriageway"
    return Outcome(one, True, told)
