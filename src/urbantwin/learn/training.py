"""Training, as its algorithm: samples, loss, step; the same weights after an interruption.

AdamW (Loshchilov and Hutter 2019) with a rate that rises and falls once (Smith and Topin 2018,
"Super-Convergence"). Every random number comes from the seed, the step and the sample's number in
it, so it does not matter how often a training was interrupted, nor how many workers made samples.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
from torch import Tensor

from urbantwin.interruption import deferred
from urbantwin.learn.grid import Grid
from urbantwin.learn.labelled_frames import LabelledFrames
from urbantwin.learn.loss import detection_loss, on_device
from urbantwin.learn.model import Design, new_network
from urbantwin.learn.network import Detector
from urbantwin.learn.pillars import Pillars, stacked
from urbantwin.learn.sample import Sample, Varied, sample_of
from urbantwin.progress import Progress

__all__ = ["Recipe", "inputs_of", "trained"]

#: Largest learning rate, its share at the start and at the end, and when it is reached.
_RATE, _START, _END, _RISES = 4e-3, 0.1, 1e-3, 0.3
_DECAY, _LARGEST_GRADIENT = 0.01, 10.0
#: Samples that tell how many objects of a class one has on average.
_TRIED = 48
#: Steps by which the speed of this machine is told; of the first one code is still compiled.
_TIMED = 12
#: What random numbers are for: samples of steps, and those that tell how many objects are usual.
_SAMPLES, _USUAL = 0, 1


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


def inputs_of(pillars: Pillars, cells: int, device: str) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return what `Detector.forward` takes for the pillars of grids of ``cells`` each way."""
    features, points, cell = (
        torch.from_numpy(one).to(device) for one in (pillars.features, pillars.points, pillars.cell)
    )
    return features, points, cell, torch.zeros((pillars.grids, 0, cells, cells), device=device)


def trained(
    frames: LabelledFrames,
    design: Design,
    recipe: Recipe,
    state: Path,
    tell: Progress,
) -> tuple[Detector, int, float]:
    """Return a trained network, the number of steps, and the mean loss of the last tenth of them.

    Args:
        frames: to learn from.
        design: of the network.
        recipe: how; ``steps`` or ``minutes`` is given.
        state: a file that keeps the state: where it is, training goes on from it.
        tell: called with the share that is done and the loss.
    """
    torch.manual_seed(recipe.seed)
    network = new_network(design).to(recipe.device).train()
    names, parameters = zip(*network.named_parameters(), strict=True)
    optimiser = torch.optim.AdamW(parameters, lr=_RATE, weight_decay=_DECAY)
    step, steps, losses = _restored(state, network, names, optimiser, recipe)
    grid = Grid.around(0.0, 0.0, recipe.window_m / 2, design.cell_m)
    heads = design.heads
    make = _maker(frames, design, recipe)
    tried = [make(_USUAL, k, 0) for k in range(_TRIED)]
    usual = np.mean([[one.objects for one in sample.targets] for sample in tried], axis=0)
    scaler = torch.amp.GradScaler(enabled=recipe.device.startswith("cuda"))
    began, kept = time.monotonic(), time.monotonic()
    with ThreadPoolExecutor(recipe.workers) as pool:

        def asked(number: int) -> list[Callable[[], Sample]]:
            return [pool.submit(make, _SAMPLES, number, k).result for k in range(recipe.batch)]

        coming = asked(step)
        first = step
        while step < (steps or step + 1):
            samples = [ready() for ready in coming]
            coming = asked(step + 1) if step + 1 != steps else []
            rate = _rate(step, steps)
            for group in optimiser.param_groups:
                group["lr"] = rate
            given = inputs_of(stacked([one.pillars for one in samples], grid.cells), grid.cells,
                              recipe.device)  # fmt: skip
            wanted = on_device([one.targets for one in samples], recipe.device)
            with torch.autocast(recipe.device.split(":")[0], enabled=scaler.is_enabled()):
                said = network(*given)
            loss = detection_loss(said, wanted, heads, usual.tolist()).sum()
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
    last = losses[-max(1, len(losses) // 10) :]
    return network.eval(), step, float(np.mean(last))


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


def _maker(
    frames: LabelledFrames, design: Design, recipe: Recipe
) -> Callable[[int, int, int], Sample]:
    """Return what makes a sample from what it is for, the step and its number in it."""
    bank, heads = frames.bank, design.heads

    def make(use: int, step: int, slot: int) -> Sample:
        draw = np.random.default_rng([recipe.seed, use, step, slot])
        number = int(draw.integers(len(frames)))
        return sample_of(
            frames.frame(number),
            recipe.window_m,
            design.cell_m,
            heads,
            draw,
            bank=bank,
            rig=frames.rigs[number],
            varied=recipe.varied,
        )

    return make


def _keep(
    state: Path,
    network: Detector,
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
    network: Detector,
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
