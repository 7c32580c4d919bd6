"""Training of detectors on datasets."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Interval

from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.parts import chosen_frames
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

__all__ = ["TrainedModel", "pretrain", "train"]

#: Outputs of a model.
_HEADS = ("boxes", "points")
#: Fewest points of a semantic class that is learned.
_FEWEST_POINTS = 200


@dataclass(frozen=True, eq=False, repr=False)
class TrainedModel(Artefact):
    """A trained model; it can be passed as its folder: ``ut.model.detect(frames, model=model)``.

    Attributes:
        folder: folder of the model.
        trained: training record: datasets, steps, options and loss.
    """

    folder: Path
    trained: dict[str, Any]

    def __repr__(self) -> str:
        """Return the number of training steps and the folder."""
        return f"a model, {self.trained['steps']} steps ({self.folder})"

    def summary(self) -> Summary:
        """Return the training record."""
        return Summary(path=str(self.folder), **self.trained)


@command
def train(
    datasets: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    steps: Annotated[int | None, Ge(1)] = None,
    minutes: Annotated[float | None, Ge(0.1)] = None,
    classes: Annotated[Sequence[str] | None, "NAME"] = None,
    reach: Annotated[float, Interval(ge=10, le=300)] = 60.0,
    cell: Annotated[float, Interval(ge=0.1, le=1)] = 0.4,
    batch: Annotated[int, Interval(ge=1, le=256)] = 4,
    width: Annotated[float, Interval(ge=0.25, le=8)] = 1.0,
    intensity: bool = False,
    without: Annotated[Sequence[str], "KIND"] = (),
    heads: Annotated[Sequence[str] | None, "NAME"] = None,
    weights: Annotated[AnyPath | None, "MODEL"] = None,
    in_order: bool = False,
    second_look: bool = True,
    part: Annotated[str, "NAME"] = "train",
    seed: Annotated[int, Ge(0)] = 0,
    workers: Annotated[int, Interval(ge=1, le=64)] = 1,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> TrainedModel:
    """Train a detector on labelled frames.

    Interrupted, the same call continues.

    Args:
        datasets: datasets, documents of ``dataset split``, or any labelled recording.
        out: folder to write; ``model`` beside the first dataset if not given.
        steps: number of training steps; as many as fit into ``minutes`` if not given.
        minutes: minutes of training on this machine, reading left out; 10 if neither is given.
        classes: class to detect; all if not given.
        reach: range along x and y from the centre of the sensors, metres.
        cell: edge of a pillar, metres.
        batch: samples in a step.
        width: multiple of the channels of the small network.
        intensity: use intensities (0..1); their scale differs between sensors.
        without: augmentation to leave out: ``placed`` (turned, mirrored, scaled), ``beams``
            (fewer), ``objects`` (of other frames), ``sizes`` (of objects), ``clutter`` (bushes,
            walls, posts).
        heads: output: ``boxes``, or ``points`` for the semantic class of every point; boxes if not
            given.
        weights: model of the same cells and channels with the initial weights (a model of
            ``model pretrain`` has none for the heads).
        in_order: learn from the datasets one after the other, as in a curriculum; needs ``steps``.
        second_look: train a second stage on the points of detected pedestrians and two-wheelers; it
            takes about a quarter of the time.
        part: part of each split dataset to learn from: ``train``, ``val``, ``test`` or ``all``.
        seed: random seed of weights and samples.
        workers: number of processes that read frames and make samples; the weights are the same.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: torch is not installed, or a dataset or ``start`` cannot be used.

    Example:
        $ urbantwin model train urbantwin-demo/dataset -o model/ --minutes 10
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin import __version__
    from urbantwin.artefact import check_folder, digest_of, replaced_folder
    from urbantwin.dataset.manifest import recipe_key
    from urbantwin.detections import DETECTED_CLASSES
    from urbantwin.learn import (
        Design,
        Model,
        Recipe,
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
    first = None if weights is None else first_weights(Path(weights), design)
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
    """Return the given paths as a list.

    Raises:
        InputError: no path is given.
    """
    sources = [Path(one) for one in ([given] if isinstance(given, str | os.PathLike) else given)]
    if not sources:
        raise InputError("no dataset is given", expected="one or more")
    return sources


def _check_order(in_order: bool, steps: int | None) -> None:
    """Raise an error if datasets are to be learned in order without a number of steps.

    Raises:
        InputError: ``steps`` is missing.
    """
    if in_order and steps is None:
        raise InputError(
            "datasets in order need a number of steps", place="--in-order", expected="--steps N"
        )


def _check_names(option: str, names: Sequence[str], known: Sequence[str]) -> None:
    """Check the names given to an option.

    Raises:
        InputError: a name is unknown.
    """
    for name in names:
        if name not in known:
            raise InputError(
                f"unknown {option} {name!r:.40}", place=f"--{option}", expected=", ".join(known)
            )


def _known_points(points: Mapping[str, int], sources: Sequence[Path]) -> tuple[str, ...]:
    """Return the semantic classes with enough labelled points.

    Raises:
        InputError: fewer than two classes have enough points.
    """
    found = tuple(name for name, count in points.items() if count >= _FEWEST_POINTS)
    if len(found) < 2:
        raise InputError(
            "no two semantic classes of points are labelled",
            file=", ".join(map(str, sources)),
            expected=f"{_FEWEST_POINTS} points of each, as in datasets of `record`",
        )
    return found


@command
def pretrain(
    frames: Sequence[AnyPath] | AnyPath,
    out: AnyPath | None = None,
    *,
    task: Annotated[str, "NAME"] = "masked",
    steps: Annotated[int | None, Ge(1)] = None,
    minutes: Annotated[float | None, Ge(0.1)] = None,
    reach: Annotated[float, Interval(ge=10, le=300)] = 60.0,
    cell: Annotated[float, Interval(ge=0.1, le=1)] = 0.4,
    batch: Annotated[int, Interval(ge=1, le=256)] = 4,
    width: Annotated[float, Interval(ge=0.25, le=8)] = 1.0,
    intensity: bool = False,
    part: Annotated[str, "NAME"] = "train",
    seed: Annotated[int, Ge(0)] = 0,
    workers: Annotated[int, Interval(ge=1, le=64)] = 1,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> TrainedModel:
    """Train a network on frames without labels.

    ``model train --from`` starts from its weights. After an interruption, the same call continues.

    The network learns to predict occupancy and height: of hidden blocks of pillars (``masked``), or
    of the next sweep (``next-sweep``).

    Args:
        frames: recordings, real or simulated; their labels are not used.
        out: folder to write; ``pretrained`` beside the first recording if not given.
        task: task to learn: ``masked`` (hidden pillars), or ``next-sweep`` (consecutive sweeps of
            static sensors or of known poses).
        steps: number of training steps; as many as fit into ``minutes`` if not given.
        minutes: minutes of training on this machine, reading left out; 10 if neither is given.
        reach: range along x and y from the centre of the sensors, metres.
        cell: edge of a pillar, metres.
        batch: windows of frames in a step.
        width: multiple of the channels of the small network.
        intensity: use intensities (0..1).
        part: part of each split dataset to learn from: ``train``, ``val``, ``test`` or ``all``.
        seed: random seed of weights and samples.
        workers: number of processes that read frames and make samples; the weights are the same.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: torch is not installed, the task is unknown, a recording cannot be used, or no
            frame has a successor for ``next-sweep``.

    Example:
        $ urbantwin model pretrain urbantwin-demo/dataset -o pretrained/ --minutes 10
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin import __version__
    from urbantwin.artefact import check_folder, digest_of, replaced_folder
    from urbantwin.dataset.manifest import recipe_key
    from urbantwin.learn import (
        Design,
        Model,
        Recipe,
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
