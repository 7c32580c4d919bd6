"""Motion: the pose of every actor at every step, and what the signals showed."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from urbantwin.artefact import read_json, replaced_folder, write_json
from urbantwin.artefact.manifest import validated
from urbantwin.artefact.tables import read_parquet
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.mesh import MESH_FORM
from urbantwin.progress import Progress, each, untold
from urbantwin.result_warning import ResultWarning, warnings_of
from urbantwin.traffic.assets import AssetName, asset_mesh, mesh_among
from urbantwin.traffic.motion_validity import (
    MeshKey,
    MotionManifest,
    MotionReport,
    check_actors,
    check_motion,
    read_meshes,
)
from urbantwin.traffic.signals import SIGNAL_SCHEMA

__all__ = ["ACTOR_SCHEMA", "MOTION_VERSION", "Motion", "describe"]

MOTION_VERSION = 1

_TABLE, _PARKED = "a table of the motion", "parked.parquet"
#: So many rows are written together: all of an hour would take hundreds of megabytes once more.
_GROUP = 1 << 18

ACTOR_SCHEMA = pa.schema(
    [
        ("time_s", pa.float64()),
        ("track", pa.int32()),
        ("class", pa.string()),
        ("asset", pa.string()),
        ("phase", pa.int16()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("z", pa.float64()),
        ("yaw", pa.float64()),
        ("pitch", pa.float64()),
        ("roll", pa.float64()),
        ("length", pa.float64()),
        ("width", pa.float64()),
        ("height", pa.float64()),
        ("speed", pa.float64()),
        ("lane", pa.string()),
    ]
)

_ROW = np.dtype(
    [
        (kind.name, object if pa.types.is_string(kind.type) else kind.type.to_pandas_dtype())
        for kind in ACTOR_SCHEMA
    ]
)


@dataclass(frozen=True, eq=False)
class Motion:
    """What moves in a twin, and how.

    Attributes:
        manifest: ``motion.json``: seed, step, duration, counts per class, teleports, collisions.
        actors: ``actors.parquet``, columns of ``ACTOR_SCHEMA``, sorted by time, then track.
        signals: ``signals.parquet``, columns of ``signals.SIGNAL_SCHEMA``.
        meshes: ``meshes.npz``: mesh of each asset and phase that the actors show. With them a
            motion stays what it is when the catalogue of actors changes, and recording need not
            make them again.
        parked: ``parked.parquet``, the same columns, one row for each vehicle that is parked: it
            stands there at every step.
    """

    manifest: dict[str, Any]
    actors: pa.Table
    signals: pa.Table
    meshes: Mapping[MeshKey, LabelledMesh] = field(default_factory=dict)
    parked: pa.Table = field(default_factory=ACTOR_SCHEMA.empty_table, kw_only=True)

    @property
    def step_s(self) -> float:
        """Time between steps."""
        return float(self.manifest["step_s"])

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """What is wrong with it."""
        return warnings_of(self.manifest)

    def times(self) -> NDArray[np.float64]:
        """Return the times (T,) of the steps, seconds; a step may be without actors."""
        return step_times(int(self.manifest["steps"]), self.step_s)

    def at(self, time_s: float) -> NDArray[np.void]:
        """Return the actors of one step: a structured array with the fields of ``ACTOR_SCHEMA``.

        Text fields hold ``str`` objects. The rows are sorted by track.

        Raises:
            InputError: the motion has no step at that time.
        """
        times = self.times()
        nearest = int(np.abs(times - time_s).argmin())
        if abs(float(times[nearest]) - time_s) > 1e-6:
            raise InputError(
                f"the motion has no step at {time_s:g} s",
                expected=f"a multiple of {self.step_s:g} s from 0 to {float(times[-1]):g} s",
            )
        column = self._time
        first, last = np.searchsorted(column, times[nearest] + np.array([-1e-6, 1e-6]))
        rows = _rows_of(self.actors.slice(int(first), int(last - first)))
        if not self.parked.num_rows:
            return rows
        standing = self._standing.copy()
        standing["time_s"] = times[nearest]
        both = np.concatenate([rows, standing])
        return both[np.argsort(both["track"], kind="stable")]

    @cached_property
    def _standing(self) -> NDArray[np.void]:
        return _rows_of(self.parked)

    @property
    def _time(self) -> NDArray[np.float64]:
        return np.asarray(self.actors["time_s"].to_numpy())

    def sha256(self) -> str:
        """Return a hash of everything that the motion holds, in hexadecimal."""
        digest = hashlib.sha256(json.dumps(self.manifest, sort_keys=True).encode())
        for table in (self.actors, self.signals, self.parked):
            stream = pa.BufferOutputStream()
            _write_table(table, stream)
            digest.update(stream.getvalue())
        for key, mesh in sorted(self.meshes.items()):
            digest.update(repr(key).encode())
            for name in MESH_FORM:
                digest.update(np.ascontiguousarray(getattr(mesh, name)).tobytes())
        return digest.hexdigest()

    def mesh(self, asset: str, phase: int) -> LabelledMesh:
        """Return the mesh of an asset in a phase: of the motion's own bodies, else the catalogue's.

        Raises:
            InputError: neither has it.
        """
        return mesh_among(self.meshes, asset, phase, asset_mesh)

    def with_meshes(self, tell: Progress = untold) -> Motion:
        """Return the motion with the mesh of every body and phase that its actors show.

        Args:
            tell: called with the fraction done (0..1) and what is being done.
        """
        both = pa.concat_tables(
            [one.select(["asset", "phase"]) for one in (self.actors, self.parked)]
        )
        shown = both.group_by(["asset", "phase"]).aggregate([])
        pairs = zip(shown["asset"].to_pylist(), shown["phase"].to_pylist(), strict=True)
        keys = {(AssetName.of(asset).unsized, phase) for asset, phase in pairs}
        # Phase 0 sizes the others.
        keys |= {(asset, 0) for asset, _ in keys}
        meshes = {key: self.mesh(*key) for key in each(sorted(keys), tell, "meshes of the actors")}
        return replace(self, meshes=meshes)

    def save(self, folder: Path) -> None:
        """Write the folder, whole or not at all; the same motion gives the same bytes.

        Raises:
            InputError: the folder holds something else.
        """
        with replaced_folder(folder, kind="motion") as scratch:
            self.write(scratch)

    def write(self, folder: Path) -> None:
        """Write the files of a motion into a folder that is there."""
        _write_table(self.actors, folder / "actors.parquet")
        _write_table(self.signals, folder / "signals.parquet")
        if self.parked.num_rows:
            _write_table(self.parked, folder / _PARKED)
        _write_meshes(folder / "meshes.npz", self.meshes)
        write_json(folder / "motion.json", self.manifest)

    @classmethod
    def load(cls, folder: Path) -> Motion:
        """Read what ``save`` wrote.

        Raises:
            InputError: the folder is missing, holds something else, is damaged, or is of another
                version.
        """
        path = folder / "motion.json"
        manifest = read_json(path, kind="motion")
        if manifest.get("kind") != "motion":
            raise InputError("is not a motion's manifest", file=path, expected='"kind": "motion"')
        if manifest.get("version") != MOTION_VERSION:
            raise InputError(
                f"is of version {str(manifest.get('version'))[:40]}",
                file=path,
                place="version",
                expected=str(MOTION_VERSION),
            )
        told = validated(manifest, MotionManifest, file=path, expected="a motion's manifest")
        motion = cls(
            manifest,
            read_parquet(folder / "actors.parquet", _TABLE, schema=ACTOR_SCHEMA),
            read_parquet(folder / "signals.parquet", _TABLE, schema=SIGNAL_SCHEMA),
            read_meshes(folder / "meshes.npz"),
            **_read_parked(folder / _PARKED),
        )
        check_motion(motion.actors, motion.signals, told.steps * told.step_s, folder)
        if motion.parked.num_rows:
            check_actors(motion.parked, folder / _PARKED)
        return motion


def step_times(steps: int, step_s: float) -> NDArray[np.float64]:
    """Return the times (steps,) of a motion, free of the dust of binary fractions."""
    return np.round(np.arange(steps) * step_s, 9)


def describe(folder: Path) -> dict[str, Any]:
    """Return a summary of a motion folder, for ``urbantwin inspect``.

    Raises:
        InputError: it is not a motion.
    """
    motion = Motion.load(folder)
    file = folder / "motion.json"
    validated(motion.manifest, MotionReport, file=file, expected="a motion's manifest")
    tracks = motion.actors.select(["track", "class"]).group_by(["track", "class"]).aggregate([])
    counts = Counter(tracks["class"].to_pylist())
    return {
        "kind": "motion",
        "version": motion.manifest["version"],
        "seed": motion.manifest["seed"],
        "steps": motion.manifest["steps"],
        "step_s": motion.step_s,
        "duration_s": motion.manifest["duration_s"],
        "actors": {name: counts[name] for name in sorted(counts)},
        "parked": motion.parked.num_rows,
        "poses": motion.actors.num_rows,
        "signal_links": len(
            motion.signals.select(["signal", "link"]).group_by(["signal", "link"]).aggregate([])
        ),
        "left_out": motion.manifest["left_out"],
        "teleports": motion.manifest["teleports"],
        "collisions": motion.manifest["collisions"],
    }


def _rows_of(table: pa.Table) -> NDArray[np.void]:
    """Return a table of actors as a structured array."""
    rows = np.empty(table.num_rows, _ROW)
    for kind in ACTOR_SCHEMA:
        column = table[kind.name]
        text = pa.types.is_string(kind.type)
        rows[kind.name] = column.to_pylist() if text else column.to_numpy()
    return rows


def _read_parked(path: Path) -> dict[str, pa.Table]:
    """Read the parked vehicles of a motion that has any."""
    if not path.exists():
        return {}
    return {"parked": read_parquet(path, _TABLE, schema=ACTOR_SCHEMA)}


def _write_meshes(path: Path, meshes: Mapping[MeshKey, LabelledMesh]) -> None:
    np.savez_compressed(
        path,
        allow_pickle=False,
        **{
            f"{asset}/{phase}/{name}": getattr(mesh, name)
            for (asset, phase), mesh in sorted(meshes.items())
            for name in MESH_FORM
        },
    )


def _write_table(table: pa.Table, to: Path | pa.NativeFile) -> None:
    """Write a table as Parquet, group of rows by group; the same rows give the same bytes."""
    with pq.ParquetWriter(to, table.schema, compression="zstd") as writer:
        for first in range(0, max(table.num_rows, 1), _GROUP):
            writer.write_table(table.slice(first, _GROUP).combine_chunks())
