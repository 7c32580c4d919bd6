"""Training, as its algorithm: samples, loss, step; the same weights after an interruption.

AdamW (Loshchilov and Hutter 2019) with a rate that rises and falls once (Smith and Topin 2018,
"Super-Convergence"). Every random number comes from the seed, the step and the sample's number in
it, so it does not matter how often a training was interrupted, nor how many workers made samples.
What is learned is a `Task`: from labels (`from_labels`), or from what was hidden (`pretraining`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import safetensors.torch
import torch
from torch import Tensor, nn

from urbantwin.interruption import deferred
from urbantwin.learn.sample import Varied
from urbantwin.progress import Progress

__all__ = ["Recipe", "Task", "optimised"]

#: Largest learning rate, its share at the start and at the end, and when it is reached.
_RATE, _START, _END, _RISES = 4e-3, 0.1, 1e-3, 0.3
_DECAY, _LARGEST_GRADIENT = 0.01, 10.0
#: Steps by which the speed of this machine is told; of the first one code is still compiled.
_TIMED = 12

_Sample = TypeVar("_Sample")


class Task(Protocol[_Sample]):
    """What is learned."""

    def sample(self, step: int, slot: int) -> _Sample:
        """Return a sample of a step; all random numbers come from the two and a seed."""

    def loss(self, samples: Sequence[_Sample]) -> Tensor:
        """Return how wrong the network is on a batch."""


@dataclass(frozen=True)
class Recipe:
    """How to train.

    Attributes:
        steps: so many; or none, and ``minutes`` of this machine.
        minutes: as long as that takes, reading of datasets left out.
        batch: samples of a step.
        window_m: edge of the square window that a sample is.
        seed: of all random numbers.
        device: of torch.
        workers: threads that make samples.
        kept_every_s: the state is kept so often, seconds.
        varied: how samples are varied.
        in_order: the datasets after each other, equally long, in place of all at once; needs
            ``steps``.
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


def optimised(
    network: nn.Module, task: Task[_Sample], recipe: Recipe, state: Path, tell: Progress
) -> tuple[int, float]:
    """Train a network; return the number of steps, and the mean loss of the last tenth of them.

    Args:
        network: on its device; left in evaluation mode.
        task: what is learned.
        recipe: how; ``steps`` or ``minutes`` is given.
        state: a file that keeps the state: where it is, training goes on from it.
        tell: called with the share that is done and the loss.
    """
    network.train()
    names, parameters = zip(*network.named_parameters(), strict=True)
    optimiser = torch.optim.AdamW(parameters, lr=_RATE, weight_decay=_DECAY)
    step, steps, losses = _restored(state, network, names, optimiser, recipe)
    scaler = torch.amp.GradScaler(enabled=recipe.device.startswith("cuda"))
    began, kept = time.monotonic(), time.monotonic()
    with ThreadPoolExecutor(recipe.workers) as pool:

        def asked(number: int) -> list[Callable[[], _Sample]]:
            return [pool.submit(task.sample, number, k).result for k in range(recipe.batch)]

        coming = asked(step)
        first = step
        while step < (steps or step + 1):
            samples = [ready() for ready in coming]
            coming = asked(step + 1) if step + 1 != steps else []
            rate = _rate(step, steps)
            for group in optimiser.param_groups:
                group["lr"] = rate
            with torch.autocast(recipe.device.split(":")[0], enabled=scaler.is_enabled()):
                loss = task.loss(samples)
            optimiser.zero_grad()
            torch.autograd.backward(scaler.scale(loss))
            scaler.unscale_(optimiser)
            torch.nn.utils.clip_grad_norm_(parameters, _LARGEST_GRADIENT)
            scaler.step(optimiser)
            scaler.update()
            losses.append(float(loss.detach()))
            step += 1
            if steps is None and step - first == _TIMED // 3:
                began = time.monotonic()  # what was compiled until here is not compiled again
            if steps is None and step - first == _TIMED:
                each = (time.monotonic() - began) / (_TIMED - _TIMED // 3)
                steps = max(_TIMED + 1, round(60 * (recipe.minutes or 1.0) / each))
            recent = np.mean(losses[-50:])
            tell(step / (steps or 1e9), f"step {step} of {steps or '?'}, loss {recent:.2f}")
            if time.monotonic() - kept > recipe.kept_every_s:
                _keep(state, network, names, optimiser, step, steps, losses)
                kept = time.monotonic()
    network.eval()
    return step, float(np.mean(losses[-max(1, len(losses) // 10) :]))


def _rate(step: int, steps: int | None) -> float:
    """Return the learning rate: up along a cosine, and down along another."""
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
    """Keep all that training needs to go on as if nothing had happened."""
    kept = {f"network.{name}": one.contiguous() for name, one in network.state_dict().items()}
    for number, one in optimiser.state_dict()["state"].items():
        kept |= {f"optimiser.{names[number]}.{key}": value for key, value in one.items()}
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
    """Set network and optimiser to what was kept; return the step, how many there are, losses."""
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
