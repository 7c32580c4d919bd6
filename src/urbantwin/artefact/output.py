"""Outputs: folders and files written atomically, which replace only their own kind."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from filecmp import cmp
from pathlib import Path

from urbantwin.artefact.disk_space import says_no_room
from urbantwin.artefact.document import read_json
from urbantwin.artefact.inventory import (
    INVENTORY,
    foreign_entry,
    read_inventory,
    write_inventory,
)
from urbantwin.artefact.scratch import alone, claimed, put_in_place, refuse_if_written
from urbantwin.artefact.written_files import (
    check_replaceable_file,
    overwriting,
    publish_file,
    take_mode,
)
from urbantwin.errors import InputError
from urbantwin.interruption import deferred, unless_swallowed

__all__ = ["KINDS", "check_file", "check_folder", "kind_of", "replaced_file", "replaced_folder"]

#: Every kind of artefact; the manifest of a ``twin`` is ``twin.json``.
KINDS = (
    *("twin", "motion", "dataset", "report", "coverage", "tuning", "submission"),
    *(
        "variation",
        "suite",
        "curriculum",
        "geojson",
        "sumo",
        "carla",
        "plan",
        "calibration",
        "discovery",
        "observation",
        "detections",
        "evaluation",
        "fusion",
        "model",
        "labelling",
        "exported",
        "sequence",
        "card",
        "fleet",
        "study",
        "campaign",
        "explanation",
        "placement",
    ),
)
#: A rig whose sensors are not fused gives a dataset of datasets.
_ALSO = {"dataset": ("dataset", "datasets")}


def kind_of(folder: Path) -> str | None:
    """Return the kind of artefact that a folder is, or ``None``."""
    for kind in KINDS:
        path = folder / f"{kind}.json"
        if path.is_file():
            try:
                said = read_json(path, kind=kind).get("kind")
            except InputError:
                continue
            if said in _ALSO.get(kind, (kind,)):
                return kind
    return None


def check_folder(target: Path, *, kind: str, inputs: Sequence[Path | None] = ()) -> None:
    """Check that an output folder can be written, before any work.

    Args:
        target: the folder to write. It may be an older artefact of the same kind, without files
            missing in its inventory.
        kind: kind of the artefact; its manifest is ``KIND.json``.
        inputs: input files and folders; ``None`` are ignored.

    Raises:
        InputError: it is a file, holds something else, is inside another artefact or an input,
            contains an input, is being written by another run, or is not writable.
    """
    real = _real(target)
    _check_place(target, real, inputs)
    _check_replaceable(target, real, kind)
    refuse_if_written(real)


def check_file(
    target: Path,
    *,
    kind: str | None,
    inputs: Sequence[Path | None] = (),
    replaces: Path | None = None,
) -> None:
    """Check that an output file can be written, before any work.

    Args:
        target: the file to write.
        kind: kind of output; an older one of the same kind written by urbantwin is replaced; with
            ``None`` none is.
        inputs: input files and folders.
        replaces: input that may be replaced.

    Raises:
        InputError: it is not a regular file, may not be replaced (`written_files`), is an input, is
            inside an artefact or an input, is being written by another run, or is not writable.
    """
    real = _real(target)
    if replaces is None or real != Path(os.path.realpath(replaces)):
        _check_place(target, real, inputs)
    check_replaceable_file(target, real, kind)
    refuse_if_written(real)


@contextmanager
def replaced_folder(
    target: Path, *, kind: str, inputs: Sequence[Path | None] = (), key: str | None = None
) -> Iterator[Path]:
    """Yield a folder beside ``target`` that takes its place when the block succeeds.

    If the block fails, ``target`` is unchanged and partial output is removed; with a ``key``, it is
    kept for the next run with that key. The folder gets an inventory of its files, unless the block
    wrote one.

    Args:
        target: the folder to write; see `check_folder`.
        kind: the artefact's kind; its manifest is ``KIND.json``.
        inputs: input files and folders.
        key: 16 hexadecimal digits that identify the result. The folder then holds the files of an
            interrupted run with the same key.

    Raises:
        InputError: see `check_folder`.
        StageError: the disk is full.
    """
    check_folder(target, kind=kind, inputs=inputs)
    with (
        claimed(target, key=key) as scratch,
        says_no_room(target, scratch.folder, goes_on=key is not None),
    ):
        yield scratch.folder
        if not (scratch.folder / INVENTORY).is_file():
            write_inventory(scratch.folder)
        unless_swallowed()
        with deferred():
            # The target may have changed since the check.
            _check_replaceable(target, scratch.target, kind)
            take_mode(scratch.folder, scratch.target)
            put_in_place(scratch.folder, scratch.target)


@contextmanager
def replaced_file(
    target: Path,
    *,
    kind: str | None,
    inputs: Sequence[Path | None] = (),
    replaces: Path | None = None,
) -> Iterator[Path]:
    """Yield a path of the same name in a scratch folder, whose files are moved at the end.

    Files written beside it (an OBJ's materials) are moved as well, before it. If the block fails,
    ``target`` is unchanged and partial output is removed. New files get the mode of those they
    replace.

    Args:
        target: the file to write; an older one is replaced if urbantwin wrote it (`check_file`).
        kind: kind of output.
        inputs: input files and folders.
        replaces: input that may be replaced.

    Raises:
        InputError: see `check_file`; or an additional file would replace another file.
        StageError: the disk is full.
    """
    check_file(target, kind=kind, inputs=inputs, replaces=replaces)
    with claimed(target) as scratch, says_no_room(target, scratch.folder):
        yield scratch.folder / target.name
        made = sorted(scratch.folder.iterdir(), key=lambda one: one.name == target.name)
        places = [
            scratch.target if one.name == target.name else scratch.target.with_name(one.name)
            for one in made
        ]
        unless_swallowed()
        with deferred(), alone(scratch.target.parent):
            # The target may have changed since the check.
            for file, place in zip(made, places, strict=True):
                if place == scratch.target:
                    check_replaceable_file(target, place, kind)
                elif not (place.is_file() and cmp(place, file, shallow=False)):
                    # Equal bytes: written by a run that was killed here.
                    check_replaceable_file(target.with_name(place.name), place, kind)
            for file, place in zip(made, places, strict=True):
                with overwriting(allowed=True):  # it was checked
                    publish_file(file, place, kind)


def _real(target: Path) -> Path:
    """Return an output's path without links.

    Raises:
        InputError: the path is not possible.
    """
    try:
        real = Path(os.path.realpath(target))
        real.exists()
    except UnicodeEncodeError as error:
        raise InputError(
            f"cannot be written: the locale ({error.encoding}) lacks letters of its name",
            file=target,
            expected="another name (-o), or a locale of UTF-8 (LC_ALL=C.UTF-8)",
        ) from None
    except (OSError, ValueError) as error:  # too long, a loop of links, no permission
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot be written ({why.lower()})", file=target) from None
    return real


def _check_place(target: Path, real: Path, inputs: Sequence[Path | None]) -> None:
    for given in inputs:
        if given is None:
            continue
        path = Path(os.path.realpath(given))
        if real == path:
            raise InputError("is also an input", file=target, expected="another output")
        if path.is_dir() and real.is_relative_to(path):
            raise InputError(
                f"is inside an input ({given})", file=target, expected="an output beside it"
            )
        if path.is_relative_to(real):
            raise InputError(
                f"holds an input ({given}), which would be lost",
                file=target,
                expected="another output",
            )
    for above in real.parents:
        kind = kind_of(above) if above.is_dir() else None
        if kind is not None:
            raise InputError(
                f"is inside a {kind} ({above})",
                file=target,
                expected=f"an output beside it: what replaces or checks the {kind} knows no such "
                "entry",
            )


def _check_replaceable(target: Path, real: Path, kind: str) -> None:
    """Check that a folder is empty or exactly an older artefact of a kind, intact or damaged.

    Raises:
        InputError: it is a file, or holds something else.
    """
    if not real.exists():
        return
    expected = f"a new or empty folder, or an older {kind} and nothing else"
    if not real.is_dir():
        raise InputError("is a file", file=target, expected=f"a folder for the {kind}")
    try:
        if not any(real.iterdir()):
            return
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=target) from None
    if kind_of(real) != kind:
        first = min(one.name for one in real.iterdir())
        raise InputError(
            f"holds other files, which would be lost ({first})", file=target, expected=expected
        )
    try:
        named = read_inventory(real)
    except InputError as error:
        raise InputError(
            f"holds a {kind} whose inventory cannot be used ({error.file}: {error.problem}), and "
            "maybe other files, which would be lost",
            file=target,
            expected=expected,
        ) from None
    foreign = foreign_entry(real, named)
    if foreign is not None:
        raise InputError(
            f"holds other files, which would be lost ({foreign})", file=target, expected=expected
        )
