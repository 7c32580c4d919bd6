"""Everything of the map that stands on the ground beside buildings, subject by subject."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.roads.signals import Head
from urbantwin.scene.barrier import barrier_mesh
from urbantwin.scene.bridge import bridge_decks, bridge_mesh
from urbantwin.scene.furniture import furniture_mesh
from urbantwin.scene.pole import pole_mesh
from urbantwin.scene.rail import rail_mesh
from urbantwin.scene.signal_pole import signal_mesh
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tree import tree_mesh
from urbantwin.scene.water import pier_mesh
from urbantwin.scene.wire import wire_mesh
from urbantwin.site import OsmFeature

__all__ = ["furnishings"]

Built = tuple[LabelledMesh, dict[str, int]]
MeshOf = Callable[..., Built]


def furnishings(
    features: Sequence[OsmFeature],
    heads: Sequence[Head],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    covers: Mapping[str, Geometry] | None = None,
    lane_decks: Geometry | None = None,
) -> dict[str, Built]:
    """Return signals, poles, trees, barriers, furniture, bridges, tracks, wires and piers.

    Args:
        features: the map's features, site frame.
        heads: signals and signs of the lane model.
        region: nothing stands outside it.
        ground_height: heights of the ground.
        carriageway: where nothing stands that is not mapped there.
        covers: where imported geometry has the ``trees`` and the ``other`` things.
        lane_decks: decks of the lane model in plan.

    Returns:
        Per subject its mesh, ``part`` 1, 2, ... per object, and counts of what was built and
        assumed.
    """
    known = covers or {}
    trees, other = known.get("trees"), known.get("other")
    inside = [head for head in heads if region.covers(Point(head.x, head.y))]
    decks, deck_notes = bridge_decks(
        features,
        region=region,
        ground_height=ground_height,
        lane_decks=lane_decks if lane_decks is not None else Polygon(),
    )
    rides = decks.over(ground_height, ("rail",))

    def built(mesh_of: MeshOf, without: Geometry | None, **more: object) -> Built:
        return mesh_of(
            features,
            region=region,
            ground_height=ground_height,
            carriageway=carriageway,
            without=without,
            **more,
        )

    bridges, bridge_notes = built(partial(bridge_mesh, decks=decks), other)
    return {
        "signals": signal_mesh(inside, ground_height=ground_height, carriageway=carriageway),
        "poles": built(pole_mesh, other),
        "trees": built(tree_mesh, trees),
        "barriers": built(barrier_mesh, other),
        "furniture": built(furniture_mesh, other),
        "bridges": (bridges, {**deck_notes, **bridge_notes}),
        "tracks": built(rail_mesh, other, ride_height=rides),
        "wires": built(wire_mesh, other, ride_height=rides),
        "piers": built(pier_mesh, other),
    }
