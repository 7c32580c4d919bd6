"""Middle fusion: what a detector's encoder knows of pillars, merged before its backbone.

Every node runs the encoder on its own points, in a lattice of cells about itself: one that lies
along the site's axes, at whole multiples of a cell as far as the node knows where it is, so that
the cells of all nodes coincide; or one along its own axes, which the receiver turns into its own.
Values of one cell from several nodes are merged by their maximum, as the encoder itself merges the
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
from urbantwin.studies.fusion.boxes import Boxes, places_before
from urbantwin.studies.fusion.messages import FeatureMap

__all__ = ["Encoded", "chosen_cells", "detected_in_cells", "encoded", "merged", "warped"]


@dataclass(frozen=True, eq=False)
class Encoded:
    """What a node's encoder makes of the pillars about it.

    Attributes:
        site_SE3_map: where the frame of the map is in the site: its origin is the node's place,
            its z axis is up.
        grid: the cells, in that frame.
        cell: (K,) int64 which are occupied, ascending.
        values: (K, C) float32, none below zero.
        likely: (K,) 0..1 the whole network's score of a road user there or beside.
        ground: beneath the points, in that frame.
    """

    site_SE3_map: Pose  # noqa: N815
    grid: Grid
    cell: NDArray[np.int64]
    values: NDArray[np.float32]
    likely: NDArray[np.float32]
    ground: Ground


def encoded(model: Model, frame: Frame, site_SE3_frame: Pose, *, along_site: bool) -> Encoded:
    """Return what a model's encoder makes of a frame.

    Args:
        model: a detector.
        frame: of a node, in its own frame.
        site_SE3_frame: where that is, as the node knows it.
        along_site: lay the cells along the site's axes, at whole multiples of their edge.
    """
    design = model.design
    place = site_SE3_frame.apply(frame.sensor_places).mean(axis=0)
    yaw = 0.0 if along_site else ypr_from_rotation(site_SE3_frame.rotation)[0]
    # As in a header: to a millimetre and a microradian.
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
        heads = _heads(model, _canvas(cell, values, grid.cells))
    numbers = pillars.cell
    likely = _likely(heads, grid.cells).reshape(-1)[numbers]
    x, y = (corner + level.middle).tolist()
    shifted = Grid(x, y, design.cell_m, plain.cells)
    found = values.float().cpu().numpy()
    return Encoded(site_SE3_map, shifted, numbers, found, likely, level.ground)


def chosen_cells(known: Encoded, most: int | None, stride: int) -> FeatureMap:
    """Return the cells of a map that are sent.

    Cells where the node itself detects road users come first; of cells that are equally likely
    those with the greatest values.

    Args:
        known: of the node.
        most: largest number of cells; all if None.
        stride: cells along an edge of what is sent; a coarser cell has the greatest values.
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
    return FeatureMap(grid.x, grid.y, grid.cell_m, grid.cells, cell, values)


def warped(
    sent: FeatureMap,
    site_SE3_map: Pose,
    mine: Encoded,
    moved: tuple[Boxes, Boxes] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the receiver's cells that a map covers: numbers (K,) and values (K, C).

    Each of the receiver's cells has the values of the sender's cell that its middle is in.

    Args:
        sent: the sender's cells.
        site_SE3_map: reported pose of the frame of the sender's map.
        mine: of the receiver.
        moved: road users in the site when the sender looked, and now.
    """
    grid = mine.grid
    every = np.arange(grid.cells**2)
    places = _in_plan(mine.site_SE3_map, grid.middles(every))
    shows = np.ones(len(every), bool)
    if moved is not None:
        places, shows = places_before(places, *moved)
    places = _in_plan(site_SE3_map.inverse(), places)
    column, row = np.floor((places - [sent.x, sent.y]) / sent.cell_m).astype(np.int64).T
    inside = shows & (column >= 0) & (column < sent.cells) & (row >= 0) & (row < sent.cells)
    at = np.full(sent.cells**2, -1, np.int64)
    at[sent.cell] = np.arange(len(sent.cell))
    which = np.full(len(every), -1, np.int64)
    which[inside] = at[row[inside] * sent.cells + column[inside]]
    seen = np.flatnonzero(which >= 0)
    return seen, sent.values[which[seen]]


def merged(
    mine: Encoded, others: list[tuple[NDArray[np.int64], NDArray[np.float32]]]
) -> NDArray[np.float32]:
    """Return all cells (cells^2, C) of the receiver: the greatest values of all nodes."""
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
        least: least score of a box.
    """
    cells = mine.grid.cells
    with torch.inference_mode():
        whole = torch.from_numpy(canvas).to(_device(model)).reshape(1, cells, cells, -1)
        maps = _heads(model, whole.permute(0, 3, 1, 2).contiguous())
    found = boxes_of_maps(maps, mine.grid, model.design.heads, least)
    box = found.box.copy()
    box[:, 2] += mine.ground.at(box)
    box[:, :3] = mine.site_SE3_map.apply(box[:, :3])  # its axes are the site's
    return Found(box, found.number, found.score)


def _in_plan(outer_SE3_inner: Pose, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places (N, 2) in another frame, turned by its heading alone."""
    yaw = np.arctan2(outer_SE3_inner.rotation[1, 0], outer_SE3_inner.rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(places @ np.array([[c, s], [-s, c]]) + outer_SE3_inner.translation[:2])


def _device(model: Model) -> str:
    return str(next(model.network.parameters()).device)


def _canvas(cell: torch.Tensor, values: torch.Tensor, cells: int) -> torch.Tensor:
    canvas = values.new_zeros((cells**2, values.shape[1])).index_copy(0, cell, values)
    return canvas.reshape(1, cells, cells, -1).permute(0, 3, 1, 2).contiguous()


def _heads(model: Model, canvas: torch.Tensor) -> list[NDArray[np.float32]]:
    network = model.network
    return [
        head[0].float().cpu().numpy() for head in network.said_of(*network.maps_of_cells(canvas))
    ]


def _likely(heads: list[NDArray[np.float32]], cells: int) -> NDArray[np.float32]:
    """Return how likely a centre of any class is within a cell of each (cells, cells)."""
    most = np.zeros((cells, cells), np.float32)
    for head in heads:
        likely = 1 / (1 + np.exp(-head[0].astype(np.float64)))
        stride = cells // len(likely)
        likely = maximum_filter(likely, size=3)
        most = np.maximum(most, likely.repeat(stride, axis=0).repeat(stride, axis=1))
    return most
