"""Recordings that a model labels, for another to learn from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

__all__ = ["LabelledRecording", "label"]


@dataclass(frozen=True, eq=False, repr=False)
class LabelledRecording:
    """Frames with labels of a model, in a folder; it stands for its folder: ``ut.train(it)``.

    Attributes:
        folder: where it was written, in the OpenPCDet layout.
        labels: how many of each class; ``doubted`` ones neither help nor hurt.
    """

    folder: Path
    labels: dict[str, int]

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return how many labels there are, and the folder."""
        return f"{sum(self.labels.values())} labels of a model ({self.folder})"

    def summary(self) -> Summary:
        """Return how many labels there are of each class."""
        return Summary(path=str(self.folder), labels=dict(sorted(self.labels.items())))


def label(  # noqa: PLR0913 - the options of the command
    model: AnyPath,
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    sure: float = 0.5,
    doubtful: float = 0.15,
    rate: float | None = None,
    layout: str | None = None,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> LabelledRecording:
    """Label frames by a model, for a student to learn from.

    With ``rate`` (or where the frames say when they were taken) its detections are followed
    backwards and forwards: a track has one class and size, smooth places, and gaps are filled.

    Args:
        model: the teacher: a folder that `train` wrote.
        frames: a recording; no label of it is looked at.
        out: the folder to write; ``labelled`` beside the frames when not given.
        sure: a box with such a score is a label.
        doubtful: one with less than ``sure`` and at least this is neither right nor wrong for who
            learns; what is below is not there.
        rate: frames per second, of frames that follow each other.
        layout: how the frames lie; found out when not given.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, or the model or the frames cannot be used.
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
                follows = False  # a dataset that does not say when its frames were taken
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
