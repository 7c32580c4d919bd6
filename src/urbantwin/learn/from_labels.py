"""Supervised training: boxes and semantic classes of points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from urbantwin.learn.batches import Arrays
from urbantwin.learn.grid import Grid
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.loss import (
    detection_loss,
    point_arrays,
    point_loss,
    target_arrays,
    targets_in,
)
from urbantwin.learn.model import Design, new_network
from urbantwin.learn.network import Detector
from urbantwin.learn.pillars import stacked
from urbantwin.learn.sample import Sample, sample_of
from urbantwin.learn.torch_device import on_device
from urbantwin.learn.training import Recipe, optimised
from urbantwin.progress import Progress
from urbantwin.taxonomy import semantic_id

__all__ = ["Windows", "trained"]

#: Number of samples for the mean number of objects of each class.
_TRIED = 48
#: Random streams: samples of steps, and samples for the mean numbers of objects.
_SAMPLES, _USUAL = 0, 1
#: Largest weight of a semantic class; weights are the square root of the inverse frequency.
_MOST_WEIGHT = 5.0


def trained(
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    state: Path,
    tell: Progress,
    start: Mapping[str, Tensor] | None = None,
) -> tuple[Detector, int, float]:
    """Return a trained network, the number of steps, and the mean loss of the last tenth of them.

    Args:
        frames: training set.
        design: design of the network.
        recipe: hyperparameters; ``steps`` or ``minutes`` is set.
        state: checkpoint file; training resumes from it if it exists.
        tell: progress callback, with the loss.
        start: initial weights by name; the others are random.
    """
    torch.manual_seed(recipe.seed)
    network = new_network(design)
    network.load_state_dict(dict(start or {}), strict=False)
    source = Windows(frames, design, recipe)
    task = _FromLabels(on_device(network, recipe.device), source, frames.points)
    steps, loss = optimised(network, task, recipe, state, tell)
    return network, steps, loss


class Windows:
    """Batches of windows of labelled frames.

    Args:
        frames: training set.
        design: design of the network.
        recipe: hyperparameters of the samples.
    """

    def __init__(self, frames: LabelledFrames, design: Design, recipe: Recipe) -> None:
        self.design, self.recipe = design, recipe
        self._frames, self._bank = frames, frames.bank
        self.grid = Grid.around(0.0, 0.0, recipe.window_m / 2, design.cell_m)
        self._semantic = [semantic_id(name) for name in design.points]
        first = np.searchsorted(frames.rigs, np.arange(max(frames.rigs) + 2))
        self._first = [int(one) for one in first]

    def batch(self, step: int) -> Arrays:
        """Return the samples of a step as one batch."""
        samples = [self._made(_SAMPLES, step, slot) for slot in range(self.recipe.batch)]
        cells = self.grid.cells
        found = stacked([one.pillars for one in samples], cells)
        found |= target_arrays([one.targets for one in samples])
        targets = [one.points for one in samples if one.points is not None]
        return found | point_arrays(targets, cells**2) if targets else found

    def usual(self) -> list[float]:
        """Return the mean number of objects of each class in a sample."""
        tried = [self._made(_USUAL, k, 0) for k in range(_TRIED)]
        counts = [[one.objects for one in sample.targets] for sample in tried]
        return [float(one) for one in np.mean(counts, axis=0)]

    def _made(self, use: int, step: int, slot: int) -> Sample:
        draw = np.random.default_rng([self.recipe.seed, use, step, slot])
        number = self._drawn_frame(draw, step if use == _SAMPLES else None)
        return sample_of(
            self._frames.frame(number),
            self.recipe.window_m,
            self.design.cell_m,
            self.design.heads,
            draw,
            semantic=self._semantic,
            bank=self._bank,
            rig=self._frames.rigs[number],
            varied=self.recipe.varied,
        )

    def _drawn_frame(self, draw: np.random.Generator, step: int | None) -> int:
        """Draw a frame; in a curriculum, from the dataset of this step."""
        steps = self.recipe.steps
        if not self.recipe.in_order or step is None or steps is None:
            return int(draw.integers(len(self._frames)))
        datasets = len(self._first) - 1
        now = min(step * datasets // steps, datasets - 1)
        return int(draw.integers(self._first[now], self._first[now + 1]))


class _FromLabels:
    """Task of a network on windows of labelled frames."""

    def __init__(self, network: Detector, source: Windows, points: Mapping[str, int]) -> None:
        self._network, self.source = network, source
        self._usual = source.usual()
        count = np.array([points.get(name, 0) for name in source.design.points], np.float64)
        weight = np.sqrt(np.median(count) / count) if len(count) else count
        self._weights = np.clip(weight, 1 / _MOST_WEIGHT, _MOST_WEIGHT).tolist()

    def loss(self, batch: Mapping[str, Tensor]) -> Tensor:
        heads, cells = self.source.design.heads, self.source.grid.cells
        features = batch["features"]
        shape = features.new_zeros((self.source.recipe.batch, 0, cells, cells))
        asked = "wanted" in batch
        said = self._network(
            features, batch["points"], batch["cell"], shape, batch.get("told"), batch.get("at")
        )
        total = features.new_zeros(())
        if heads:
            wanted = targets_in(batch, len(heads))
            total = detection_loss(said[: len(heads)], wanted, heads, self._usual).sum()
        return total + point_loss(said[-1], batch["wanted"], self._weights) if asked else total
