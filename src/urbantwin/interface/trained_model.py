"""Detectors that learn from datasets."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from urbantwin.errors import InputError
from urbantwin.interface.parts import chosen_frames
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

__all__ = ["TrainedModel", "pretrain", "train"]

#: What a model may tell.
_HEADS = ("boxes", "points")
#: A semantic class with fewer points is not learned.
_FEWEST_POINTS = 200


@dataclass(frozen=True, eq=False, repr=False)
class TrainedModel:
    """A model in a folder; it stands for its folder: ``ut.detect(model, frames)``.

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
        return f"a model, {self.trained['steps']} steps ({self.folder})"

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
    heads: Sequence[str] | None = None,
    start: AnyPath | None = None,
    in_order: bool = False,
    second_look: bool = True,
    part: str = "train",
    seed: int = 0,
    workers: int = 1,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> TrainedModel:
    """Train a detector on labelled frames; interrupted, the same call goes on.

    Args:
        datasets: of ours, documents of `split`, or any labelled recording that is read.
        out: the folder to write; ``model`` beside the first dataset when not given.
        steps: so many; when neither is given, ten minutes.
        minutes: as many steps as this machine does in so long, reading left out.
        classes: that it tells apart; all that detectors know when not given.
        reach: how far it looks from the middle of the sensors along x and y, metres.
        cell: edge of its pillars, metres.
        batch: windows of frames in a step.
        width: multiple of the channels of the network for two processors.
        intensity: tell it of intensities (0..1): those of other sensors may mean something else.
        without: how samples are not varied: ``placed``, ``beams``, ``objects``, ``sizes``,
            ``clutter``.
        heads: what it tells: ``boxes``, and ``points``: the semantic class of every point; boxes
            when not given.
        start: a model of the same cells and channels: its weights are the first, where it has
            them (a model of `pretrain` has no heads).
        in_order: learn from the datasets one after the other, as of a curriculum; needs ``steps``.
        second_look: learn to look again at the points of people and two-wheelers that are found,
            which takes about a quarter of the time.
        part: of each dataset that is split, the frames to learn from: ``train``, ``val``, ``test``
            or ``all``.
        seed: of the weights at the start and of all samples.
        workers: processes that read frames and make samples; the weights are the same.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, or a dataset or ``start`` cannot be used.
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
        write_model,
    )
    from urbantwin.learn.model import KIND, first_weights
    from urbantwin.learn.onnx_file import write_onnx
    from urbantwin.learn.sample import Varied
    from urbantwin.learn.two_stages import stages_trained
    from urbantwin.progress import between

    given = _several(datasets)
    seen = chosen_frames(given, part)
    sources = list(seen.folders)
    target = beside(given[0], KIND) if out is None else Path(out)
    kinds = [one.name for one in fields(Varied)]
    _check_names("class", classes or (), DETECTED_CLASSES)
    _check_names("without", without, kinds)
    heads = heads or ("boxes",)
    _check_names("head", heads, _HEADS)
    _check_order(in_order, steps)
    varied = Varied(**{name: name not in without for name in kinds})
    chosen = tuple(one for one in DETECTED_CLASSES if classes is None or one in classes)
    minutes = 10.0 if steps is None and minutes is None else minutes
    design = Design(chosen if "boxes" in heads else (), reach, cell, intensity, width)
    first = None if start is None else first_weights(Path(start), design)
    window = min(Recipe.window_m, 2 * reach)
    recipe = Recipe(steps, minutes, batch, window, seed, device, workers, varied=varied,
                    in_order=in_order)  # fmt: skip
    check_folder(target, kind=KIND, inputs=[*given, *sources])
    with shown_stage("train", progress, brief=True) as tell:
        digests = [digest_of(one) for one in sources]
        asked: dict[str, Any] = {
            "urbantwin": __version__,
            "datasets": digests,
            "frames": seen.digests(),
            "design": asdict(design),
        }
        asked |= {"steps": steps, "minutes": minutes, "batch": batch, "seed": seed}
        asked |= {"varied": asdict(varied), "heads": sorted(heads), "in_order": in_order}
        asked |= {"start": None if first is None else first.sha256, "second_look": second_look}
        key = recipe_key(asked | {"device": device})
        with replaced_folder(target, kind=KIND, inputs=sources, key=key) as scratch:
            work = scratch / "training"
            known = () if first is None else first.classes
            frames = labelled_frames(
                sources, design, work, between(tell, 0.0, 0.1), known=known, names=seen.names,
                workers=workers,
            )  # fmt: skip
            if "points" in heads:
                design = replace(design, points=_known_points(frames.points, sources))
            stages = stages_trained(
                frames, design, recipe, work, between(tell, 0.1, 1.0),
                None if first is None else first.weights,
                second_look=second_look,
            )  # fmt: skip
            told = {
                "urbantwin": __version__,
                "datasets": [
                    {"name": one.name, "sha256": digest}
                    for one, digest in zip(sources, digests, strict=True)
                ],
                "part": part,
                "frames": len(frames),
                "objects": dict(zip(design.classes, frames.objects, strict=True)),
                "points": {name: frames.points[name] for name in design.points},
                "start": None if first is None else first.sha256,
                "in_order": in_order,
                "second_look": stages.second_look is not None,
                "steps": stages.steps,
                "batch": batch,
                "seed": seed,
                "without": sorted(set(without)),
                "loss": round(stages.loss, 4),
            }
            made = Model(design, stages.network, told, stages.second_look)
            write_model(scratch, made)
            write_onnx(scratch, made)
            shutil.rmtree(work)
    return TrainedModel(target, told)


def _several(given: Sequence[AnyPath] | AnyPath) -> list[Path]:
    """Return the folders that one or several are.

    Raises:
        InputError: there is none.
    """
    sources = [Path(one) for one in ([given] if isinstance(given, str | os.PathLike) else given)]
    if not sources:
        raise InputError("no dataset is given", expected="one or more")
    return sources


def _check_order(in_order: bool, steps: int | None) -> None:
    """Refuse datasets in order without a number of steps.

    Raises:
        InputError: they are.
    """
    if in_order and steps is None:
        raise InputError(
            "datasets in order need a number of steps", place="--in-order", expected="--steps N"
        )


def _check_names(option: str, names: Sequence[str], known: Sequence[str]) -> None:
    """Refuse names that an option does not know.

    Raises:
        InputError: there is one.
    """
    for name in names:
        if name not in known:
            raise InputError(
                f"unknown {option} {name!r:.40}", place=f"--{option}", expected=", ".join(known)
            )


def _known_points(points: Mapping[str, int], sources: Sequence[Path]) -> tuple[str, ...]:
    """Return the semantic classes that can be learned.

    Raises:
        InputError: there are none.
    """
    found = tuple(name for name, count in points.items() if count >= _FEWEST_POINTS)
    if len(found) < 2:
        raise InputError(
            "no two semantic classes of points are labelled",
            file=", ".join(map(str, sources)),
            expected=f"{_FEWEST_POINTS} points of each, as in datasets of `record`",
        )
    return found


def pretrain(  # noqa: PLR0913 - the options of the command
    frames: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    task: str = "masked",
    steps: int | None = None,
    minutes: float | None = None,
    reach: float = 60.0,
    cell: float = 0.4,
    batch: int = 4,
    width: float = 1.0,
    intensity: bool = False,
    part: str = "train",
    seed: int = 0,
    workers: int = 1,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> TrainedModel:
    """Train a network without labels, to begin a detector with; interrupted, the call goes on.

    It learns to say where anything is, and how high it reaches: in blocks of pillars that are
    hidden (``masked``), or in the sweep that comes next (``next-sweep``).

    Args:
        frames: recordings, real or simulated; no label of them is looked at.
        out: the folder to write; ``pretrained`` beside the first recording when not given.
        task: ``masked``, or ``next-sweep`` of sweeps one after the other, whose sensors stand or
            whose poses are told.
        steps: so many; when neither is given, ten minutes.
        minutes: as many steps as this machine does in so long, reading left out.
        reach: as of `train`.
        cell: as of `train`: edge of its pillars, metres.
        batch: windows of frames in a step.
        width: as of `train`.
        intensity: tell it of intensities.
        part: as of `train`.
        seed: of the weights at the start and of all samples.
        workers: processes that read frames and make samples; the weights are the same.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, there is no such task, a recording cannot be used, or
            the next sweep is asked for and no frame is followed by one of the same place.
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin import __version__
    from urbantwin.artefact import check_folder, replaced_folder
    from urbantwin.dataset.manifest import recipe_key
    from urbantwin.learn import (
        Design,
        Model,
        Recipe,
        digest_of,
        pretrained,
        unlabelled_frames,
        write_model,
    )
    from urbantwin.learn.model import KIND
    from urbantwin.learn.pretraining import TASKS
    from urbantwin.progress import between

    _check_names("task", [task], TASKS)
    given = _several(frames)
    chosen = chosen_frames(given, part)
    sources = list(chosen.folders)
    target = beside(given[0], "pretrained") if out is None else Path(out)
    if steps is None and minutes is None:
        minutes = 10.0
    design = Design((), reach, cell, intensity, width)
    window = min(Recipe.window_m, 2 * reach)
    recipe = Recipe(steps, minutes, batch, window, seed, device, workers)
    check_folder(target, kind=KIND, inputs=[*given, *sources])
    with shown_stage("pretrain", progress, brief=True) as tell:
        digests = [digest_of(one) for one in sources]
        asked: dict[str, Any] = {"urbantwin": __version__, "frames": digests}
        asked["part"] = chosen.digests()
        asked |= {
            "task": task,
            "design": asdict(design),
            "steps": steps,
            "minutes": minutes,
            "batch": batch,
            "seed": seed,
        }
        key = recipe_key({"pretrain": asked, "device": device})
        with replaced_folder(target, kind=KIND, inputs=sources, key=key) as scratch:
            work = scratch / "training"
            seen = unlabelled_frames(
                sources,
                design,
                work,
                between(tell, 0.0, 0.1),
                names=chosen.names,
                following=task == "next-sweep",
                workers=workers,
            )
            state = work / "state.safetensors"
            network, done, loss = pretrained(
                seen, design, recipe, state, between(tell, 0.1, 1.0), task
            )
            told = {
                "urbantwin": __version__,
                "without_labels": True,
                "task": task,
                "datasets": [
                    {"name": one.name, "sha256": digest}
                    for one, digest in zip(sources, digests, strict=True)
                ],
                "part": part,
                "frames": len(seen),
                "steps": done,
                "batch": batch,
                "seed": seed,
                "loss": round(loss, 4),
            }
            write_model(scratch, Model(design, network, told))
            shutil.rmtree(work)
    return TrainedModel(target, told)
