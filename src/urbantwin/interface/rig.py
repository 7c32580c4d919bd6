"""Rigs of commands, placed on a twin."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from urbantwin.errors import InputError

if TYPE_CHECKING:
    from urbantwin.dataset.fleet.node import PlacedRig
    from urbantwin.lidar import Rig
    from urbantwin.site import RigSpec
    from urbantwin.site.nodes import NodesFile
    from urbantwin.site.rig_changes import RigChanges
    from urbantwin.twin import Twin

__all__ = ["fields_below", "placed", "rig_on", "rig_spec_on", "rigs_of_nodes"]


def rig_on(twin: Twin, rig_file: Path | None = None, changes: RigChanges | None = None) -> Rig:
    """Place the rig of a file, or the twin's own, on a twin."""
    spec, file = rig_spec_on(twin, rig_file, changes)
    return placed(spec, twin, file)


def placed(spec: RigSpec, twin: Twin, file: Path) -> Rig:
    """Place a rig on a twin; errors name its file."""
    from urbantwin.lidar import place_rig

    return place_rig(spec, twin.mesh, file=file, anchor_height_m=twin.anchor_height_m)


def rig_spec_on(
    twin: Twin, rig_file: Path | None, changes: RigChanges | None = None
) -> tuple[RigSpec, Path]:
    """Return the rig of a file, or the twin's own, with changes applied, and its file."""
    from urbantwin.site import load_rig_spec

    file = twin.folder / "rig.yaml" if rig_file is None else rig_file
    return _changed(load_rig_spec(file, twin.frame), twin, changes), file


def rigs_of_nodes(
    asked: NodesFile, twin: Twin, changes: RigChanges | None = None
) -> list[PlacedRig]:
    """Place the rig of every node on a twin, all with the same changes; errors name its file."""
    from urbantwin.dataset.fleet.node import PlacedRig

    found = []
    for number in range(len(asked.nodes)):
        spec, file, field = asked.rig_of(number, twin.frame, twin.folder / "rig.yaml")
        spec = _changed(spec, twin, changes)
        with fields_below(field, file):
            found.append(PlacedRig(spec, placed(spec, twin, file), file, field))
    return found


def _changed(spec: RigSpec, twin: Twin, changes: RigChanges | None) -> RigSpec:
    # Reflectivities in the rig take precedence over those drawn for the twin's streets.
    bright = {**twin.reflectivity, **spec.reflectivity}
    spec = spec.model_copy(update={"reflectivity": bright})
    return spec if changes is None else changes.applied_to(spec)


@contextmanager
def fields_below(field: str, file: Path) -> Iterator[None]:
    """Prefix the fields of errors in ``file`` with ``field``."""
    try:
        yield
    except InputError as error:
        if not field or error.file != str(file):
            raise
        place = f"{field}.{error.place}" if error.place else field
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None
