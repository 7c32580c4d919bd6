"""Training set of the second stage: detections in augmented training frames, right or wrong.

On the unchanged frames, which the detector has overfitted, it makes too few errors; augmentation
brings errors as on new data.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from urbantwin.learn.batches import Arrays, batches
from urbantwin.learn.decoding import Found, boxes_of_maps
from urbantwin.learn.frames import IGNORED
from urbantwin.learn.grid import Grid
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.model import Design
from urbantwin.learn.network import Detector, inputs_of
from urbantwin.learn.pillars import Pillars, pillars_of
from urbantwin.learn.sample import counted_cells, labels_in_window, varied_window
from urbantwin.learn.second_look.crop import Crops, crops_of
from urbantwin.learn.second_look.scoring import looked_at
from urbantwin.learn.training import Recipe
from urbantwin.progress import Progress

__all__ = ["Proposals", "judged_proposals", "proposals_of"]

#: Random stream of the windows, distinct from those of the detector's training.
_WINDOWS = 2
#: Largest distance of centres for a match, metres.
_RIGHT_M = 1.0
#: Margin around ignored boxes within which detections are ignored, metres.
_IGNORED_BESIDE_M = 0.7
#: Largest number of false detections kept per window, drawn with probability by score.
_WRONG_KEPT = 24


@dataclass(frozen=True, eq=False)
class Proposals:
    """Detections for training.

    Attributes:
        crops: K crops.
        right: (K,) bool: whether the detection is right.
    """

    crops: Crops
    right: NDArray[np.bool_]


class _Windows:
    """Augmented windows of frames with the labels that judge detections."""

    def __init__(self, frames: LabelledFrames, design: Design, recipe: Recipe) -> None:
        self._frames, self._bank = frames, frames.bank
        self._design, self._recipe = design, recipe
        self.grid = Grid.around(0.0, 0.0, recipe.window_m / 2, design.cell_m)

    def batch(self, step: int) -> Arrays:
        draw = np.random.default_rng([self._recipe.seed, _WINDOWS, step])
        number = int(draw.integers(len(self._frames)))
        frame, placement = varied_window(
            self._frames.frame(number),
            self._recipe.window_m,
            draw,
            classes=self._design.classes,
            bank=self._bank,
            rig=self._frames.rigs[number],
            varied=self._recipe.varied,
        )
        box, of_class = labels_in_window(frame, placement)
        counted = counted_cells(frame, self.grid, placement)
        if counted is None:
            counted = np.ones((1, 1), bool)
        pillars = pillars_of(frame.points, self.grid)
        return {
            "features": pillars.features,
            "points": pillars.points,
            "cell": pillars.cell,
            "scene": frame.points,
            "sensors": placement.points(frame.sensors),
            "box": box,
            "number": of_class,
            "counted": counted,
        }


def proposals_of(
    network: Detector,
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    windows: int,
    tell: Progress,
) -> Proposals | None:
    """Return detections in windows of frames; ``None`` if all of them are right, or all wrong.

    Args:
        network: detector in evaluation mode, on the device of ``recipe``.
        frames: training set of the detector.
        design: design of the detector.
        recipe: hyperparameters of the detector's training.
        windows: number of windows.
        tell: progress callback.
    """
    source = _Windows(frames, design, recipe)
    crops: list[Crops] = []
    right: list[NDArray[np.bool_]] = []
    with closing(batches(source, 0, windows, recipe.workers)) as coming:
        for step, made in enumerate(coming):
            tell(step / windows, f"second stage: window {step + 1} of {windows}")
            if not len(made["cell"]):
                continue
            pillars = Pillars(made["features"], made["points"], made["cell"])
            found = _found(network, pillars, source.grid, design, recipe.device)
            is_right, counts = judged_proposals(
                found, made["box"], made["number"], source.grid, made["counted"]
            )
            draw = np.random.default_rng([recipe.seed, _WINDOWS, step, 1])
            kept = _kept(found.score, is_right, counts, draw)
            crops.append(crops_of(made["scene"], made["sensors"], found.only(kept)))
            right.append(is_right[kept])
    all_right = np.concatenate([np.zeros(0, bool), *right])
    if not all_right.any() or all_right.all():
        return None
    return Proposals(Crops.joined(crops), all_right)


def judged_proposals(
    found: Found,
    box: NDArray[np.float64],
    number: NDArray[np.int64],
    grid: Grid,
    counted: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which detections are right (N,), and which are not ignored (N,).

    Of several detections of one object, that of highest score is right and the others are ignored.

    Args:
        found: detections by descending score.
        box: (B, 7) labelled boxes.
        number: (B,) class index of each, or `IGNORED`.
        grid: grid of the window.
        counted: (cells, cells) labelled area, or (1, 1) if it covers all cells.
    """
    is_right = np.zeros(len(found.box), bool)
    counts = np.abs(found.box[:, :2]).max(axis=1, initial=0.0) < -grid.x
    if counted.size > 1:
        column, row = np.clip(
            np.floor((found.box[:, :2] - grid.low) / grid.cell_m).astype(np.int64),
            0,
            grid.cells - 1,
        ).T
        counts &= counted[row, column]
    apart = np.linalg.norm(found.box[:, None, :2] - box[None, :, :2], axis=2)
    same = (found.number[:, None] == number) & (apart < _RIGHT_M)
    reach = np.hypot(box[:, 3], box[:, 4]) / 2 + _IGNORED_BESIDE_M
    doubted = ((number == IGNORED) & (apart < reach)).any(axis=1)
    taken: set[int] = set()
    for k in range(len(found.box)):
        near = np.flatnonzero(same[k])
        free = [int(one) for one in near[np.argsort(apart[k, near])] if one not in taken]
        if free:
            taken.add(free[0])
            is_right[k] = True
        elif len(near) or doubted[k]:
            counts[k] = False
    return is_right & counts, counts


def _found(network: Detector, pillars: Pillars, grid: Grid, design: Design, device: str) -> Found:
    """Return the detections of the classes that the second stage rescores."""
    with torch.inference_mode():
        said = network(*inputs_of(pillars, grid.cells, device))
    maps = [one[0].float().cpu().numpy() for one in said[: len(design.classes)]]
    found = boxes_of_maps(maps, grid, design.heads)
    return found.only(looked_at(found, design.classes))


def _kept(
    score: NDArray[np.float64],
    is_right: NDArray[np.bool_],
    counts: NDArray[np.bool_],
    draw: np.random.Generator,
) -> NDArray[np.int64]:
    """Return the rows to learn from: all right detections, and some false ones by score."""
    wrong = np.flatnonzero(counts & ~is_right)
    if len(wrong) > _WRONG_KEPT:
        share = score[wrong] / score[wrong].sum()
        wrong = draw.choice(wrong, _WRONG_KEPT, replace=False, p=share)
    return np.sort(np.concatenate([np.flatnonzero(is_right), wrong]))
