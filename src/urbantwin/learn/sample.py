"""A training sample: an augmented window of a frame with its targets."""

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

#: Share of windows that are placed about a box, with equal probability for every class.
_ABOUT_A_BOX = 0.8


@dataclass(frozen=True)
class Varied:
    """Switches of the augmentation.

    Attributes:
        placed: rotation, reflection and scaling of the frame.
        beams: removal of beams.
        objects: pasting of objects from other frames.
        sizes: scaling of objects.
        clutter: insertion of unlabelled obstacles.
    """

    placed: bool = True
    beams: bool = True
    objects: bool = True
    sizes: bool = True
    clutter: bool = True


@dataclass(frozen=True, eq=False)
class Sample:
    """Input and targets of a training step from one frame."""

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
    """Return an augmented window of a frame, centred at (0, 0), and its transformation.

    Args:
        frame: frame with or without labels.
        window_m: edge of the square window, metres.
        draw: random generator.
        classes: classes of objects that are pasted and scaled.
        bank: objects to paste.
        rig: index of the frame's recording.
        varied: switches of the augmentation; all on if not given.
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
    """Return a training sample.

    Args:
        frame: labelled frame.
        window_m: edge of the square window, metres.
        cell_m: edge of a pillar, metres.
        heads: heads of the object classes.
        draw: random generator; the only source of randomness of the sample.
        semantic: ids of the semantic classes to learn.
        bank: objects to paste.
        rig: index of the frame's recording.
        varied: switches of the augmentation; all on if not given.
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
    """Return the boxes (B, 7) of an augmented window and their class indices (B,).

    Boxes with too few points left are `IGNORED`.

    Args:
        frame: frame that `varied_window` returned.
        placement: its transformation.
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
    """Draw the centre of the window: near a box, or anywhere in the frame."""
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
    """Return the labelled area of a sample as a mask of cells; ``None`` if it covers all cells."""
    if frame.counted.all():
        return None
    places = placement.back(grid.middles(np.arange(grid.cells**2)))
    size = len(frame.counted)
    at = np.floor(places / COUNTED_M).astype(np.int64) + size // 2
    column, row = np.clip(at, 0, size - 1).T
    return np.asarray(frame.counted[row, column]).reshape(grid.cells, grid.cells)
