"""Self-supervised pre-training: the network predicts occupancy and height of cells.

- ``masked``: for blocks of cells that are removed from the input, as Hess et al. 2023, "Masked
  Autoencoder for Self-Supervised Pre-training on Lidar Point Clouds", with voxels;
- ``next-sweep``: for all cells in the next sweep, as in Khurana et al. 2023, "Point Cloud
  Forecasting as a Proxy for 4D Occupancy Forecasting".

The weights initialise a detector; the last layer is discarded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from urbantwin.learn.augmentation.placement import Placement
from urbantwin.learn.batches import Arrays
from urbantwin.learn.grid import Grid
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.model import Design, new_network
from urbantwin.learn.network import Detector
from urbantwin.learn.pillars import Pillars, pillars_of, stacked
from urbantwin.learn.sample import varied_window
from urbantwin.learn.torch_device import on_device
from urbantwin.learn.training import Recipe, optimised
from urbantwin.progress import Progress

__all__ = ["TASKS", "Question", "hidden_of", "next_of", "pretrained"]

#: Pretext tasks.
TASKS = ("masked", "next-sweep")

#: Edge of a hidden block, cells, and share of hidden blocks.
_BLOCK, _SHARE = 4, 0.5
#: Index of the feature with the height of a pillar's highest point (`pillars.pillars_of`).
_HIGHEST = 6
#: Weight of an occupied cell against an empty one.
_OCCUPIED_WEIGHT = 4.0


@dataclass(frozen=True, eq=False)
class Question:
    """A pre-training sample.

    Attributes:
        pillars: visible pillars.
        asked: (cells, cells) bool: cells to predict.
        occupied: (cells, cells) float32: 1 in occupied cells.
        highest: (cells, cells) float32: height feature of the highest point; 0 in empty cells.
    """

    pillars: Pillars
    asked: NDArray[np.bool_]
    occupied: NDArray[np.float32]
    highest: NDArray[np.float32]


def hidden_of(pillars: Pillars, cells: int, draw: np.random.Generator) -> Question:
    """Return a sample of the task ``masked``.

    Args:
        pillars: pillars of a grid.
        cells: number of cells along its edge, a multiple of 8.
        draw: random generator.
    """
    blocks = draw.random((cells // _BLOCK, cells // _BLOCK)) < _SHARE
    asked = np.repeat(np.repeat(blocks, _BLOCK, axis=0), _BLOCK, axis=1)
    shown = ~asked.ravel()[pillars.cell]
    rest = replace(
        pillars,
        features=pillars.features[shown],
        points=pillars.points[shown],
        cell=pillars.cell[shown],
    )
    return Question(rest, asked, *_said(pillars, cells))


def next_of(pillars: Pillars, after: Pillars, cells: int) -> Question:
    """Return a sample of the task ``next-sweep``.

    Args:
        pillars: pillars of a grid.
        after: pillars of the next sweep on the same grid.
        cells: number of cells along its edge.
    """
    return Question(pillars, np.ones((cells, cells), bool), *_said(after, cells))


def _said(pillars: Pillars, cells: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return occupancy and highest points (cells, cells)."""
    occupied, highest = np.zeros((2, cells * cells), np.float32)
    occupied[pillars.cell] = 1.0
    highest[pillars.cell] = pillars.features[:, 0, _HIGHEST]
    return occupied.reshape(cells, cells), highest.reshape(cells, cells)


def pretrained(
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    state: Path,
    tell: Progress,
    task: str = TASKS[0],
) -> tuple[Detector, int, float]:
    """Pre-train a network without heads.

    Args:
        frames: unlabelled frames; for ``next-sweep`` at least some with their next sweep.
        design: design of the network, without classes.
        recipe: hyperparameters.
        state: checkpoint file; training resumes from it if it exists.
        tell: progress callback, with the loss.
        task: one of `TASKS`.

    Returns:
        The network, the number of steps, and the mean loss of the last tenth of them.
    """
    torch.manual_seed(recipe.seed)
    network = on_device(_Guesser(new_network(design)), recipe.device)
    source = (_NextWindows if task == "next-sweep" else _Windows)(frames, design, recipe)
    steps, loss = optimised(network, _FromFrames(network, source), recipe, state, tell)
    return network.body, steps, loss


class _Guesser(nn.Module):
    """A network with an output layer for occupancy and height of cells."""

    def __init__(self, body: Detector) -> None:
        super().__init__()
        self.body = body
        self.last = nn.Conv2d(body.channels, 2, 1)

    def forward(self, features: Tensor, points: Tensor, cell: Tensor, shape: Tensor) -> Tensor:
        """Return (grids, 2, rows, columns); see `Detector.forward`."""
        fine, _ = self.body.maps(features, points, cell, shape)
        return torch.as_tensor(self.last(fine))


class _Windows:
    """Batches of the task ``masked``."""

    def __init__(self, frames: LabelledFrames, design: Design, recipe: Recipe) -> None:
        self._frames, self.recipe = frames, recipe
        self._varied = replace(recipe.varied, objects=False, clutter=False)
        self.grid = Grid.around(0.0, 0.0, recipe.window_m / 2, design.cell_m)

    def batch(self, step: int) -> Arrays:
        """Return the samples of a step as one batch."""
        draws = [
            np.random.default_rng([self.recipe.seed, step, slot])
            for slot in range(self.recipe.batch)
        ]
        samples = [self._made(draw) for draw in draws]
        return stacked([one.pillars for one in samples], self.grid.cells) | {
            name: np.stack([getattr(one, name) for one in samples])
            for name in ("asked", "occupied", "highest")
        }

    def _made(self, draw: np.random.Generator) -> Question:
        pillars, _ = self._seen(int(draw.integers(len(self._frames))), draw)
        return hidden_of(pillars, self.grid.cells, draw)

    def _seen(self, number: int, draw: np.random.Generator) -> tuple[Pillars, Placement]:
        """Return the pillars of an augmented window of a frame, and its transformation."""
        frame, placement = varied_window(
            self._frames.frame(number), self.recipe.window_m, draw, varied=self._varied
        )
        return pillars_of(frame.points, self.grid), placement


class _NextWindows(_Windows):
    """Batches of the task ``next-sweep``."""

    def _made(self, draw: np.random.Generator) -> Question:
        number = self._frames.followed[int(draw.integers(len(self._frames.followed)))]
        pillars, placement = self._seen(number, draw)
        after = pillars_of(placement.points(self._frames.following(number)), self.grid)
        return next_of(pillars, after, self.grid.cells)


class _FromFrames:
    """Task of predicting occupancy and height."""

    def __init__(self, network: _Guesser, source: _Windows) -> None:
        self._network, self.source = network, source

    def loss(self, batch: Mapping[str, Tensor]) -> Tensor:
        cells, features = self.source.grid.cells, batch["features"]
        shape = features.new_zeros((self.source.recipe.batch, 0, cells, cells))
        said = self._network(features, batch["points"], batch["cell"], shape).float()
        asked, occupied, highest = batch["asked"], batch["occupied"], batch["highest"]
        # Targets of merged pillars: the maximum over each 2 x 2 block.
        step = cells // said.shape[-1]
        asked, occupied, highest = (
            functional.max_pool2d(one[:, None].float(), step)[:, 0]
            for one in (asked, occupied, highest)
        )
        there = functional.binary_cross_entropy_with_logits(
            said[:, 0], occupied, weight=1 + (_OCCUPIED_WEIGHT - 1) * occupied, reduction="none"
        )
        high = (said[:, 1] - highest).abs() * occupied
        off: Tensor = ((there + high) * asked).sum() / asked.sum().clamp(min=1)
        return off
