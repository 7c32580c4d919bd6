"""What ``RecastBuilder`` asks of the mesh that people walk on, and of the crosswalks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.exports.carla.check.finding import NoCarlaError, Problems
from urbantwin.exports.carla.check.import_rules import LARGEST_M
from urbantwin.exports.carla.check.read import Package
from urbantwin.exports.carla.meshes import navigation_area

__all__ = ["crosswalks", "navigation", "triangles_of_obj", "without_sidewalk"]

#: ``FBX2OBJ.cpp``; areas in ``LibCarla/source/carla/nav/Navigation.h``.
AREAS = ("road", "sidewalk", "crosswalk", "grass", "block")
#: RecastBuilder's greatest step, metres (``Sample.cpp``, agent).
STEP_M = 0.3


def navigation(package: Package) -> Problems:
    """The OBJ: metres, y up, z south, one of five materials, sidewalks that face up."""
    path = package.folder / "navigation" / f"{package.name}.obj"
    corners, area = triangles_of_obj(path)
    for name in sorted(set(area) - set(AREAS)):
        yield f"the material {str(name)!r} is none of {', '.join(AREAS)}"
    if not len(corners):
        yield "it has no triangle"
        return
    if float(np.ptp(corners.reshape(-1, 3), axis=0)[[0, 2]].max()) > LARGEST_M:
        yield f"it is more than {LARGEST_M:.0f} m wide"
    site = corners[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0]
    for one in AREAS:
        wanted = [navigation_area(name) == one for name in package.mesh.nodes]
        theirs = package.mesh.corners[np.array(wanted)[package.mesh.node]]
        mine = site[area == one]
        if len(mine) != len(theirs):
            yield f"{one}: {len(mine)} triangles, and {len(theirs)} in the FBX"
        elif len(mine) and np.abs(_bounds(mine) - _bounds(theirs)).max() > 0.01:
            yield f"{one}: its bounds are not those of the FBX"
    walked = site[area == "sidewalk"]
    up = np.cross(walked[:, 1] - walked[:, 0], walked[:, 2] - walked[:, 0])[:, 2]
    if len(walked) and up[up > 0].sum() < -up[up < 0].sum():
        yield "sidewalks face down: nobody could walk on them"


def crosswalks(package: Package) -> Problems:
    """Crosswalks as ``get_xodr_crosswalks.py`` triangulates them: convex, and facing up."""
    for number, outline in enumerate(_outlines(package)):
        ring = shapely.LinearRing(outline[:, :2])
        shape = shapely.Polygon(ring)
        if not shape.is_valid or shape.area < 0.99 * shape.convex_hull.area:
            yield f"crosswalk {number} is not convex: its triangles would lie beside it"
        elif not ring.is_ccw:
            yield f"crosswalk {number} faces down: nobody could walk on it"


def without_sidewalk(package: Package) -> Problems:
    """Crosswalks that no sidewalk meets: nobody comes there."""
    corners = package.mesh.of("Road_Sidewalk")
    shapes = shapely.polygons(corners[:, :, :2])
    large = shapely.area(shapes) > 1e-6
    tree, height = shapely.STRtree(shapes[large]), corners[large][:, :, 2].mean(axis=1)
    every = _outlines(package)
    alone = 0
    for outline in every:
        near = tree.query(shapely.Polygon(outline[:, :2]), predicate="dwithin", distance=0.1)
        step = np.abs(height[near] - outline[:, 2].mean())
        alone += not (step < STEP_M + float(np.ptp(outline[:, 2]))).any()
    if alone:
        yield f"{alone} of {len(every)} crosswalks meet no sidewalk: the map has none there"


def _outlines(package: Package) -> list[NDArray[np.float64]]:
    """Return the crosswalks (N, 3) in the site frame; CARLA gives one closed ring after another."""
    if package.carla is None:
        raise NoCarlaError
    corners = np.array(package.carla["crosswalks"], np.float64).reshape(-1, 3) * [1, -1, 1]
    found, start = [], 0
    for k in range(1, len(corners)):
        if k > start and np.allclose(corners[k], corners[start], atol=1e-4):
            found.append(corners[start:k])
            start = k + 1
    return [one for one in found if len(one) >= 3]


def _bounds(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    every = corners.reshape(-1, 3)
    return np.concatenate([every.min(axis=0), every.max(axis=0)])


def triangles_of_obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.str_]]:
    """Return triangles (F, 3, 3) and their materials (F,), as RecastBuilder reads both.

    Raises:
        InputError: it is missing, or holds something else.
    """
    vertices, faces, materials, name = [], [], [], ""
    text = read_bytes(path, "where people walk").decode(errors="replace")
    try:
        for line in text.splitlines():
            word, _, rest = line.partition(" ")
            if word == "v":
                vertices.append([float(value) for value in rest.split()[:3]])
            elif word == "f":
                faces.append([int(value.split("/")[0]) - 1 for value in rest.split()])
                materials.append(name)
            elif word == "usemtl":
                name = rest.strip()
        corners = np.array(vertices).reshape(-1, 3)[np.array(faces, np.int64).reshape(-1, 3)]
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(f"is not an OBJ of triangles ({error})", file=path) from None
    return corners, np.array(materials)
