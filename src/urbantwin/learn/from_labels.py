"""Detectors that learn from labels: boxes, and classes of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from urbantwin.learn.grid import Grid
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.loss import detection_loss, on_device, point_loss, points_on_device
from urbantwin.learn.model import Design, new_network
from urbantwin.learn.network import Detector, inputs_of
from urbantwin.learn.pillars import stacked
from urbantwin.learn.sample import Sample, sample_of
from urbantwin.learn.training import Recipe, optimised
from urbantwin.progress import Progress
from urbantwin.taxonomy import semantic_id

__all__ = ["trained"]

#: Samples that tell how many objects of a class one has on average.
_TRIED = 48
#: What random numbers are for: samples of steps, and those that tell how many objects are usual.
_SAMPLES, _USUAL = 0, 1
#: A class of points weighs by the root of how rare it is, and at most so much.
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
        frames: to learn from.
        design: of the network.
        recipe: how; ``steps`` or ``minutes`` is given.
        state: a file that keeps the state: where it is, training goes on from it.
        tell: called with the share that is done and the loss.
        start: weights to begin with, by name; the others are drawn.
    """
    torch.manual_seed(recipe.seed)
    network = new_network(design).to(recipe.device)
    network.load_state_dict(dict(start or {}), strict=False)
    steps, loss = optimised(network, _FromLabels(network, frames, design, recipe), recipe, state,
                            tell)  # fmt: skip
    return network, steps, loss


class _FromLabels:
    """Windows of labelled frames, and how wrong a network is about them."""

    def __init__(
        self, network: Detector, frames: LabelledFrames, design: Design, recipe: Recipe
    ) -> None:
        self._network, self._frames, self._design = network, frames, design
        self._recipe, self._bank = recipe, frames.bank
        self._grid = Grid.around(0.0, 0.0, recipe.window_m / 2, design.cell_m)
        self._semantic = [semantic_id(name) for name in design.points]
        first = np.searchsorted(frames.rigs, np.arange(max(frames.rigs) + 2))
        self._first = [int(one) for one in first]
        tried = [self._made(_USUAL, k, 0) for k in range(_TRIED)]
        usual = np.mean([[one.objects for one in sample.targets] for sample in tried], axis=0)
        self._usual = [float(one) for one in usual]
        count = np.array([frames.points.get(name, 0) for name in design.points], np.float64)
        weight = np.sqrt(np.median(count) / count) if len(count) else count
        self._weights = np.clip(weight, 1 / _MOST_WEIGHT, _MOST_WEIGHT).tolist()

    def sample(self, step: int, slot: int) -> Sample:
        return self._made(_SAMPLES, step, slot)

    def loss(self, samples: Sequence[Sample]) -> Tensor:
        cells, device = self._grid.cells, self._recipe.device
        given = inputs_of(stacked([one.pillars for one in samples], cells), cells, device)
        targets = [one.points for one in samples if one.points is not None]
        asked = points_on_device(targets, cells**2, device) if targets else ()
        said = self._network(*given, *asked[:2])
        wanted = on_device([one.targets for one in samples], device)
        heads = self._design.heads
        total = given[0].new_zeros(())
        if heads:
            total = detection_loss(said[: len(heads)], wanted, heads, self._usual).sum()
        return total + point_loss(said[-1], asked[2], self._weights) if asked else total

    def _made(self, use: int, step: int, slot: int) -> Sample:
        draw = np.random.default_rng([self._recipe.seed, use, step, slot])
        number = self._drawn_frame(draw, step if use == _SAMPLES else None)
        return sample_of(
            self._frames.frame(number),
            self._recipe.window_m,
            self._design.cell_m,
            self._design.heads,
            draw,
            semantic=self._semantic,
            bank=self._bank,
            rig=self._frames.rigs[number],
            varied=self._recipe.varied,
        )

    def _drawn_frame(self, draw: np.random.Generator, step: int | None) -> int:
        """Return any frame; in a curriculum, of the datasets that have come until this step."""
        steps = self._recipe.steps
        if not self._recipe.in_order or step is None or steps is None:
            return int(draw.integers(len(self._frames)))
        datasets = len(self._first) - 1
        now = min(step * datasets // steps, datasets - 1)
        return int(draw.integers(self._first[now], self._first[now + 1]))
