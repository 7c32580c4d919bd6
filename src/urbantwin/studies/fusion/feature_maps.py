"""Middle fusion: encoder features of pillars, merged before the detector's backbone.

Every node runs the encoder on its own points, in a grid of cells around itself. The grid is either
aligned with the site's axes, at multiples of the cell size by the node's reported pose, so that the
cells of all nodes coincide; or with the node's own axes, and is then resampled by the receiver.
Values of a cell from several nodes are merged by maximum, as the encoder merges the points of a
pillar. This needs no trained fusion.
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
    """Encoder output of a node.

    Attributes:
        site_SE3_map: pose of the map's frame in the site: origin at the node, z up.
        grid: the cells, in that frame.
        cell: (K,) int64 occupied cells, ascending.
        values: (K, C) float32, non-negative.
        likely: (K,) 0..1, the whole network's score of a road user there or in a neighbouring cell.
        ground: ground below the points, in that frame.
    """

    site_SE3_map: Pose  # noqa: N815
    grid: Grid
    cell: NDArray[np.int64]
    values: NDArray[np.float32]
    likely: NDArray[np.float32]
    ground: Ground


def encoded(model: Model, frame: Frame, site_SE3_frame: Pose, *, along_site: bool) -> Encoded:
    """Return a model's encoder output for a frame.

    Args:
        model: a detector.
        frame: frame of a node, in its own frame of reference.
        site_SE3_frame: reported pose of that frame of reference.
        along_site: align cells with the site's axes, at multiples of their edge.
    """
    design = model.design
    place = site_SE3_frame.apply(frame.sensor_places).mean(axis=0)
    yaw = 0.0 if along_site else ypr_from_rotation(site_SE3_frame.rotation)[0]
    # Same precision as in a header: millimetres and microradians.
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
    """Return the cells of a map to send.

    Cells where the node itself detects road users come first; ties are broken by the energy of the
    values.

    Args:
        known: encoder output of the node.
        most: largest number of cells; all if None.
        stride: cells per edge of a sent cell, which has the maxima of its cells.
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
    """Return the receiver's cells covered by a map: numbers (K,) and values (K, C).

    Each cell gets the values of the sender's cell that contains its centre.

    Args:
        sent: the sender's cells.
        site_SE3_map: reported pose of the frame of the sender's map.
        mine: encoder output of the receiver.
        moved: road users in the site frame at the sender's time, and now.
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
    """Return all cells (cells^2, C) of the receiver: the maxima over all nodes."""
    canvas = np.zeros((mine.grid.cells**2, mine.values.shape[1]), np.float32)
    canvas[mine.cell] = mine.values
    for cell, values in others:
        canvas[cell] = np.maximum(canvas[cell], values)
    return canvas


def detected_in_cells(
    model: Model, mine: Encoded, canvas: NDArray[np.float32], least: float
) -> Found:
    """Return a model's detections in merged cells, in the site frame.

    Args:
        model: the detector.
        mine: encoder output of the receiver: cells and ground.
        canvas: see `merged`.
        least: lowest score of a box.
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
    """Return positions (N, 2) in another frame, rotated by its heading only."""
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
    """Return the probability of a centre of any class within a cell of each cell (cells, cells)."""
    most = np.zeros((cells, cells), np.float32)
    for head in heads:
        likely = 1 / (1 + np.exp(-head[0].astype(np.float64)))
        stride = cells // len(likely)
        likely = maximum_filter(likely, size=3)
        most = np.maximum(most, likely.repeat(stride, axis=0).repeat(stride, axis=1))
    return most
