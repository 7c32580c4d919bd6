"""Classification of a recorded world's objects: plants, walls, poles, parked vehicles, others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label, maximum, mean, minimum
from scipy.ndimage import sum as total

from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.recording.facets import POROUS, SURFACE
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["StandingThings", "standing_things", "waiting_parts"]

#: Cell size in which touching triangles form one object, metres.
_CELL_M = 0.3
#: An object is a plant if this share of its area is porous. So is one as high as a house if its
#: share of surfaces is below the second value, or its orientations are too diverse: walls are
#: upright and square to each other.
_LEAFY, _SURFACES, _SQUARE = 0.5, 0.25, 0.45
#: Maximum width and minimum height of a pole, metres.
_POLE_WIDTH_M, _POLE_HEIGHT_M = 0.9, 1.5
#: Minimum height and length of a wall or house, metres.
_HOUSE_HEIGHT_M, _HOUSE_LENGTH_M = 2.6, 3.0
#: Vehicles: bounds of the longest side, maximum of the shortest side, and bounds of the height,
#: metres.
_VEHICLE_LENGTH_M, _VEHICLE_WIDTH_M, _VEHICLE_HEIGHT_M = (1.6, 7.0), 3.0, (0.9, 2.4)
#: Minimum share of the triangles of a vehicle on a carriageway.
_ON_ROAD = 0.6
#: Waiting traffic: minimum distance inside a carriageway's edge, maximum height (a bus), maximum
#: height of its lowest part, minimum height of its top (a bonnet), and minimum length (more than
#: posts or people), metres.
_EDGE_M, _BUS_M, _FROM_M, _BONNET_M, _WIDE_M = 0.4, 3.2, 0.8, 0.7, 1.2
#: Half of the object must be this far inside the edge, metres, unlike hedges and walls at the
#: roadside of inexact maps.
_DEEP_M = 0.8
#: An object whose lowest part is above the first and whose top is below the second height (metres)
#: is no static object, but part of a waiting vehicle that is otherwise hidden or hit by too few
#: beams.
_HANGS_M, _LOW_M = 0.35, 2.0
_MATERIAL = {
    "vegetation": "foliage",
    "building": "plaster",
    "pole": "metal-painted",
    "car": "metal-painted",
    "other-object": "unknown",
}


@dataclass(frozen=True, eq=False)
class StandingThings:
    """The objects of a mesh of F triangles.

    Attributes:
        thing: (F,) int32, number of the object, from 1.
        semantic: (F,) uint16.
        material: (F,) uint8.
        on_road: (F,) whether a triangle is of a vehicle on a carriageway.
        counts: number of objects by class.
    """

    thing: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    material: NDArray[np.uint8]
    on_road: NDArray[np.bool_]
    counts: dict[str, int]


def standing_things(mesh: TriangleMesh, roads: shapely.Geometry) -> StandingThings:
    """Return the classified objects of a recorded world, by the shape of connected triangles.

    Args:
        mesh: mesh of `recorded_world.read_recording`, site frame.
        roads: carriageways in plan; may be empty.
    """
    corner = mesh.triangles()
    count = len(corner)
    if not count:
        empty = np.zeros(0, np.int32)
        return StandingThings(
            empty, empty.astype(np.uint16), empty.astype(np.uint8), empty.astype(bool), {}
        )
    thing = _things(corner)
    number = np.arange(1, int(thing.max()) + 1)
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    leafy = total(area * (mesh.object == POROUS), thing, number) / np.maximum(
        total(area, thing, number), 1e-9
    )
    low = np.array([minimum(corner[..., k].min(axis=1), thing, number) for k in range(3)])
    high = np.array([maximum(corner[..., k].max(axis=1), thing, number) for k in range(3)])
    size = high - low
    longest, shortest = _sides(corner.mean(axis=1), thing, number)
    kind = np.full(len(number) + 1, "other-object", "<U12")
    one = kind[1:]
    vehicle = (longest > _VEHICLE_LENGTH_M[0]) & (longest < _VEHICLE_LENGTH_M[1])
    vehicle &= (shortest < _VEHICLE_WIDTH_M) & (size[2] > _VEHICLE_HEIGHT_M[0])
    vehicle &= size[2] < _VEHICLE_HEIGHT_M[1]
    one[vehicle] = "car"
    high_and_long = (size[2] > _HOUSE_HEIGHT_M) & (longest > _HOUSE_LENGTH_M)
    walled = _walled(mesh, cross, thing, number)
    one[high_and_long] = np.where(walled[high_and_long], "building", "vegetation")
    one[(size[2] > _POLE_HEIGHT_M) & (longest < _POLE_WIDTH_M)] = "pole"
    one[(leafy > _LEAFY) & (one != "pole")] = "vegetation"
    of = kind[thing]
    middle = corner.mean(axis=1)
    inside = shapely.contains_xy(roads, middle[:, 0], middle[:, 1])
    share = np.concatenate([[0.0], np.atleast_1d(mean(inside.astype(float), thing, number))])
    on_road = (of == "car") & (share[thing] > _ON_ROAD)
    names = sorted(_MATERIAL)
    semantic = np.array([semantic_id(name) for name in names], np.uint16)
    material = np.array([material_id(_MATERIAL[name]) for name in names], np.uint8)
    at = np.searchsorted(names, of)
    return StandingThings(
        thing,
        semantic[at],
        material[at],
        on_road,
        {name: int((one == name).sum()) for name in names},
    )


def waiting_parts(
    mesh: TriangleMesh, roads: shapely.Geometry, above: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], int]:
    """Return the mask of triangles (F,) of waiting traffic on carriageways, and its count.

    Often only one side of a vehicle is visible, or vehicles are connected with each other and with
    a tree above. Any object on a carriageway except posts is therefore traffic.

    Args:
        mesh: mesh of `recorded_world.read_recording`, site frame.
        roads: carriageways in plan; may be empty.
        above: (F,) height of the triangles' centres above the ground, metres; nan if unknown.
    """
    corner = mesh.triangles()
    waits, count = np.zeros(len(corner), bool), 0
    middle = corner.mean(axis=1)
    inside = above < _BUS_M
    inside[inside] = shapely.contains_xy(roads.buffer(-_EDGE_M), *middle[inside, :2].T)
    rows = np.flatnonzero(inside)
    if not len(rows):
        return waits, count
    thing = _things(corner[rows])
    number = np.arange(1, int(thing.max()) + 1)
    deep = shapely.contains_xy(roads.buffer(-_DEEP_M), *middle[rows, :2].T).astype(float)
    longest, _ = _sides(middle[rows], thing, number)
    low, high, share = (
        np.atleast_1d(of(values, thing, number))
        for of, values in ((minimum, above[rows]), (maximum, above[rows]), (mean, deep))
    )
    found = (longest > _WIDE_M) & (low < _FROM_M) & (high > _BONNET_M)
    found |= (low > _HANGS_M) & (high < _LOW_M)
    found &= share > 0.5
    waits[rows] = found[thing - 1]
    return waits, int(found.sum())


def _walled(
    mesh: TriangleMesh,
    cross: NDArray[np.float64],
    thing: NDArray[np.int32],
    number: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Return the mask of objects (T,) with surfaces that are upright and square to each other.

    Args:
        mesh: all triangles (F).
        cross: (F, 3) normals with the length of twice the area.
        thing: (F,) object of each triangle.
        number: (T,) numbers of the objects.
    """
    size = np.linalg.norm(cross, axis=1)
    surface = size * (mesh.object == SURFACE)
    upright = surface * (np.abs(cross[:, 2]) < 0.3 * size)
    turn = 4 * np.arctan2(cross[:, 1], cross[:, 0])  # equal for all sides of a box
    along = np.hypot(
        total(upright * np.cos(turn), thing, number), total(upright * np.sin(turn), thing, number)
    )
    share = total(surface, thing, number) / np.maximum(total(size, thing, number), 1e-9)
    square = along / np.maximum(total(surface, thing, number), 1e-9)
    return np.asarray((share > _SURFACES) & (square > _SQUARE))


def _things(corner: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the object (F,) of each triangle, from 1: touching cells form one object."""
    low = corner.min(axis=(0, 1))
    spots = np.concatenate([corner, corner.mean(axis=1, keepdims=True)], axis=1)
    cell = np.floor((spots - low) / _CELL_M).astype(np.int64)
    grid = np.zeros(cell.max(axis=(0, 1)) + 1, bool)
    grid[tuple(cell.reshape(-1, 3).T)] = True
    thing, _ = label(grid, np.ones((3, 3, 3)))
    _, number = np.unique(thing[tuple(cell[:, 3].T)], return_inverse=True)
    return np.asarray(number + 1, np.int32)


def _sides(
    middle: NDArray[np.float64], thing: NDArray[np.int32], number: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return length and width in plan of objects, along the main directions of their triangles."""
    xy = middle[:, :2]
    centre = np.array([mean(xy[:, k], thing, number) for k in (0, 1)])
    off = xy - centre.T[thing - 1]
    xx, yy, xy_ = (
        np.atleast_1d(mean(off[:, i] * off[:, j], thing, number))
        for i, j in ((0, 0), (1, 1), (0, 1))
    )
    turn = 0.5 * np.arctan2(2 * xy_, xx - yy)[thing - 1]
    along = off[:, 0] * np.cos(turn) + off[:, 1] * np.sin(turn)
    across = off[:, 1] * np.cos(turn) - off[:, 0] * np.sin(turn)
    sides = [maximum(one, thing, number) - minimum(one, thing, number) for one in (along, across)]
    return np.atleast_1d(np.maximum(*sides)), np.atleast_1d(np.minimum(*sides))
