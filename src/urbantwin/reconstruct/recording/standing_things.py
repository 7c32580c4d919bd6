"""What the pieces of a recorded world are: plants, walls, poles, vehicles at rest, other things."""

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

#: Triangles in cells of this size that touch are of one thing, metres.
_CELL_M = 0.3
#: A thing is a plant if rays pass so much of its area; and if it is as high as a house, but so
#: little of it is surfaces, or these face so many ways: walls are upright and square to each other.
_LEAFY, _SURFACES, _SQUARE = 0.5, 0.25, 0.45
#: Thinner and higher: a pole, metres.
_POLE_WIDTH_M, _POLE_HEIGHT_M = 0.9, 1.5
#: A wall or a house is so high and so long, metres.
_HOUSE_HEIGHT_M, _HOUSE_LENGTH_M = 2.6, 3.0
#: Vehicles: longest side, shortest side at most, and height above their foot, metres.
_VEHICLE_LENGTH_M, _VEHICLE_WIDTH_M, _VEHICLE_HEIGHT_M = (1.6, 7.0), 3.0, (0.9, 2.4)
#: A vehicle on a carriageway has so much of its triangles there.
_ON_ROAD = 0.6
#: What waits on a carriageway farther inside than this, metres, lower than the highest bus, from as
#: low as an engine, as high as a bonnet and longer than any post or person is wide.
_EDGE_M, _BUS_M, _FROM_M, _BONNET_M, _WIDE_M = 0.4, 3.2, 0.8, 0.7, 1.2
#: Half of it is so far inside: roadside hedges and walls of inexact maps are not.
_DEEP_M = 0.8
#: Nothing that stands begins so high and ends so low, metres: it is the bonnet or the boot of who
#: waited, whose other parts others hid or too few beams met.
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
    """The things of a mesh of F triangles.

    Attributes:
        thing: (F,) int32, from 1.
        semantic: (F,) uint16.
        material: (F,) uint8.
        on_road: (F,) whether a triangle is of a vehicle that stands on a carriageway.
        counts: things by class.
    """

    thing: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    material: NDArray[np.uint8]
    on_road: NDArray[np.bool_]
    counts: dict[str, int]


def standing_things(mesh: TriangleMesh, roads: shapely.Geometry) -> StandingThings:
    """Tell what the triangles of a recorded world are of, by the shape of what hangs together.

    Args:
        mesh: of `recorded_world.read_recording`, site frame.
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
    """Return which triangles (F,) are of traffic that waits on carriageways, and how many wait.

    Of vehicles one side may be seen, or one hangs together with the next and with the tree above
    them: what stands on a carriageway is traffic whatever it looks like, but for posts.

    Args:
        mesh: of `recorded_world.read_recording`, site frame.
        roads: carriageways in plan; may be empty.
        above: (F,) height of the triangles' middles above the ground, metres; nan where unknown.
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
    """Return which things (T,) are of surfaces that are upright and square to each other.

    Args:
        mesh: all triangles (F).
        cross: (F, 3) their normals, as long as twice their areas.
        thing: (F,) whose they are.
        number: (T,) of the things.
    """
    size = np.linalg.norm(cross, axis=1)
    surface = size * (mesh.object == SURFACE)
    upright = surface * (np.abs(cross[:, 2]) < 0.3 * size)
    turn = 4 * np.arctan2(cross[:, 1], cross[:, 0])  # the same for all sides of a box
    along = np.hypot(
        total(upright * np.cos(turn), thing, number), total(upright * np.sin(turn), thing, number)
    )
    share = total(surface, thing, number) / np.maximum(total(size, thing, number), 1e-9)
    square = along / np.maximum(total(surface, thing, number), 1e-9)
    return np.asarray((share > _SURFACES) & (square > _SQUARE))


def _things(corner: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return which thing (F,) each triangle is of, from 1: cells that touch are of one."""
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
    """Return length and width in plan of things, along the main directions of their triangles."""
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
