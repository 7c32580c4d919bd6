"""One building as a solid: roof planes over its outline, walls down to its foundation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.reconstruct.airborne.roof_cells import GRID_M, RoofPatch, roof_patches
from urbantwin.reconstruct.airborne.roof_lines import roof_lines
from urbantwin.reconstruct.airborne.roof_objects import roof_objects
from urbantwin.reconstruct.airborne.roof_planes import roof_planes
from urbantwin.reconstruct.airborne.roof_solid import flat_solid, roof_solid

__all__ = ["BuiltRoof", "build_roof"]

#: Minimum number of points to determine the shape of a roof.
_FEWEST = 12
#: Depth of the underside below the lowest ground at the building, metres.
FOUNDATION_M = 1.0

Triangles = tuple[NDArray[np.float64], NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class BuiltRoof:
    """A building's closed surface.

    Attributes:
        vertices: (V, 3) metres, site frame.
        faces: (F, 3) counter-clockwise seen from outside.
        patches: pieces of its roof, site coordinates.
        shape: ``"planes"``, or ``"flat"`` if planes did not explain the points or did not close.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    patches: tuple[RoofPatch, ...]
    shape: str


def build_roof(
    outline: shapely.Polygon, points: NDArray[np.float64], base: float
) -> BuiltRoof | None:
    """Return the building under a roof's points.

    Args:
        outline: in plan, site frame.
        points: (N, 3) of the roof (walls may be included), site frame.
        base: height of the underside.

    Returns:
        The building; ``None`` if the outline cannot be extruded.
    """
    origin = np.array([*np.round(outline.centroid.coords[0], 2), 0.0])
    plain = _plain(shapely.transform(outline, lambda xy: xy - origin[:2]))
    if plain is None:
        return None
    local = points - origin
    found = _with_planes(plain, local, base) if len(points) >= _FEWEST else None
    shape = "planes"
    if found is None:
        shape = "flat"
        top = max(float(np.median(points[:, 2])), base + FOUNDATION_M + 0.5)
        try:
            vertices, faces = flat_solid(plain, base, top)
        except ValueError:
            return None
        patches = [RoofPatch(plain, np.array([0.0, 0.0, top]))]
    else:
        (vertices, faces), patches = found
    density = len(local) / max(plain.area, 1.0)
    vertices, faces = _together([(vertices, faces), *roof_objects(plain, patches, local, density)])
    moved = tuple(
        RoofPatch(
            shapely.transform(p.polygon, lambda xy: xy + origin[:2]),
            np.array([*p.plane[:2], p.plane[2] - p.plane[:2] @ origin[:2]]),
        )
        for p in patches
    )
    return BuiltRoof(vertices + origin, faces, moved, shape)


def _together(solids: list[Triangles]) -> Triangles:
    start = np.cumsum([0] + [len(vertices) for vertices, _ in solids[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in solids]),
        np.concatenate([f + np.int32(k) for (_, f), k in zip(solids, start, strict=True)]),
    )


def _plain(outline: shapely.Polygon) -> shapely.Polygon | None:
    """Return the outline on a centimetre grid, without redundant corners."""
    smooth = shapely.simplify(outline, 0.02)
    if not smooth.is_valid or smooth.geom_type != "Polygon":
        smooth = outline
    # The second call removes the grid, to which later operations would be snapped.
    snapped = shapely.set_precision(shapely.set_precision(smooth, GRID_M), 0.0)
    parts = [p for p in shapely.get_parts(snapped) if p.geom_type == "Polygon" and p.area > 1.0]
    return max(parts, key=lambda p: p.area) if parts else None


def _with_planes(
    outline: shapely.Polygon, points: NDArray[np.float64], base: float
) -> tuple[Triangles, list[RoofPatch]] | None:
    found = roof_planes(points, len(points) / max(outline.area, 1.0))
    if not len(found.planes):
        return None
    roof = points[~found.wall]
    label = found.label[~found.wall]
    low, high = np.percentile(roof[:, 2], [0.5, 99.8])
    lines = roof_lines(outline, roof, label, found.planes)
    patches = roof_patches(outline, lines, roof, label, found.planes)
    limits = (max(float(low) - 0.5, base + 0.3), max(float(high) + 0.5, base + 0.3))
    solid = roof_solid(patches, base, limits)
    return None if solid is None else (solid, patches)
