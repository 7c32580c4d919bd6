"""The mesh of all overhead wires."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from shapely import Geometry, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.wire.contact_line import add_contact_lines
from urbantwin.scene.wire.power import add_power_lines
from urbantwin.scene.wire.span_wire import add_span_wires
from urbantwin.site.extract import OsmFeature

__all__ = ["wire_mesh"]


def wire_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    ride_height: GroundHeight | None = None,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build power lines with their towers, contact wires with what holds them, hung lamps.

    Args:
        features: the map's features, site frame.
        region: wires end at its border.
        ground_height: heights of the ground.
        carriageway: where no mast may stand.
        ride_height: heights of rails and roads, decks included; without it the ground's.
        without: where imported geometry has them.

    Returns:
        The mesh, ``part`` 1, 2, ... per wire or support, and counts of what was built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    place = region
    if without is not None and not without.is_empty:
        place = region.difference(without)
    mine = [f for f in features if _is_mine(f.tags)]
    add_power_lines(assembly, mine, place, ground_height, notes)
    add_contact_lines(assembly, mine, place, ride_height or ground_height, carriageway, notes)
    add_span_wires(assembly, mine, place, ground_height, notes)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _is_mine(tags: dict[str, str]) -> bool:
    return any(key in tags for key in ("power", "railway", "highway", "building")) or (
        tags.get("man_made") == "wire"
    )
