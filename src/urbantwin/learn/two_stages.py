"""Training of a detector, then of its second stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from torch import Tensor

from urbantwin.learn.from_labels import trained
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.model import Design
from urbantwin.learn.network import Detector
from urbantwin.learn.second_look.crop import LOOKED_AT
from urbantwin.learn.second_look.network import SecondLook
from urbantwin.learn.second_look.training import second_look_trained
from urbantwin.learn.training import Recipe
from urbantwin.progress import Progress, between

__all__ = ["Stages", "stages_trained"]

#: Share of ``minutes`` for the second stage.
_LOOK_SHARE = 0.26


@dataclass(frozen=True, eq=False)
class Stages:
    """Result of a training.

    Attributes:
        network: detector.
        second_look: second stage, if any.
        steps: number of steps of the detector.
        loss: mean loss of the last tenth of them.
    """

    network: Detector
    second_look: SecondLook | None
    steps: int
    loss: float


def stages_trained(
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    folder: Path,
    tell: Progress,
    start: Mapping[str, Tensor] | None = None,
    *,
    second_look: bool = True,
) -> Stages:
    """Train a detector and its second stage.

    Args:
        frames: training set.
        design: design of the network.
        recipe: hyperparameters; ``minutes`` covers both stages.
        folder: folder of the checkpoints; training resumes from them.
        tell: progress callback, with the loss.
        start: initial weights of the detector by name; the others are random.
        second_look: train a second stage, if the detector has a class of pedestrians or
            two-wheelers and detects some.
    """
    looks = second_look and bool(set(LOOKED_AT) & set(design.classes))
    share = 1 - _LOOK_SHARE if looks else 1.0
    own = recipe
    if recipe.minutes is not None:
        own = replace(recipe, minutes=share * recipe.minutes)
    state = folder / "state.safetensors"
    network, steps, loss = trained(frames, design, own, state, between(tell, 0.0, share), start)
    look = None
    if looks:
        told = between(tell, share, 1.0)
        look = second_look_trained(network, frames, design, recipe, steps, folder, told)
    return Stages(network, look, steps, loss)
