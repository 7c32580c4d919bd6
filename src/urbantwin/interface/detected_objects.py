"""Detection of road users in a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Interval

from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.detections import Detections

__all__ = ["DetectedObjects", "detect"]


@dataclass(frozen=True, eq=False, repr=False)
class DetectedObjects(Artefact):
    """Detections in a folder; can be passed as its folder: ``ut.model.evaluate(found, data)``.

    Attributes:
        folder: the folder.
        found: the boxes.
    """

    folder: Path
    found: Detections

    def __repr__(self) -> str:
        """Return the number of boxes, and the folder."""
        return f"{len(self.found)} detections ({self.folder})"

    def summary(self) -> Summary:
        """Return the boxes per class; ``likely`` counts those with a score above 0.5."""
        names = self.found.class_names
        likely = self.found.only(self.found.score > 0.5).class_names
        return Summary(
            path=str(self.folder),
            frames=len(self.found.frames),
            boxes={name: names.count(name) for name in sorted(set(names))},
            likely={name: likely.count(name) for name in sorted(set(likely))},
        )


@command
def detect(
    frames: AnyPath,
    out: AnyPath | None = None,
    *,
    model: AnyPath | None = None,
    least: Annotated[float, Interval(ge=0.001, le=0.999)] = 0.05,
    layout: str | None = None,
    part: Annotated[str, "NAME"] = "all",
    standing: AnyPath | None = None,
    views: Annotated[int, Interval(ge=1, le=8)] = 1,
    second_look: bool = True,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> DetectedObjects:
    """Detect road users in the frames of a recording.

    Args:
        frames: dataset or any known recording; its labels are not used.
        out: folder to write; ``detections`` beside the frames if not given.
        model: folder that ``model train`` wrote; the detector that comes with UrbanTwin, trained on
            twins alone, if not given.
        least: lowest score of a written box.
        layout: layout of the frames; recognised from their files if not given.
        part: part of a split dataset to detect in: ``train``, ``val``, ``test`` or ``all``.
        standing: detections in other frames of the same static sensors; pedestrians and riders at a
            place occupied in half of them are posts or hedges, and are left out.
        views: number of views per frame (turned by 90 degrees, mirrored) to average over; improves
            boxes and multiplies the time.
        second_look: apply the model's second stage, if any, to detected pedestrians and
            two-wheelers.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: torch is not installed, the model, the frames or ``standing`` cannot be used, it
            covers too few frames, or ``views`` is too large.

    Example:
        $ urbantwin model detect urbantwin-demo/dataset -o detections/
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
    from urbantwin.learn import SHIPPED_MODEL, detected, read_model
    from urbantwin.learn.views import MOST_VIEWS

    if not 1 <= views <= MOST_VIEWS:
        raise InputError(f"is {views}", place="--views", expected=f"1 to {MOST_VIEWS}")
    source, real = SHIPPED_MODEL if model is None else Path(model), Path(frames)
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
