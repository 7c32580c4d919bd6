"""Where windows and doors are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from shapely import Geometry

from urbantwin.scene.facade.front import Front
from urbantwin.scene.facade.wall import Opening
from urbantwin.scene.solids import GroundHeight
from urbantwin.site.extract import OsmFeature

__all__ = ["facade_openings", "mapped_doors"]


def facade_openings(
    fronts: Sequence[Front],
    doors: Sequence[OsmFeature],
    carriageway: Geometry,
    *,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> list[list[list[Opening]] | None]:
    """Return the openings of every wall of every building."""
    return [None for _ in fronts]


def mapped_doors(features: Sequence[OsmFeature]) -> list[OsmFeature]:
    """Return the doors of the map."""
    return [f for f in features if "entrance" in f.tags]
