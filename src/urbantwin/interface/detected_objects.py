"""What a detector detects in a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.errors import InputError
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

if TYPE_CHECKING:
    from urbantwin.detections import Detections

__all__ = ["DetectedObjects", "detect"]


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


def detect(  # noqa: PLR0913 - the options of the command
    model: AnyPath,
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    least: float = 0.05,
    layout: str | None = None,
    part: str = "all",
    standing: AnyPath | None = None,
    views: int = 1,
    second_look: bool = True,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> DetectedObjects:
    """Detect road users in the frames of a recording, and the classes of points if the model can.

    Args:
        model: a folder that `train` wrote.
        frames: a dataset of ours or any recording that is read; no label of it is looked at.
        out: the folder to write; ``detections`` beside the frames when not given.
        least: boxes with a lower score are left out.
        layout: how the frames lie; found out when not given.
        part: of a dataset that is split, the frames to look at: ``train``, ``val``, ``test``;
            ``all`` of them when not given.
        standing: detections in other frames of the same sensors, which stand still: whoever is
            found as a person or rider at one place in half of them is a post or a hedge, and is
            left out.
        views: look at each frame from so many sides (turned by quarters, mirrored), and take the
            mean of what is said: better boxes, in so many times the time.
        second_look: look again at the points of people and two-wheelers that are found, if the
            model has learned to.
        device: of torch: ``cpu``, ``cuda``.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: torch is not installed, the model, the frames or ``standing`` cannot be used,
            it is of too few frames, or there are not so many sides.
    """
    from urbantwin.artefact import replaced_folder
    from urbantwin.detections import (
        check_detections_folder,
        put_detections,
        read_detections,
        standing_places,
        without_standing,
        write_semantic,
    )
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin.learn import detected, read_model
    from urbantwin.learn.views import MOST_VIEWS

    if not 1 <= views <= MOST_VIEWS:
        raise InputError(f"is {views}", place="--views", expected=f"1 to {MOST_VIEWS}")
    source, real = Path(model), Path(frames)
    target = beside(real, "detections") if out is None else Path(out)
    inputs = [source, real] if standing is None else [source, real, Path(standing)]
    check_detections_folder(target, inputs)
    with shown_stage("detect", progress, brief=True) as tell:
        places = None
        if standing is not None:
            places = standing_places(read_detections(Path(standing)), Path(standing))
        detector = read_model(source, device)
        if not second_look:
            detector = replace(detector, second_look=None)
        recording = recording_of_part(real, layout, part)
        made_by = {
            "urbantwin": "detect",
            "least": least,
            "views": views,
            "second_look": detector.second_look is not None,
            "model": dict(detector.trained),
        }
        with replaced_folder(target, kind="detections", inputs=inputs) as scratch:
            found = detected(
                detector,
                recording,
                device=device,
                least=least,
                views=views,
                semantic=partial(write_semantic, scratch),
                tell=tell,
            )
            if places is not None:
                found = without_standing(found, places)
                made_by["standing_places"] = len(places)
            put_detections(scratch, found, made_by)
    return DetectedObjects(target, found)
