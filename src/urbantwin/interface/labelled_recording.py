"""Recordings labelled by a model, as training data for another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Interval

from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

__all__ = ["LabelledRecording", "label"]


@dataclass(frozen=True, eq=False, repr=False)
class LabelledRecording(Artefact):
    """Frames with labels of a model; can be passed as its folder: ``ut.model.train(it)``.

    Attributes:
        folder: the folder, in the OpenPCDet layout.
        labels: number of labels by class; ``doubted`` ones are ignored in training.
    """

    folder: Path
    labels: dict[str, int]

    def __repr__(self) -> str:
        """Return the number of labels, and the folder."""
        return f"{sum(self.labels.values())} labels of a model ({self.folder})"

    def summary(self) -> Summary:
        """Return the number of labels per class."""
        return Summary(path=str(self.folder), labels=dict(sorted(self.labels.items())))


@command
def label(
    model: AnyPath,
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    sure: Annotated[float, Interval(ge=0.001, le=0.999)] = 0.5,
    doubtful: Annotated[float, Interval(ge=0.001, le=0.999)] = 0.15,
    rate: Annotated[float | None, Ge(0.01)] = None,
    layout: str | None = None,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> LabelledRecording:
    """Label frames by a model, for another to learn from.

    With ``rate`` (or if the frames have times) its detections are tracked backwards and forwards: a
    track has one class and size, smooth positions, and gaps are filled.

    Args:
        model: teacher: a folder that ``model train`` wrote.
        frames: recording; its labels are not used.
        out: folder to write; ``labelled`` beside the frames if not given.
        sure: lowest score of a box that becomes a label.
        doubtful: lowest score of a box that is ignored in training; boxes below are dropped.
        rate: frames per second, Hz, of consecutive frames, which are then tracked.
        layout: layout of the frames; recognised from their files if not given.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: torch is not installed, or the model or the frames cannot be used.

    Example:
        $ urbantwin model label teacher/ real/ -o labelled/ --rate 10
    """
    from urbantwin.artefact import check_folder, replaced_folder
    from urbantwin.fidelity.readers import open_recording
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin.learn import detected, read_model
    from urbantwin.learn.labelling import write_labelled
    from urbantwin.progress import between
    from urbantwin.tracking import Linking, tracked
    from urbantwin.tracking.moments import moments, poses_of

    if not 0 < doubtful <= sure < 1:
        raise InputError(
            f"is {doubtful:g} with --sure {sure:g}",
            place="--doubtful",
            expected="above 0 and at most --sure, which is below 1",
        )
    source, real = Path(model), Path(frames)
    target = beside(real, "labelled") if out is None else Path(out)
    check_folder(target, kind="labelling", inputs=[source, real])
    with shown_stage("label", progress, brief=True) as tell:
        teacher = read_model(source, device)
        if not teacher.design.classes:
            raise InputError("finds no boxes", file=source, expected="a model with a head for them")
        recording = open_recording(real, layout)
        found = detected(teacher, recording, device=device, tell=between(tell, 0.0, 0.6))
        follows = rate is not None or recording.layout == "own"
        if follows and len(found.frames) > 1:
            try:
                times = moments(found, real, rate=rate, frames=real)
            except InputError:
                if rate is not None:
                    raise
                follows = False  # the dataset has no frame times
            else:
                poses = poses_of(found, real, between(tell, 0.6, 0.7))
                how = Linking(birth=min(0.3, sure), lowest=0.1)
                found = tracked(found, times, poses=poses, how=how, smooth=True,
                                tell=between(tell, 0.7, 0.8))  # fmt: skip
        found = found.only(found.score >= doubtful)
        made_by = {
            "urbantwin": "label",
            "sure": sure,
            "doubtful": doubtful,
            "tracked": follows,
            "model": dict(teacher.trained),
        }
        with replaced_folder(target, kind="labelling", inputs=[source, real]) as scratch:
            counts = write_labelled(
                scratch, recording, found, sure=sure, made_by=made_by, tell=between(tell, 0.8, 1.0)
            )
    return LabelledRecording(target, counts)
