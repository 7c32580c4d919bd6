"""Everything of the map that stands on the ground beside buildings, subject by subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.roads.signals import Head
from urbantwin.scene.barrier import barrier_mesh
from urbantwin.scene.furniture import furniture_mesh
from urbantwin.scene.pole import pole_mesh
from urbantwin.scene.signal_pole import signal_mesh
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tree import tree_mesh
from urbantwin.site import OsmFeature

__all__ = ["furnishings"]


def furnishings(
    features: Sequence[OsmFeature],
    heads: Sequence[Head],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    covers: Mapping[str, Geometry] | None = None,
) -> dict[str, tuple[LabelledMesh, dict[str, int]]]:
    """Return signals, poles, trees, barriers and furniture.

    Args:
        features: the map's features, site frame.
        heads: signals and signs of the lane model.
        region: nothing stands outside it.
        ground_height: heights of the ground.
        carriageway: where nothing stands that is not mapped there.
        covers: where imported geometry has the ``trees`` and the ``other`` things.

    Returns:
        Per subject its mesh, ``part`` 1, 2, ... per object, and counts of what was built and
        assumed.
    """
    known = covers or {}
    trees, other = known.get("trees"), known.get("other")
    place = {"region": region, "ground_height": ground_height, "carriageway": carriageway}
    inside = [head for head in heads if region.covers(Point(head.x, head.y))]
    return {
        "signals": signal_mesh(inside, ground_height=ground_height, carriageway=carriageway),
        "poles": pole_mesh(features, without=other, **place),
        "trees": tree_mesh(features, without=trees, **place),
        "barriers": barrier_mesh(features, without=other, **place),
        "furniture": furniture_mesh(features, without=other, **place),
    }
