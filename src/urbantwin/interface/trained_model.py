"""Detectors that learn from datasets."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

__all__ = ["TrainedModel", "train"]


@dataclass(frozen=True, eq=False, repr=False)
class TrainedModel:
    """A detector in a folder; it stands for its folder: ``ut.detect(model, frames)``.

    Attributes:
        folder: where it was written.
        trained: on what, for how long, by what.
    """

    folder: Path
    trained: dict[str, Any]

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return how much it learned from, and the folder."""
        return f"a detector, {self.trained['steps']} steps ({self.folder})"

    def summary(self) -> Summary:
        """Return what it learned from in a few values."""
        return Summary(path=str(self.folder), **self.trained)


def train(  # noqa: PLR0913 - the options of the command
    datasets: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    steps: int | None = None,
    minutes: float | None = None,
    classes: Sequence[str] | None = None,
    reach: float = 60.0,
    cell: float = 0.4,
    batch: int = 4,
    width: float = 1.0,
    intensity: bool = False,
    without: Sequence[str] = (),
    clutter: bool = False,
    seed: int = 0,
    workers: int = 1,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> TrainedModel:
    """Train a detector on labelled frames; interrupted, the same call goes on.

    Args:
        datasets: of ours, or any labelled recording that is read.
        out: the folder to write; ``model`` beside the first dataset when not given.
        steps: so many; when neither is given, ten minutes.
        minutes: as many steps as this machine does in so long, reading left out.
        classes: that it tells apart; all that detectors know when not given.
        reach: how far it looks from the middle of the sensors along x and y, metres.
        cell: edge of its pillars, metres.
        batch: windows of frames in a step.
        width: multiple of the channels of the network for two processors.
        intensity: tell it of intensities (0..1): those of other sensors may mean something else.
        without: how samples are not varied: ``placed``, ``beams``, ``objects``.
        clutter: set bushes, hedges, walls and bins without a label into samples.
        seed: of the weights at the start and of all samples.
        workers: threads that make samples; the weights are the same.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, or a dataset cannot be used.
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin import __version__
    from urbantwin.artefact import check_folder, replaced_folder
    from urbantwin.dataset.manifest import recipe_key
    from urbantwin.detections import DETECTED_CLASSES
    from urbantwin.learn import (
        Design,
        Model,
        Recipe,
        digest_of,
        labelled_frames,
        trained,
        write_model,
    )
    from urbantwin.learn.model import KIND
    from urbantwin.learn.onnx_file import write_onnx
    from urbantwin.learn.sample import Varied
    from urbantwin.progress import between

    several = [datasets] if isinstance(datasets, str | os.PathLike) else datasets
    sources = [Path(one) for one in several]
    if not sources:
        raise InputError("no dataset is given", expected="one or more")
    target = beside(sources[0], KIND) if out is None else Path(out)
    for name in classes or ():
        if name not in DETECTED_CLASSES:
            known = ", ".join(DETECTED_CLASSES)
            raise InputError(f"unknown class {name!r:.40}", place="--class", expected=known)
    kinds = [one.name for one in fields(Varied) if one.default]
    for name in without:
        if name not in kinds:
            raise InputError(f"no kind {name!r:.40}", place="--without", expected=", ".join(kinds))
    varied = Varied(**{name: name not in without for name in kinds}, clutter=clutter)
    chosen = tuple(one for one in DETECTED_CLASSES if classes is None or one in classes)
    if steps is None and minutes is None:
        minutes = 10.0
    design = Design(chosen, reach, cell, intensity, width)
    window = min(Recipe.window_m, 2 * reach)
    recipe = Recipe(steps, minutes, batch, window, seed, device, workers, varied=varied)
    check_folder(target, kind=KIND, inputs=sources)
    with shown_stage("train", progress, brief=True) as tell:
        digests = [digest_of(one) for one in sources]
        asked: dict[str, Any] = {
            "urbantwin": __version__,
            "datasets": digests,
            "design": asdict(design),
        }
        asked |= {"steps": steps, "minutes": minutes, "batch": batch, "seed": seed}
        asked["varied"] = asdict(varied)
        key = recipe_key(asked | {"device": device})
        with replaced_folder(target, kind=KIND, inputs=sources, key=key) as scratch:
            work = scratch / "training"
            frames = labelled_frames(sources, design, work, between(tell, 0.0, 0.1))
            network, done, loss = trained(
                frames, design, recipe, work / "state.safetensors", between(tell, 0.1, 1.0)
            )
            told = {
                "urbantwin": __version__,
                "datasets": [
                    {"name": one.name, "sha256": digest}
                    for one, digest in zip(sources, digests, strict=True)
                ],
                "frames": len(frames),
                "objects": dict(zip(design.classes, frames.objects, strict=True)),
                "steps": done,
                "batch": batch,
                "seed": seed,
                "without": sorted(set(without)),
                "clutter": clutter,
                "loss": round(loss, 4),
            }
            made = Model(design, network, told)
            write_model(scratch, made)
            write_onnx(scratch / "model.onnx", made)
            shutil.rmtree(work)
    return TrainedModel(target, told)
