"""Training of the second stage on detections, right or wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from urbantwin.learn.batches import Arrays
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.model import Design
from urbantwin.learn.network import Detector
from urbantwin.learn.second_look.crop import Crops
from urbantwin.learn.second_look.network import SecondLook
from urbantwin.learn.second_look.proposals import Proposals, proposals_of
from urbantwin.learn.training import Recipe, optimised
from urbantwin.progress import Progress, between

__all__ = ["second_look_trained"]

#: Windows and steps for each step of the detector's training, and their upper bounds.
_WINDOWS, _MOST_WINDOWS = 1.0, 3000
_STEPS, _MOST_STEPS = 1.2, 3000
#: Detections in a step, and number of right ones among them.
_BATCH, _RIGHT = 128, 32
#: Random stream of the batches, distinct from that of the windows.
_DRAWS = 3
#: Augmentation of crops, standard deviations: centre of the box and ground (m), rotation (rad),
#: noise (m), log-odds of the score over 3.
_MIDDLE_M, _GROUND_M, _TURN, _NOISE_M, _SURE = 0.1, 0.06, 0.15, 0.01, 0.5
#: Largest relative scaling.
_SCALE = 0.06


def second_look_trained(
    network: Detector,
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    steps: int,
    folder: Path,
    tell: Progress,
) -> SecondLook | None:
    """Train the second stage of a detector; ``None`` if there are no detections to learn from.

    Args:
        network: detector in evaluation mode, on the device of ``recipe``.
        frames: training set of the detector.
        design: design of the detector, with some classes of `crop.LOOKED_AT`.
        recipe: hyperparameters of the detector's training.
        steps: number of steps of the detector's training.
        folder: folder of the checkpoints; training resumes from them.
        tell: progress callback, with the loss.
    """
    windows = round(min(_WINDOWS * steps, _MOST_WINDOWS))
    if not windows:
        return None
    file = folder / "proposals.npz"
    if not file.is_file():
        found = proposals_of(network, frames, design, recipe, windows, between(tell, 0.0, 0.7))
        if found is None:
            return None
        _write(file, found)
    torch.manual_seed(recipe.seed)
    look: SecondLook = SecondLook(len(design.classes)).to(recipe.device)
    own = replace(recipe, steps=round(min(_STEPS * steps, _MOST_STEPS)), workers=1, mixed=False)
    task = _RightOrWrong(look, _Batches(_read(file), recipe.seed))
    optimised(look, task, own, folder / "second.safetensors", between(tell, 0.7, 1.0))
    return look


class _Batches:
    """Batches of augmented detections, right and wrong."""

    def __init__(self, proposals: Proposals, seed: int) -> None:
        self._crops, self._seed = proposals.crops, seed
        self._right = np.flatnonzero(proposals.right)
        self._wrong = np.flatnonzero(~proposals.right)

    def batch(self, step: int) -> Arrays:
        draw = np.random.default_rng([self._seed, _DRAWS, step])
        rows = np.concatenate(
            [draw.choice(self._right, _RIGHT), draw.choice(self._wrong, _BATCH - _RIGHT)]
        )
        crops = _varied(self._crops.only(rows), draw)
        found: Arrays = {one.name: getattr(crops, one.name) for one in fields(Crops)}
        return found | {"right": (np.arange(_BATCH) < _RIGHT).astype(np.float32)}


def _varied(crops: Crops, draw: np.random.Generator) -> Crops:
    """Return crops of resampled points, shifted, mirrored, rotated and scaled."""
    count, most = crops.points.shape[:2]
    some = draw.integers(0, most, (count, most, 1))
    points = np.take_along_axis(crops.points, some, axis=1).astype(np.float64)
    points[..., 1] *= draw.choice([-1.0, 1.0], (count, 1))
    points += draw.normal(0.0, (_MIDDLE_M, _MIDDLE_M, _GROUND_M), (count, 1, 3))
    points *= draw.uniform(1 - _SCALE, 1 + _SCALE, (count, 1, 1))
    points += draw.normal(0.0, _NOISE_M, points.shape)
    turn = draw.normal(0.0, _TURN, (count, 1))
    x, y = points[..., 0].copy(), points[..., 1].copy()
    points[..., 0] = np.cos(turn) * x - np.sin(turn) * y
    points[..., 1] = np.sin(turn) * x + np.cos(turn) * y
    told = crops.told.copy()
    told[:, 2] += draw.normal(0.0, _SURE, count)
    return Crops(points.astype(np.float32), told, crops.number)


class _RightOrWrong:
    """Task of classifying detections as right or wrong."""

    def __init__(self, look: SecondLook, source: _Batches) -> None:
        self._look, self.source = look, source

    def loss(self, batch: Mapping[str, Tensor]) -> Tensor:
        said = self._look(batch["points"], batch["told"], batch["number"])
        return functional.binary_cross_entropy_with_logits(said, batch["right"])


def _write(file: Path, proposals: Proposals) -> None:
    crops = proposals.crops
    passing = file.with_suffix(".new")
    with passing.open("wb") as out:
        np.savez(out, points=crops.points, told=crops.told, number=crops.number,
                 right=proposals.right)  # fmt: skip
    passing.replace(file)


def _read(file: Path) -> Proposals:
    with np.load(file) as arrays:
        crops = Crops(arrays["points"], arrays["told"], arrays["number"])
        return Proposals(crops, arrays["right"])
