"""Middle fusion: what a detector's encoder knows of pillars, merged before its backbone.

Every node runs the encoder on its own points, in a lattice of cells about itself: one that lies
along the site's axes, at whole multiples of a cell as far as the node knows where it is, so that
the cells of all nodes coincide; or one along its own axes, which the receiver turns into its own.
What several nodes say of a cell is merged by the greatest values, as the encoder itself merges the
points of a pillar. No detector has to be trained for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose, ypr_from_rotation
from urbantwin.learn.decoding import Found, boxes_of_maps
from urbantwin.learn.frames import levelled
from urbantwin.learn.grid import Grid
from urbantwin.learn.ground import Ground
from urbantwin.learn.model import Model
from urbantwin.learn.network import inputs_of
from urbantwin.learn.pillars import pillars_of
from urbantwin.studies.fusion.advance import places_before
from urbantwin.studies.fusion.box_codec import Boxes
from urbantwin.studies.fusion.feature_codec import FeatureMap

__all__ = ["Encoded", "chosen_cells", "detected_in_cells", "encoded", "merged", "warped"]


@dataclass(frozen=True, eq=False)
class Encoded:
    """What a node's encoder says of the pillars about it.

    Attributes:
        site_SE3_map: where the frame of the map is in the site: its origin is the node's place,
            its z axis is up.
        grid: the cells, in that frame.
        cell: (K,) int64 which are occupied, ascending.
        values: (K, C) float32, none below zero.
        likely: (K,) how likely a road user is there or beside, as the whole network says: 0..1.
        ground: beneath the points, in that frame.
    """

    site_SE3_map: Pose  # noqa: N815
    grid: Grid
    cell: NDArray[np.int64]
    values: NDArray[np.float32]
    likely: NDArray[np.float32]
    ground: Ground


def encoded(model: Model, frame: Frame, site_SE3_frame: Pose, *, along_site: bool) -> Encoded:
    """Return what a model's encoder says of a frame.

    Args:
        model: a detector.
        frame: of a node, in its own frame.
        site_SE3_frame: where that is, as the node knows it.
        along_site: lay the cells along the site's axes, at whole multiples of their edge.
    """
    design = model.design
    place = site_SE3_frame.apply(frame.sensor_places).mean(axis=0)
    yaw = 0.0 if along_site else ypr_from_rotation(site_SE3_frame.rotation)[0]
    # As a header tells it: to a millimetre and a microradian.
    site_SE3_map = Pose.from_ypr(np.rint(place * 1e3) / 1e3, round(yaw, 6))
    level = levelled(
        frame.moved(site_SE3_map.inverse() @ site_SE3_frame),
        design.range_m,
        intensity=design.intensity,
    )
    origin = site_SE3_map.translation[:2] + level.middle if along_site else np.zeros(2)
    plain = Grid.around(0.0, 0.0, design.range_m, design.cell_m)
    corner = plain.low
    if along_site:
        corner = np.floor((corner + origin) / design.cell_m + 0.5) * design.cell_m - origin
    grid = Grid(float(corner[0]), float(corner[1]), design.cell_m, plain.cells)
    pillars = pillars_of(level.frame.points, grid)
    with torch.inference_mode():
        features, points, cell, _ = inputs_of(pillars, grid.cells, _device(model))
        values = model.network.encoder(features, points)
        said = _said(model, _canvas(cell, values, grid.cells))
    numbers = pillars.cell
    likely = _likely(said, grid.cells).reshape(-1)[numbers]
    x, y = (corner + level.middle).tolist()
    shifted = Grid(x, y, design.cell_m, plain.cells)
    found = values.float().cpu().numpy()
    return Encoded(site_SE3_map, shifted, numbers, found, likely, level.ground)


def chosen_cells(known: Encoded, most: int | None, stride: int, model: bytes) -> FeatureMap:
    """Return the cells of a map that are worth telling, as they are told.

    Cells where the node itself sees road users are told first; of cells that are equally likely
    those with the greatest values.

    Args:
        known: of the node.
        most: so many at most; all if None.
        stride: cells along an edge of what is told; a coarser one has the greatest values.
        model: eight bytes that tell the network from others.
    """
    grid = known.grid
    cell, values, likely = known.cell, known.values, known.likely
    if stride > 1:
        row, column = np.divmod(cell, grid.cells)
        coarse = row // stride * (grid.cells // stride) + column // stride
        order = np.argsort(coarse, kind="stable")
        cell, first = np.unique(coarse[order], return_index=True)
        values = np.maximum.reduceat(values[order], first, axis=0) if len(first) else values
        likely = np.maximum.reduceat(likely[order], first) if len(first) else likely
        grid = grid.coarser(stride)
    if most is not None and most < len(cell):
        strength = (values.astype(np.float64) ** 2).sum(axis=1)
        kept = np.sort(np.lexsort((-strength, -likely))[:most])
        cell, values = cell[kept], values[kept]
    return FeatureMap(model, grid.x, grid.y, grid.cell_m, grid.cells, cell, values)


def warped(
    told: FeatureMap,
    site_SE3_map: Pose,
    mine: Encoded,
    moved: tuple[Boxes, Boxes] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return what a map says of the receiver's cells: numbers (K,) and values (K, C).

    Each of the receiver's cells has what the sender says of the cell that its middle lies in.

    Args:
        told: by the sender.
        site_SE3_map: where the frame of the sender's map is, as it says.
        mine: of the receiver.
        moved: road users in the site when the sender looked, and where they are now.
    """
    grid = mine.grid
    every = np.arange(grid.cells**2)
    places = _in_plan(mine.site_SE3_map, grid.middles(every))
    shows = np.ones(len(every), bool)
    if moved is not None:
        places, shows = places_before(places, *moved)
    places = _in_plan(site_SE3_map.inverse(), places)
    column, row = np.floor((places - [told.x, told.y]) / told.cell_m).astype(np.int64).T
    inside = shows & (column >= 0) & (column < told.cells) & (row >= 0) & (row < told.cells)
    at = np.full(told.cells**2, -1, np.int64)
    at[told.cell] = np.arange(len(told.cell))
    which = np.full(len(every), -1, np.int64)
    which[inside] = at[row[inside] * told.cells + column[inside]]
    seen = np.flatnonzero(which >= 0)
    return seen, told.values[which[seen]]


def merged(
    mine: Encoded, others: list[tuple[NDArray[np.int64], NDArray[np.float32]]]
) -> NDArray[np.float32]:
    """Return all cells (cells^2, C) of the receiver: of what nodes say the greatest values."""
    canvas = np.zeros((mine.grid.cells**2, mine.values.shape[1]), np.float32)
    canvas[mine.cell] = mine.values
    for cell, values in others:
        canvas[cell] = np.maximum(canvas[cell], values)
    return canvas


def detected_in_cells(
    model: Model, mine: Encoded, canvas: NDArray[np.float32], least: float
) -> Found:
    """Return what a model finds in merged cells, in the site.

    Args:
        model: the detector.
        mine: of the receiver: the cells, and the ground.
        canvas: see `merged`.
        least: boxes that are less likely are left out.
    """
    cells = mine.grid.cells
    with torch.inference_mode():
        whole = torch.from_numpy(canvas).to(_device(model)).reshape(1, cells, cells, -1)
        maps = _said(model, whole.permute(0, 3, 1, 2).contiguous())
    found = boxes_of_maps(maps, mine.grid, model.design.heads, least)
    box = found.box.copy()
    box[:, 2] += mine.ground.at(box)
    box[:, :3] = mine.site_SE3_map.apply(box[:, :3])  # its axes are the site's
    return Found(box, found.number, found.score)


def _in_plan(outer_SE3_inner: Pose, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (N, 2) in another frame, of whose attitude the heading alone counts."""
    yaw = np.arctan2(outer_SE3_inner.rotation[1, 0], outer_SE3_inner.rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(places @ np.array([[c, s], [-s, c]]) + outer_SE3_inner.translation[:2])


def _device(model: Model) -> str:
    return str(next(model.network.parameters()).device)


def _canvas(cell: torch.Tensor, values: torch.Tensor, cells: int) -> torch.Tensor:
    canvas = values.new_zeros((cells**2, values.shape[1])).index_copy(0, cell, values)
    return canvas.reshape(1, cells, cells, -1).permute(0, 3, 1, 2).contiguous()


def _said(model: Model, canvas: torch.Tensor) -> list[NDArray[np.float32]]:
    network = model.network
    return [one[0].float().cpu().numpy() for one in network.said_of(*network.maps_of_cells(canvas))]


def _likely(said: list[NDArray[np.float32]], cells: int) -> NDArray[np.float32]:
    """Return how likely a centre of any class is within a cell of each (cells, cells)."""
    most = np.zeros((cells, cells), np.float32)
    for one in said:
        likely = 1 / (1 + np.exp(-one[0].astype(np.float64)))
        stride = cells // len(likely)
        likely = maximum_filter(likely, size=3)
        most = np.maximum(most, likely.repeat(stride, axis=0).repeat(stride, axis=1))
    return most
