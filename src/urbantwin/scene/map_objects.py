"""Meshes of all mapped objects other than buildings, by subject."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress, untold
from urbantwin.roads.signals import Head
from urbantwin.scene.barrier import barrier_mesh
from urbantwin.scene.bridge import Decks, bridge_decks, bridge_mesh
from urbantwin.scene.catalogue import Catalogue
from urbantwin.scene.furniture import furniture_mesh
from urbantwin.scene.pole import pole_mesh
from urbantwin.scene.rail import rail_mesh
from urbantwin.scene.signal_pole import signal_mesh
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tree import tree_mesh
from urbantwin.scene.water import pier_mesh
from urbantwin.scene.wire import wire_mesh
from urbantwin.site import OsmFeature

__all__ = ["map_objects"]

Built = tuple[LabelledMesh, dict[str, int]]
MeshOf = Callable[..., Built]
#: Maximum distance from a track on a bridge of objects on the bridge, metres.
BESIDE_TRACK_M = 1.5


def map_objects(  # noqa: PLR0913 - all that they are placed by
    features: Sequence[OsmFeature],
    heads: Sequence[Head],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    covers: Mapping[str, Geometry] | None = None,
    lane_decks: Geometry | None = None,
    deck_height: GroundHeight | None = None,
    leave_out: Sequence[str] = (),
    objects: Catalogue | None = None,
    tell: Progress = untold,
) -> dict[str, Built]:
    """Return signals, poles, trees, barriers, furniture, bridges, tracks, wires and piers.

    Args:
        features: the map's features, site frame.
        heads: signals and signs of the lane model.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        carriageway: area without objects that are not mapped in it.
        covers: areas in which imported geometry contains the ``trees`` and the ``other`` objects.
        lane_decks: decks of the lane model in plan.
        deck_height: heights of the uppermost deck, or of the ground.
        leave_out: subjects that are not built.
        objects: street objects; those of the package if not given.
        tell: called with the share done (0..1) and the current task.

    Returns:
        Per subject its mesh, ``part`` 1, 2, ... per object, and counts of objects built and of
        assumptions.
    """
    known = covers or {}
    trees, other = known.get("trees"), known.get("other")
    inside = [head for head in heads if region.covers(Point(head.x, head.y))]
    over = lane_decks if lane_decks is not None else Polygon()
    decks, deck_notes = bridge_decks(
        features,
        region=region,
        ground_height=ground_height,
        lane_decks=over,
    )
    rides = _ride_height(features, decks, ground_height, deck_height or ground_height)

    def built(mesh_of: MeshOf, without: Geometry | None, **more: object) -> Built:
        return mesh_of(
            features,
            region=region,
            ground_height=ground_height,
            carriageway=carriageway,
            without=without,
            **more,
        )

    def bridges() -> Built:
        mesh, notes = built(partial(bridge_mesh, decks=decks), other)
        return mesh, {**deck_notes, **notes}

    subjects: dict[str, Callable[[], Built]] = {
        "signals": lambda: signal_mesh(
            inside, ground_height=ground_height, carriageway=carriageway
        ),
        "poles": lambda: built(
            pole_mesh, other, decks=over, deck_height=deck_height, objects=objects
        ),
        "trees": lambda: built(tree_mesh, trees, decks=over),
        "barriers": lambda: built(barrier_mesh, other),
        "furniture": lambda: built(furniture_mesh, other, objects=objects),
        "bridges": bridges,
        "tracks": lambda: built(rail_mesh, other, ride_height=rides),
        "wires": lambda: built(wire_mesh, other, ride_height=rides),
        "piers": lambda: built(pier_mesh, other),
    }
    found: dict[str, Built] = {}
    for number, (name, build) in enumerate(subjects.items()):
        tell(number / len(subjects), name)
        if name not in leave_out:
            found[name] = build()
    return found


def _ride_height(
    features: Sequence[OsmFeature],
    decks: Decks,
    ground_height: GroundHeight,
    deck_height: GroundHeight,
) -> GroundHeight:
    """Return heights of tracks: of decks for tracks mapped on a bridge, or of the ground."""
    lines = [
        f.geometry
        for f in features
        if "railway" in f.tags
        and f.tags.get("bridge", "no") != "no"
        and f.geometry.geom_type == "LineString"
    ]
    bridges = shapely.union_all(shapely.buffer(lines, BESIDE_TRACK_M, cap_style="flat"))
    above = decks.over(deck_height, ("rail",))
    shapely.prepare(bridges)

    def height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        z = np.array(ground_height(xy), np.float64)
        on = shapely.contains_xy(bridges, xy[:, 0], xy[:, 1])
        if on.any():
            z[on] = above(xy[on])
        return z

    return height
