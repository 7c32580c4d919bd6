"""Checks of a motion's folder, on which recording relies."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pydantic import Field

from urbantwin.artefact.arrays import checked_arrays, read_arrays
from urbantwin.artefact.manifest import Part
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.mesh import MESH_FORM, checked_mesh
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.motion_rows import ActorRows

__all__ = [
    "MeshKey",
    "MotionManifest",
    "MotionReport",
    "check_actors",
    "check_motion",
    "read_meshes",
]

#: Name of an asset and its phase.
MeshKey = tuple[str, int]

#: Largest absolute values of numeric columns: metres, radians or m/s.
_MAX_VALUES = {
    **dict.fromkeys(("x", "y", "z"), 1e6),
    **dict.fromkeys(("yaw", "pitch", "roll"), 1e3),
    **dict.fromkeys(("length", "width", "height"), 1e3),
    "speed": 1e3,
}
_MESHES_NAME = "the meshes of the motion"
_PHASE = re.compile("[0-9]{1,5}")
_Count = Annotated[int, Field(ge=0, lt=2**53)]


class _Class(Part):
    seen: _Count


class _Circulation(Part):
    carried_share_of_motor_traffic: Annotated[float, Field(ge=0, le=1e6)] | None = None


class _Overlaps(Part):
    actors: _Count
    scene: _Count


class _Absent(Part):
    visits: _Count
    of: _Count
    actors: dict[str, _Count]


class MotionManifest(Part):
    """Fields of ``motion.json`` that all users of a motion need."""

    twin_sha256: str
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    step_s: Annotated[float, Field(ge=1e-3, le=86400)]
    steps: Annotated[int, Field(ge=1, le=10_000_000)]
    classes: dict[str, _Class] = Field(default_factory=dict)
    circulation: _Circulation = _Circulation()
    overlaps: _Overlaps | None = None
    absent: _Absent | None = None


class MotionReport(MotionManifest):
    """Further fields of ``motion.json``, for reports."""

    duration_s: Annotated[float, Field(ge=0, le=1e6)]
    left_out: list[dict[str, Any]]
    teleports: _Count
    collisions: _Count


def check_motion(actors: ActorRows, signals: pa.Table, until_s: float, folder: Path) -> None:
    """Raise an error for unsorted tables or impossible actors.

    Args:
        actors: rows without missing values, all finite.
        signals: rows without missing values, all finite.
        until_s: latest possible time of a step, seconds.
        folder: the motion's folder, for errors.

    Raises:
        InputError: a row is wrong; the message names the file and the column.
    """
    _check_times([signals], until_s, folder / "signals.parquet")
    file = folder / "actors.parquet"
    _check_times(actors.parts(["time_s"]), until_s, file)
    for part in actors.parts():
        check_actors(part, file)


def _check_times(parts: Iterable[pa.Table], until_s: float, file: Path) -> None:
    """Raise an error if the times of consecutive tables decrease or leave the motion."""
    ends: list[float] = []
    for part in parts:
        times = part["time_s"].to_numpy()
        if (np.diff(np.concatenate([ends[-1:], times])) < 0).any():
            raise InputError("is not sorted", file=file, place="time_s", expected="ascending times")
        ends += times[[0, -1]].tolist() if len(times) else []
    if ends and not -1e-6 <= ends[0] <= ends[-1] <= until_s + 1e-6:
        problem = f"goes from {ends[0]:g} to {ends[-1]:g} s"
        expected = f"0 to {until_s:g} s, as motion.json says"
        raise InputError(problem, file=file, place="time_s", expected=expected)


def check_actors(actors: pa.Table, file: Path) -> None:
    """Raise an error for impossible rows of actors.

    Args:
        actors: rows by ``ACTOR_SCHEMA`` without missing values, all finite.
        file: their file, for errors.

    Raises:
        InputError: a row is wrong; the message names the column.
    """
    for name, most in _MAX_VALUES.items():
        values = actors[name].to_numpy()
        if len(values) and np.abs(values).max() > most:
            raise InputError("is out of range", file=file, place=name, expected=f"up to {most:g}")
    for name in ("length", "width", "height"):
        if len(actors) and actors[name].to_numpy().min() < 0:
            raise InputError("is out of range", file=file, place=name, expected="0 or more")
    if len(actors) and actors["track"].to_numpy().min() < 0:
        raise InputError("is out of range", file=file, place="track", expected="0 or more")
    strange = set(pc.unique(actors["class"]).to_pylist()) - set(BOX_SEMANTICS)
    if strange:
        raise InputError(
            f"names {min(strange)[:40]!r}",
            file=file,
            place="class",
            expected=", ".join(BOX_SEMANTICS),
        )


def read_meshes(path: Path) -> dict[MeshKey, LabelledMesh]:
    """Return the meshes of a motion's actors, by asset and phase.

    Raises:
        InputError: the file is missing, damaged, or holds other data.
    """
    parts: dict[MeshKey, dict[str, Any]] = {}
    for name, array in read_arrays(path, _MESHES_NAME).items():
        asset, number, field = ("", "", *name.rsplit("/", 2))[-3:]
        if field not in MESH_FORM or not _PHASE.fullmatch(number):
            raise InputError(f"holds {name[:60]!r}", file=path, expected=_MESHES_NAME)
        parts.setdefault((asset, int(number)), {})[field] = array
    meshes = {}
    for (asset, phase), arrays in parts.items():
        within = f"{asset}/{phase}/"
        checked_arrays(arrays, MESH_FORM, file=path, expected=_MESHES_NAME, within=within)
        meshes[asset, phase] = LabelledMesh(**checked_mesh(arrays, path, _MESHES_NAME))
    return meshes
