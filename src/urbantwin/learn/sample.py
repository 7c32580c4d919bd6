"""One sample of a training step: a window of a frame, varied, with its targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.augmentation.beams import thinned
from urbantwin.learn.augmentation.clutter import cluttered
from urbantwin.learn.augmentation.pasting import ObjectBank, pasted
from urbantwin.learn.augmentation.placement import Placement, drawn_placement
from urbantwin.learn.augmentation.sizes import resized
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.frames import COUNTED_M, IGNORED, LEAST_POINTS, LevelFrame
from urbantwin.learn.grid import Grid
from urbantwin.learn.heads import ClassHead
from urbantwin.learn.pillars import Pillars, pillars_of
from urbantwin.learn.targets import ClassTarget, PointTarget, point_target_of, targets_of

__all__ = ["Sample", "Varied", "counted_cells", "labels_in_window", "sample_of", "varied_window"]

#: So many windows are laid about one of the boxes, by its class: a rare one as often as a car.
_ABOUT_A_BOX = 0.8


@dataclass(frozen=True)
class Varied:
    """How samples are varied.

    Attributes:
        placed: turned, mirrored, scaled.
        beams: with fewer beams.
        objects: with objects of other frames.
        sizes: with larger and smaller objects.
        clutter: with things that have no label.
    """

    placed: bool = True
    beams: bool = True
    objects: bool = True
    sizes: bool = True
    clutter: bool = True


@dataclass(frozen=True, eq=False)
class Sample:
    """What one frame gives to a training step."""

    pillars: Pillars
    targets: list[ClassTarget]
    points: PointTarget | None = None


def varied_window(
    frame: LevelFrame,
    window_m: float,
    draw: np.random.Generator,
    *,
    classes: Sequence[str] = (),
    bank: ObjectBank | None = None,
    rig: int = 0,
    varied: Varied | None = None,
) -> tuple[LevelFrame, Placement]:
    """Return the part of a frame about a window, varied, and how it is placed: about 0, 0.

    Args:
        frame: labelled or not.
        window_m: width of the square window of it.
        draw: random numbers.
        classes: whose objects are pasted and resized.
        bank: objects to paste.
        rig: of the frame.
        varied: how; in every way if not given.
    """
    varied = varied or Varied()
    half = window_m / 2
    reach = float(max(np.abs(frame.points[:, k]).max(initial=0.0) for k in (0, 1)))
    x, y = _middle_of_window(frame, half, reach, draw)
    if varied.clutter:
        frame = cluttered(frame, (x, y, half), draw)
    if varied.objects and bank is not None:
        frame = pasted(frame, bank, rig, classes, (x, y, half), draw)
    if varied.beams:
        stays = thinned(frame.ring, draw)
        frame = _some_points(frame, stays)
    placement = drawn_placement(draw, x, y, varied=varied.placed)
    far = np.float32(1.5 * half)
    along, across = (
        np.abs(frame.points[:, 0] - np.float32(x)),
        np.abs(frame.points[:, 1] - np.float32(y)),
    )
    near = (along < far) & (across < far)
    frame = _some_points(frame, near)
    if varied.sizes and classes:
        frame = resized(frame, classes, draw)
    return replace(frame, points=placement.points(frame.points)), placement


def sample_of(  # noqa: PLR0913 - a frame, the window, the network, the draws
    frame: LevelFrame,
    window_m: float,
    cell_m: float,
    heads: Sequence[ClassHead],
    draw: np.random.Generator,
    *,
    semantic: Sequence[int] = (),
    bank: ObjectBank | None = None,
    rig: int = 0,
    varied: Varied | None = None,
) -> Sample:
    """Return a sample.

    Args:
        frame: labelled.
        window_m: width of the square window of it.
        cell_m: edge of a pillar.
        heads: the classes.
        draw: all random numbers of this sample.
        semantic: ids of the classes of points that are learned.
        bank: objects to paste.
        rig: of the frame.
        varied: how; in every way if not given.
    """
    names = [head.name for head in heads]
    frame, placement = varied_window(
        frame, window_m, draw, classes=names, bank=bank, rig=rig, varied=varied
    )
    grid = Grid.around(0.0, 0.0, window_m / 2, cell_m)
    points = frame.points
    boxes, number = labels_in_window(frame, placement)
    counted = counted_cells(frame, grid, placement)
    of_points = point_target_of(points, frame.semantic, grid, semantic, draw) if semantic else None
    return Sample(
        pillars_of(points, grid), targets_of(boxes, number, grid, heads, counted), of_points
    )


def labels_in_window(
    frame: LevelFrame, placement: Placement
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the boxes (B, 7) of a varied window where it is placed, and their classes (B,).

    Whoever has too few points left is `IGNORED`.

    Args:
        frame: of `varied_window`.
        placement: of it.
    """
    boxes = placement.boxes(frame.box)
    inside = points_in_boxes(frame.points, boxes, 0.05)
    held = np.bincount(inside + 1, minlength=len(boxes) + 1)[1:]
    return boxes, np.where(held < LEAST_POINTS, IGNORED, frame.number)


def _some_points(frame: LevelFrame, chosen: NDArray[np.bool_]) -> LevelFrame:
    if chosen.all():
        return frame
    rows = np.flatnonzero(chosen)  # once for three arrays
    return replace(
        frame, points=frame.points[rows], ring=frame.ring[rows], semantic=frame.semantic[rows]
    )


def _middle_of_window(
    frame: LevelFrame, half: float, reach: float, draw: np.random.Generator
) -> tuple[float, float]:
    """Return where to look: about a box, or anywhere; within the frame."""
    most = max(reach - half, 0.0)
    x, y = draw.uniform(-most, most, 2) if most else (0.0, 0.0)
    beside = draw.uniform(-0.7 * half, 0.7 * half, 2)
    wanted, share = draw.random(), draw.random(2)
    known = np.unique(frame.number[frame.number >= 0])
    if wanted < _ABOUT_A_BOX and len(known):
        mine = np.flatnonzero(frame.number == known[int(share[0] * len(known))])
        x, y = frame.box[mine[int(share[1] * len(mine))], :2] + beside
    return float(np.clip(x, -most, most)), float(np.clip(y, -most, most))


def counted_cells(frame: LevelFrame, grid: Grid, placement: Placement) -> NDArray[np.bool_] | None:
    """Return in which cells of a sample labels count; None where they do everywhere."""
    if frame.counted.all():
        return None
    places = placement.back(grid.middles(np.arange(grid.cells**2)))
    size = len(frame.counted)
    at = np.floor(places / COUNTED_M).astype(np.int64) + size // 2
    column, row = np.clip(at, 0, size - 1).T
    return np.asarray(frame.counted[row, column]).reshape(grid.cells, grid.cells)
