"""Pre-training without labels: the network says where anything is, and how high it reaches.

- ``masked``: blocks of cells are taken from the input, and it is asked about these, as Hess et al.
  2023, "Masked Autoencoder for Self-Supervised Pre-training on Lidar Point Clouds", do with voxels;
- ``next-sweep``: it is asked about all cells as the next sweep shows them in this one's place, as
  Khurana et al. 2023, "Point Cloud Forecasting as a Proxy for 4D Occupancy Forecasting", ask for
  what comes.

What it learned begins a detector; its last layer is thrown away.
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

#: What is asked for.
TASKS = ("masked", "next-sweep")

#: Blocks of so many cells each way are hidden, so many of all.
_BLOCK, _SHARE = 4, 0.5
#: Which of a pillar's features is the height of its highest point (`pillars.pillars_of`).
_HIGHEST = 6
#: Of a cell that is not empty, against one that is.
_OCCUPIED_WEIGHT = 4.0


@dataclass(frozen=True, eq=False)
class Question:
    """A sample.

    Attributes:
        pillars: those that are shown.
        asked: (cells, cells) bool, which cells are asked about.
        occupied: (cells, cells) float32, 1 where anything is.
        highest: (cells, cells) float32, as `pillars.Pillars.features` tells it; 0 where nothing is.
    """

    pillars: Pillars
    asked: NDArray[np.bool_]
    occupied: NDArray[np.float32]
    highest: NDArray[np.float32]


def hidden_of(pillars: Pillars, cells: int, draw: np.random.Generator) -> Question:
    """Return pillars of one grid with blocks of them hidden, and these asked for.

    Args:
        pillars: of the grid.
        cells: along its sides: a multiple of 8.
        draw: random numbers.
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
    """Return pillars of one grid, and all of the next sweep's asked for.

    Args:
        pillars: of the grid.
        after: those of the next sweep in the same grid.
        cells: along its sides.
    """
    return Question(pillars, np.ones((cells, cells), bool), *_said(after, cells))


def _said(pillars: Pillars, cells: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where anything is, and how high it reaches (cells, cells)."""
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
    """Return a network without heads that was trained on what it was not shown.

    Args:
        frames: without labels; for ``next-sweep`` some of them with the sweep after them.
        design: of the network, without classes.
        recipe: how.
        state: a file that keeps the state: where it is, training goes on from it.
        tell: called with the share that is done and the loss.
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
    """A network that says of each cell whether anything is there and how high it reaches."""

    def __init__(self, body: Detector) -> None:
        super().__init__()
        self.body = body
        self.last = nn.Conv2d(body.channels, 2, 1)

    def forward(self, features: Tensor, points: Tensor, cell: Tensor, shape: Tensor) -> Tensor:
        """Return (grids, 2, rows, columns); see `Detector.forward`."""
        fine, _ = self.body.maps(features, points, cell, shape)
        return torch.as_tensor(self.last(fine))


class _Windows:
    """Batches of windows of frames with blocks hidden."""

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
        """Return the pillars of a window of a frame, varied, and how the frame is placed in it."""
        frame, placement = varied_window(
            self._frames.frame(number), self.recipe.window_m, draw, varied=self._varied
        )
        return pillars_of(frame.points, self.grid), placement


class _NextWindows(_Windows):
    """Batches of windows of frames and of the sweeps after them."""

    def _made(self, draw: np.random.Generator) -> Question:
        number = self._frames.followed[int(draw.integers(len(self._frames.followed)))]
        pillars, placement = self._seen(number, draw)
        after = pillars_of(placement.points(self._frames.following(number)), self.grid)
        return next_of(pillars, after, self.grid.cells)


class _FromFrames:
    """How wrong a network is about what it was not shown."""

    def __init__(self, network: _Guesser, source: _Windows) -> None:
        self._network, self.source = network, source

    def loss(self, batch: Mapping[str, Tensor]) -> Tensor:
        cells, features = self.source.grid.cells, batch["features"]
        shape = features.new_zeros((self.source.recipe.batch, 0, cells, cells))
        said = self._network(features, batch["points"], batch["cell"], shape).float()
        asked, occupied, highest = batch["asked"], batch["occupied"], batch["highest"]
        # Of pillars that are merged: whether any was hidden and occupied, and the highest of them.
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
