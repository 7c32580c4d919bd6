"""A detector and its second look, trained one after the other."""

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

#: Of a training of some minutes this share is the second look's.
_LOOK_SHARE = 0.26


@dataclass(frozen=True, eq=False)
class Stages:
    """What was trained.

    Attributes:
        network: the detector.
        second_look: at what it finds, if there is one.
        steps: of the detector.
        loss: the mean of the last tenth of them.
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
    """Return a trained detector with its second look.

    Args:
        frames: to learn from.
        design: of the network.
        recipe: how; ``minutes`` are those of both.
        folder: keeps the state: training goes on from it.
        tell: called with the share that is done and the loss.
        start: weights of the detector to begin with, by name; the others are drawn.
        second_look: whether there is to be one; there is none of a detector that tells neither
            people nor two-wheelers, or finds none.
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
