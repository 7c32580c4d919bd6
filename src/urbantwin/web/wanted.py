"""Requests to the viewer, and the content of their paths: runs, reports, detections, parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from urbantwin.artefact import kind_of
from urbantwin.dataset import parts_of
from urbantwin.errors import InputError
from urbantwin.fidelity.readers.recording import file_and_choice
from urbantwin.web.beside import read_report, sides_of_report
from urbantwin.web.chosen_frames import ChosenFrames

__all__ = ["EXPECTED", "Sought", "Wanted", "sought"]

#: What can be looked at.
EXPECTED = (
    "a twin, a motion, a dataset, a folder of real frames, detections beside their data, "
    "a report of compare, a fleet, or a folder with a twin, a motion and a dataset in it"
)
#: Contents of a folder of `urbantwin run`, in order of preference.
_OF_A_LINE = ("dataset", "motion", "twin")


@dataclass(frozen=True)
class Wanted:
    """A request to the viewer.

    Attributes:
        path: path to show.
        other: path to show beside it; None for one side.
        twin: twin to show frames in; None to search beside them.
        motion: motion with the signals; None to search beside them.
        detections: detections over the labels of the first side.
        report: report of ``compare``, whose worst places are listed.
        frames: frames to show.
    """

    path: Path
    other: Path | None = None
    twin: Path | None = None
    motion: Path | None = None
    detections: Path | None = None
    report: Path | None = None
    frames: ChosenFrames = field(default_factory=ChosenFrames)


@dataclass(frozen=True)
class Sought:
    """Resolved paths of a `Wanted`.

    Attributes:
        paths: one or two paths to show.
        kinds: kind of artefact of each; None for data of other programs.
        detections: detections over the labels of the first; None without.
        report: report of ``compare``; None without.
    """

    paths: tuple[Path, ...]
    kinds: tuple[str | None, ...]
    detections: Path | None
    report: Mapping[str, Any] | None


def sought(wanted: Wanted) -> Sought:
    """Return the resolved paths of a request.

    Raises:
        InputError: a path is missing, or cannot be shown.
    """
    given = [path for path in (wanted.path, wanted.other) if path is not None]
    report = None if wanted.report is None else read_report(wanted.report)
    detections = wanted.detections
    found: list[Path] = []
    for path in map(_place, given):
        kind = _kind(path)
        if kind == "report":
            report = read_report(path)
            found += sides_of_report(path, report) if len(given) == 1 else ()
        elif kind == "detections":
            detections = path
            found += [_data_of(path)] if len(given) == 1 else []
        elif kind == "dataset":
            found += _parts(path, most=2 if len(given) == 1 else 1)
        else:
            found.append(path)
    if not found:
        raise InputError("is nothing to look at alone", file=given[0], expected=EXPECTED)
    if report is not None and len(found) != 2:
        raise InputError("has one side", file=found[0], expected="both sides of the report")
    return Sought(tuple(found), tuple(map(_kind, found)), detections, report)


def _place(path: Path) -> Path:
    """Return the folder of a manifest, or the preferred artefact in a folder of `urbantwin run`."""
    if path.suffix == ".json" and path.is_file() and kind_of(path.parent) == path.stem:
        return path.parent
    if _kind(path) is None and path.is_dir():
        inside = (path / one for one in _OF_A_LINE if kind_of(path / one) == one)
        return next(inside, path)
    return path


def _kind(path: Path) -> str | None:
    place, choice = file_and_choice(path)
    if not place.exists():
        raise InputError("not found", file=place, expected=EXPECTED)
    return kind_of(path) if choice is None and path.is_dir() else None


def _parts(dataset: Path, most: int) -> list[Path]:
    parts = parts_of(dataset)
    if len(parts) > most:
        names = ", ".join(part.name for part in parts)
        raise InputError(
            "holds a dataset for each sensor",
            file=dataset,
            expected=f"one or two of them: {names}",
        )
    return parts


def _data_of(detections: Path) -> Path:
    beside = detections.resolve().parent / "dataset"
    if kind_of(beside) != "dataset":
        raise InputError(
            "are detections, and no dataset lies beside them",
            file=detections,
            expected="urbantwin view DATA --detections DETECTIONS",
        )
    return beside
