"""Detectors that learn from datasets, and what they detect."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

if TYPE_CHECKING:
    from urbantwin.detections import Detections

__all__ = ["DetectedObjects", "TrainedModel", "detect", "train"]


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


@dataclass(frozen=True, eq=False, repr=False)
class DetectedObjects:
    """Detections in a folder; it stands for its folder: ``ut.evaluate(found, data)``.

    Attributes:
        folder: where it was written.
        found: the boxes.
    """

    folder: Path
    found: Detections

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return how many boxes there are, and the folder."""
        return f"{len(self.found)} detections ({self.folder})"

    def summary(self) -> Summary:
        """Return what was detected in a few values; likely ones are those above one half."""
        names = self.found.class_names
        likely = self.found.only(self.found.score > 0.5).class_names
        return Summary(
            path=str(self.folder),
            frames=len(self.found.frames),
            boxes={name: names.count(name) for name in sorted(set(names))},
            likely={name: likely.count(name) for name in sorted(set(likely))},
        )


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
        seed: of the weights at the start and of all samples.
        workers: threads that make samples; the weights are the same.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, or a dataset cannot be used.
    """
    _check_installed(device)
    from urbantwin import __version__
    from urbantwin.artefact import check_folder, replaced_folder
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
    from urbantwin.progress import between

    several = [datasets] if isinstance(datasets, str | os.PathLike) else datasets
    sources = [Path(one) for one in several]
    if not sources:
        raise InputError("no dataset is given", expected="one or more")
    target = beside(sources[0], KIND) if out is None else Path(out)
    for name in classes or ():
        if name not in DETECTED_CLASSES:
            known = ", ".join(DETECTED_CLASSES)
            raise InputError(f"unknown class {name!r:.40}", place="--classes", expected=known)
    chosen = tuple(one for one in DETECTED_CLASSES if classes is None or one in classes)
    if steps is None and minutes is None:
        minutes = 10.0
    design = Design(chosen, reach, cell, intensity, width)
    window = min(Recipe.window_m, 2 * reach)
    recipe = Recipe(steps, minutes, batch, window, seed, device, workers)
    check_folder(target, kind=KIND, inputs=sources)
    with shown_stage("train", progress, brief=True) as tell:
        digests = [digest_of(one) for one in sources]
        recipe_text = repr((__version__, digests, design, steps, minutes, batch, seed, device))
        key = hashlib.sha256(recipe_text.encode()).hexdigest()[:16]
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
                "loss": round(loss, 4),
            }
            made = Model(design, network, told)
            write_model(scratch, made)
            write_onnx(scratch / "model.onnx", made)
            _remove(work)
    return TrainedModel(target, told)


def detect(
    model: AnyPath,
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    least: float = 0.05,
    layout: str | None = None,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> DetectedObjects:
    """Detect road users in the frames of a recording.

    Args:
        model: a folder that `train` wrote.
        frames: a dataset of ours or any recording that is read; no label of it is looked at.
        out: the folder to write; ``detections`` beside the frames when not given.
        least: boxes with a lower score are left out.
        layout: how the frames lie; found out when not given.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, or the model or the frames cannot be used.
    """
    _check_installed(device)
    from urbantwin.detections import check_detections_folder, write_detections
    from urbantwin.fidelity.readers import open_recording
    from urbantwin.learn import detected, read_model

    source, real = Path(model), Path(frames)
    target = beside(real, "detections") if out is None else Path(out)
    inputs = [source, real]
    check_detections_folder(target, inputs)
    with shown_stage("detect", progress, brief=True) as tell:
        detector = read_model(source, device)
        recording = open_recording(real, layout)
        count = len(recording) if hasattr(recording, "__len__") else None
        found = detected(
            detector, recording, file=real, count=count, device=device, least=least, tell=tell
        )
        made_by = {"urbantwin": "detect", "least": least, "model": dict(detector.trained)}
        write_detections(target, found, made_by, inputs)
    return DetectedObjects(target, found)


def _remove(folder: Path) -> None:
    import shutil

    shutil.rmtree(folder)


def _check_installed(device: str) -> None:
    """Refuse in one line what cannot be done without torch, or without a device."""
    try:
        import onnx  # noqa: F401
        import safetensors.torch  # noqa: F401
        import torch
    except ImportError as error:
        raise InputError(
            f"training and detecting need PyTorch ({error})",
            expected="pip install 'urbantwin[learn]' (README says how without CUDA)",
        ) from None
    kind = device.split(":", maxsplit=1)[0]
    if kind not in {"cpu", "cuda"} or (kind == "cuda" and not torch.cuda.is_available()):
        raise InputError(
            f"no device {device!r:.40}", place="--device", expected="cpu, or cuda where it is"
        )
