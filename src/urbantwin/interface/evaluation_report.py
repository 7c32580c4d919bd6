"""Evaluation of detections against labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Interval

from urbantwin.artefact import INVENTORY, check_folder, read_json, replaced_folder, sha256_of
from urbantwin.artefact.output import kind_of
from urbantwin.interface.command import command
from urbantwin.interface.detected_objects import detect
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Artefact, Summary

__all__ = ["Evaluation", "evaluate"]

_KIND = "evaluation"


class Evaluation(Artefact):
    """Evaluation of detections: figures of every class, with intervals.

    Attributes:
        folder: the folder; ``evaluation.html`` in it is the report page.
        manifest: content of ``evaluation.json``.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_json(self.folder / f"{_KIND}.json", kind=_KIND)

    def __repr__(self) -> str:
        """Return the headline and the folder."""
        return f"{self.in_short} ({self.folder})"

    @property
    def in_short(self) -> str:
        """The headline."""
        return str(self.manifest["in_short"])

    @property
    def figures(self) -> dict[str, dict[str, Any]]:
        """All figures, by class; ``manifest["definitions"]`` defines each."""
        return dict(self.manifest["classes"])

    def summary(self) -> Summary:
        """Return average precisions in percent, with 95 % intervals, and doubts and notes."""
        told = self.manifest
        return Summary(
            path=str(self.folder),
            page=str(self.folder / f"{_KIND}.html"),
            in_short=self.in_short,
            doubts=told["doubts"],
            frames=told["frames"],
            boxes=told["boxes_counted"],
            distinct_objects=told["distinct"],
            tracks=told["tracks"],
            labelled_view=told["labelled_view"],
            average_precision={
                f"{name} (n = {row['objects']})": {
                    criterion: _rounded(one) for criterion, one in row["ap"].items()
                }
                for name, row in self.figures.items()
            },
            tracking={
                name: {key: round(100 * row[key], 1) for key in ("hota", "mota", "idf1")}
                for name, row in (told["tracking"] or {}).items()
            },
            **({"points": _points(told["semantic"])} if told.get("semantic") else {}),
            notes=told["notes"],
        )


def _points(told: dict[str, Any]) -> dict[str, float]:
    """Return the IoU of each class of points, percent, and their mean."""
    found = {name: round(100 * row["iou"], 1) for name, row in told["classes"].items()}
    return {"mean IoU": round(100 * told["mean_iou"], 1), **found}


def _rounded(figure: dict[str, Any]) -> list[float | None]:
    """Return a figure and the ends of its interval, percent with one decimal."""
    ends = figure.get("ap_ci95") or ()
    return [None if one is None else round(100 * one, 1) for one in (figure["ap"], *ends)]


def _learned_from(detections: Path, data: Path, part: str) -> list[str]:
    """Return a doubt if the detecting model was trained on frames of this dataset."""
    file, sums = detections / "detections.json", data / INVENTORY
    if not (file.is_file() and sums.is_file()):
        return []
    made_by = read_json(file, kind="detections").get("made_by")
    model = made_by.get("model") if isinstance(made_by, dict) else None
    rows = model.get("datasets") if isinstance(model, dict) else None
    known = [one.get("sha256") for one in rows or () if isinstance(one, dict)]
    learned = model.get("part", "all") if isinstance(model, dict) else ""
    if sha256_of(sums) not in known or (learned != part and "all" not in (learned, part)):
        return []
    return [
        "The model has learned from this dataset, and from some of these frames: other frames tell "
        "how good it is (--part test)."
    ]


@command
def evaluate(
    detections: AnyPath,
    data: AnyPath,
    out: AnyPath | None = None,
    *,
    classes: Annotated[Sequence[str] | None, "NAME"] = None,
    layout: str | None = None,
    part: Annotated[str, "NAME"] = "all",
    within: Annotated[float | None, Interval(ge=1, le=1000)] = None,
    fewest_points: Annotated[int | None, Interval(ge=1, le=1000)] = None,
    vans: bool = False,
    progress: ShowProgress = True,
) -> Evaluation:
    """Judge detections by the labels of the same frames.

    Args:
        detections: folder of detections, of UrbanTwin or in the format of KITTI, OpenPCDet or
            nuScenes; or a model, which first detects into ``OUT-detections``.
        data: labelled frames: a dataset or a real recording.
        out: folder to write; one beside the detections if not given.
        classes: class to evaluate; all labelled classes if not given.
        layout: layout of the data; recognised from its files if not given.
        part: part of a split dataset to evaluate on: ``train``, ``val``, ``test`` or ``all``.
        within: largest distance from a sensor of an object that counts, metres.
        fewest_points: number of points below which a box does not count; 5 if not given.
        vans: count KITTI's vans as cars; they do not count if not given.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the detections or the data cannot be used, or have no frame in common.

    Example:
        $ urbantwin model evaluate detections/ urbantwin-demo/dataset -o report/
    """
    from urbantwin.detections.forms import read_any_form
    from urbantwin.evaluation import FEWEST_POINTS, read_labelled
    from urbantwin.evaluation import evaluate as judged
    from urbantwin.evaluation.report import write_evaluation
    from urbantwin.evaluation.semantic import judged_semantic
    from urbantwin.progress import between

    source, real = Path(detections), Path(data)
    target = beside(source, _KIND) if out is None else Path(out)
    fewest = FEWEST_POINTS if fewest_points is None else fewest_points
    check_folder(target, kind=_KIND, inputs=[source, real])
    if kind_of(source) == "model":
        said = target.with_name(f"{target.name}-detections")
        source = detect(
            real, said, model=source, layout=layout, part=part, progress=progress
        ).folder
    learned = _learned_from(source, real, part)
    with shown_stage("evaluate", progress, brief=True) as tell:
        recording = recording_of_part(real, layout, part)
        said_there, notes = read_any_form(source, lambda: recording)
        seen = read_labelled(
            said_there,
            recording,
            fewest_points=fewest,
            most_m=within,
            tell=between(tell, 0.0, 0.5),
        )
        seen = replace(seen, notes=(*seen.notes, *notes, *learned))
        found = judged(
            seen, layout=recording.layout, classes=classes, vans=vans, tell=between(tell, 0.5, 0.8)
        )
        told = {
            "predictions": source.name,
            "data": real.name,
            "settings": {"fewest_points": fewest, "within_m": within, "vans": vans},
        }
        with replaced_folder(target, kind=_KIND, inputs=[source, real]) as scratch:
            semantic = judged_semantic(source, recording, between(tell, 0.8, 0.95))
            write_evaluation(scratch, found, recording, told, semantic)
    for note in learned:
        tell_line(f"warning: {note}", progress)
    return Evaluation(target)
