"""The training loop; a resumed training gives the same weights as an uninterrupted one.

AdamW (Loshchilov and Hutter 2019) with a one-cycle learning rate (Smith and Topin 2018,
"Super-Convergence"). All randomness derives from the seed, the step and the index of the sample in
the batch, so interruptions and the number of workers change nothing. A `Task` gives the batches
and the loss: `from_labels` or `pretraining`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import safetensors.torch
import torch
from torch import Tensor, nn

from urbantwin.interruption import deferred
from urbantwin.learn.batches import Source, batches
from urbantwin.learn.sample import Varied
from urbantwin.learn.torch_device import copied, mixed_precision, repeatable
from urbantwin.progress import Progress

__all__ = ["Recipe", "Task", "optimised"]

#: Largest learning rate, its share at the start and at the end, share of steps until it is reached.
_RATE, _START, _END, _RISES = 4e-3, 0.1, 1e-3, 0.3
_DECAY, _LARGEST_GRADIENT = 0.01, 10.0
#: Number of steps per worker that are timed for ``minutes``: code is compiled in the first ones,
#: and each worker has some batches ready.
_TIMED = 12


class Task(Protocol):
    """Batches and loss of a training."""

    @property
    def source(self) -> Source:
        """Maker of the batches."""

    def loss(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Return the loss of a batch, whose tensors are on the network's device."""


@dataclass(frozen=True)
class Recipe:
    """Hyperparameters of a training.

    Attributes:
        steps: number of steps; ``None``: as many as fit into ``minutes``.
        minutes: duration, without the reading of datasets.
        batch: samples in a step.
        window_m: edge of the square window of a sample, metres.
        seed: random seed.
        device: torch device.
        workers: number of processes that make samples; with 1, a thread of this process.
        kept_every_s: interval of checkpoints, seconds.
        varied: switches of the augmentation.
        in_order: train on one dataset after the other, with equal numbers of steps (curriculum),
            in place of all together; needs ``steps``.
        mixed: use bfloat16 (or float16) on a GPU where single precision is not needed.
    """

    steps: int | None = None
    minutes: float | None = None
    batch: int = 4
    window_m: float = 51.2
    seed: int = 0
    device: str = "cpu"
    workers: int = 1
    kept_every_s: float = 20.0
    varied: Varied = field(default_factory=Varied)
    in_order: bool = False
    mixed: bool = True


def optimised(
    network: nn.Module, task: Task, recipe: Recipe, state: Path, tell: Progress
) -> tuple[int, float]:
    """Train a network; return the number of steps, and the mean loss of the last tenth of them.

    Args:
        network: network on its device; left in evaluation mode.
        task: batches and loss.
        recipe: hyperparameters; ``steps`` or ``minutes`` is set.
        state: checkpoint file; training resumes from it if it exists.
        tell: progress callback, with the loss.

    Raises:
        StageError: a worker process was killed.
    """
    network.train()
    names, parameters = zip(*network.named_parameters(), strict=True)
    optimiser = torch.optim.AdamW(parameters, lr=_RATE, weight_decay=_DECAY)
    step, steps, losses = _restored(state, network, names, optimiser, recipe)
    kind = mixed_precision(recipe.device) if recipe.mixed else None
    # float16 needs scaled gradients because of its small range, bfloat16 does not.
    scaler = torch.amp.GradScaler(enabled=kind is torch.float16)
    first, began, kept = step, time.monotonic(), time.monotonic()
    timed = _TIMED * recipe.workers
    pending: Tensor | None = None
    coming = batches(task.source, step, steps, recipe.workers)
    with closing(coming), repeatable(recipe.device):
        for batch in copied(coming, recipe.device):
            rate = _rate(step, steps)
            for group in optimiser.param_groups:
                group["lr"] = rate
            with torch.autocast(torch.device(recipe.device).type, kind, enabled=kind is not None):
                loss = task.loss(batch)
            optimiser.zero_grad()
            torch.autograd.backward(scaler.scale(loss))
            scaler.unscale_(optimiser)
            torch.nn.utils.clip_grad_norm_(parameters, _LARGEST_GRADIENT)
            scaler.step(optimiser)
            scaler.update()
            if pending is not None:
                losses.append(float(pending))  # one step later: the host does not wait for the GPU
            pending = loss.detach()
            step += 1
            if steps is None and step - first == timed // 3:
                began = time.monotonic()  # code is compiled by now
            if steps is None and step - first == timed:
                each = (time.monotonic() - began) / (timed - timed // 3)
                steps = max(timed + 1, round(60 * (recipe.minutes or 1.0) / each))
            if losses:
                recent = np.mean(losses[-50:])
                tell(step / (steps or 1e9), f"step {step} of {steps or '?'}, loss {recent:.2f}")
            if step == steps or time.monotonic() - kept > recipe.kept_every_s:
                losses, pending = [*losses, float(pending)], None
            if step == steps:
                break
            if pending is None:
                _keep(state, network, names, optimiser, step, steps, losses)
                kept = time.monotonic()
    network.eval()
    return step, float(np.mean(losses[-max(1, len(losses) // 10) :]))


def _rate(step: int, steps: int | None) -> float:
    """Return the learning rate: rising, then falling along a cosine."""
    if steps is None:
        return _RATE * _START
    top = max(1.0, _RISES * steps)
    if step < top:
        low, share = _START, 0.5 - 0.5 * math.cos(math.pi * step / top)
    else:
        low, share = _END, 0.5 + 0.5 * math.cos(math.pi * (step - top) / max(1.0, steps - top))
    return _RATE * (low + (1 - low) * share)


def _keep(
    state: Path,
    network: nn.Module,
    names: tuple[str, ...],
    optimiser: torch.optim.AdamW,
    step: int,
    steps: int | None,
    losses: list[float],
) -> None:
    """Write a checkpoint: network, optimiser, step and losses."""
    kept = {f"network.{name}": one.contiguous() for name, one in network.state_dict().items()}
    for number, one in optimiser.state_dict()["state"].items():
        for key, value in one.items():
            kept[f"optimiser.{names[number]}.{key}"] = value.contiguous()
    kept["losses"] = torch.tensor(losses, dtype=torch.float64)
    passing = state.with_suffix(".new")
    with deferred():
        safetensors.torch.save_file(kept, passing, {"step": str(step), "steps": str(steps or 0)})
        passing.replace(state)


def _restored(
    state: Path,
    network: nn.Module,
    names: tuple[str, ...],
    optimiser: torch.optim.AdamW,
    recipe: Recipe,
) -> tuple[int, int | None, list[float]]:
    """Restore a checkpoint; return the step, the number of steps and the losses."""
    if not state.is_file():
        return 0, recipe.steps, []
    with safetensors.safe_open(state, "pt") as file:
        told = file.metadata()
        kept = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    network.load_state_dict(
        {name.removeprefix("network."): one for name, one in kept.items() if name[:2] == "ne"}
    )
    whole = optimiser.state_dict()
    keys = ("step", "exp_avg", "exp_avg_sq")
    whole["state"] = {
        number: {key: kept[f"optimiser.{name}.{key}"] for key in keys}
        for number, name in enumerate(names)
    }
    optimiser.load_state_dict(whole)
    return int(told["step"]), int(told["steps"]) or None, kept["losses"].tolist()
