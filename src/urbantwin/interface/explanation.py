"""Explanations of differing detections in two recordings that differ in one factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Interval

from urbantwin.artefact import check_folder, read_json, replaced_folder
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.detected_objects import detect
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.variation import Variation
from urbantwin.progress import between

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.evaluation import Criterion

__all__ = ["Explanation", "explain"]

_KIND = "explanation"
#: Matching rules between detections and objects.
_BY = ("distance", "overlap")


@dataclass(frozen=True, repr=False)
class Explanation(Artefact):
    """Objects detected in one recording and missed in another, with reasons.

    Attributes:
        folder: the folder; ``explanation.html`` in it is the report page.
        manifest: content of ``explanation.json``.
    """

    folder: Path
    manifest: dict[str, Any]

    @classmethod
    def open(cls, folder: AnyPath) -> Explanation:
        """Open an explanation's folder.

        Raises:
            InputError: the folder is not an explanation.
        """
        return cls(Path(folder), read_json(Path(folder) / f"{_KIND}.json", kind=_KIND))

    def __repr__(self) -> str:
        """Return the headline and the folder."""
        return f"{self.manifest['in_short']} ({self.folder})"

    @property
    def changes(self) -> pa.Table:
        """A row per frame and object that is detected on one side only."""
        from urbantwin.artefact.tables import read_parquet

        return read_parquet(self.folder / "changes.parquet", "changes of an explanation")

    def summary(self) -> Summary:
        """Return the number of changed objects, by reason."""
        told = self.manifest
        return Summary(
            path=str(self.folder),
            page=str(self.folder / f"{_KIND}.html"),
            in_short=told["in_short"],
            scores={name: round(score, 3) for name, score in told["scores"].items()},
            variants=told["variants"],
            objects=told["objects"],
            drawn=told["drawn"],
        )


@command
def explain(
    pair: AnyPath,
    out: AnyPath | None = None,
    *,
    model: AnyPath | None = None,
    detections: Sequence[AnyPath] = (),
    score: float | None = None,
    by: Annotated[str, "NAME"] = "distance",
    drawn: Annotated[int, Interval(ge=0, le=10000)] = 60,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> Explanation:
    """Explain why a factor makes a detector miss objects.

    Args:
        pair: folder that ``experiment vary`` wrote: a base and its variants.
        out: folder to write; ``explanation`` in the pair's folder if not given.
        model: detector to run on all recordings, into ``OUT-detections``.
        detections: detections instead of a model, for the base, then for each variant.
        score: lowest score of a detection that counts; the score of the base's best F1, by class,
            if not given.
        by: matching rule of detections and objects: ``distance`` (within 1 m, trucks and buses 2 m)
            or ``overlap`` (BEV IoU of 0.5).
        drawn: largest number of objects to draw.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the pair, the model or the detections cannot be used.

    Example:
        >>> ut.experiment.explain("pair/", model="model/").changes
        $ urbantwin experiment explain sweep/ --model model/
    """
    from urbantwin.detections.forms import read_any_form
    from urbantwin.evaluation.criterion import JUDGED, near, overlapping
    from urbantwin.studies.causes import (
        changes_between,
        read_side,
        thresholds_of,
        write_explanation,
    )

    varied = _opened(Path(pair))
    names = ["base", *(row["name"] for row in varied.manifest["variants"])]
    target = varied.folder / _KIND if out is None else Path(out)
    given = [Path(one) for one in detections]
    _check(varied, names, model, given, score, by)
    inputs = [varied.folder / name for name in names] + [varied.folder / "comparison", *given]
    check_folder(target, kind=_KIND, inputs=inputs)
    data = [varied.folder / name / "dataset" for name in names]
    if model is not None:
        said = target.with_name(f"{target.name}-detections")
        given = [
            detect(one, said / name, model=model, device=device, progress=progress).folder
            for name, one in zip(names, data, strict=True)
        ]
    criterion: dict[str, Criterion] = {
        name: near(name) if by == "distance" else overlapping() for name in JUDGED
    }
    with shown_stage("explain", progress, brief=True) as tell:
        fates = varied.fates
        if "hiders" not in fates.column_names:
            raise InputError(
                "does not say what hides objects in part",
                file=varied.folder / "comparison" / "fates.parquet",
                expected="a pair of this version of `urbantwin experiment vary`: vary again",
            )
        sides = []
        for number, (name, one, found) in enumerate(zip(names, data, given, strict=True)):
            told = between(tell, 0.6 * number / len(names), 0.6 * (number + 1) / len(names), name)
            recording = recording_of_part(one, None, "all")
            boxes, _ = read_any_form(found, partial(recording_of_part, one, None, "all"))
            sides.append(read_side(name, recording, boxes, fates, told))
        base, *variants = sides
        least = thresholds_of(base, score)
        compared = [changes_between(base, one, criterion, least) for one in variants]
        with replaced_folder(target, kind=_KIND, inputs=inputs) as folder:
            manifest = write_explanation(
                folder,
                compared,
                {
                    "factor": varied.manifest["factor"],
                    "by": by,
                    "criterion": "stands within 1 m of it in plan (trucks, buses 2 m)"
                    if by == "distance"
                    else "has an intersection over union of a half with it in plan",
                    "names": names,
                },
                least=least,
                most=drawn,
                tell=between(tell, 0.7, 1.0),
            )
    return Explanation(target, manifest)


def _opened(folder: Path) -> Variation:
    """Open a folder that ``vary`` wrote.

    Raises:
        InputError: the folder holds no comparison, or is damaged.
    """
    file = folder / "comparison" / "variation.json"
    if not file.is_file():
        raise InputError(
            "holds no comparison" if folder.is_dir() else "is not there",
            file=folder,
            expected="a folder that `urbantwin experiment vary` wrote",
        )
    manifest = read_json(file, kind="variation")
    rows = manifest.get("variants")
    if not isinstance(rows, list) or not all(
        isinstance(row, dict) and isinstance(row.get("name"), str) for row in rows
    ):
        raise InputError("is damaged", file=file, expected="what `urbantwin experiment vary` wrote")
    return Variation(folder, manifest)


def _check(
    varied: Variation,
    names: Sequence[str],
    model: AnyPath | None,
    given: Sequence[Path],
    score: float | None,
    by: str,
) -> None:
    """Check options and inputs before anything is detected.

    Raises:
        InputError: an option is wrong, or a dataset is missing.
    """
    if (model is None) == (not given):
        raise InputError(
            "neither a model nor detections are given"
            if model is None
            else "is given beside detections",
            place="--model",
            expected="a model, or detections of each recording",
        )
    if given and len(given) != len(names):
        raise InputError(
            f"{len(given)} are given for {len(names)} recordings",
            place="--detections",
            expected=f"one each of {', '.join(names)}, in this order",
        )
    if score is not None and not 0 <= score <= 1:
        raise InputError(f"is {score:g}", place="--score", expected="0 to 1")
    if by not in _BY:
        raise InputError(f"is {by!r:.40}", place="--by", expected=" or ".join(_BY))
    for name in names:
        if not (varied.folder / name / "dataset" / "dataset.json").is_file():
            raise InputError(
                "has no dataset", file=varied.folder / name, expected="what `vary` wrote there"
            )
