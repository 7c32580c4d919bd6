"""Motion: the pose of every actor at every step, and the states of the signals."""

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
from urbantwin.traffic.motion_rows import (
    ACTOR_SCHEMA,
    ActorRows,
    as_rows,
    read_rows,
    write_rows,
)
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

#: Number of steps read together, since they are usually requested in sequence.
_STEPS_AT_ONCE = 16

_TABLE_NAME, _PARKED_FILE = "a table of the motion", "parked.parquet"

_ROW = np.dtype(
    [
        (kind.name, object if pa.types.is_string(kind.type) else kind.type.to_pandas_dtype())
        for kind in ACTOR_SCHEMA
    ]
)


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of all actors in a twin.

    Attributes:
        manifest: ``motion.json``: seed, step, duration, counts per class, teleports, collisions.
        rows: ``actors.parquet``, columns of ``ACTOR_SCHEMA``, sorted by time, then track: a table,
            or the `ActorRows` of a file, of which a long motion reads a part at a time.
        signals: ``signals.parquet``, columns of ``signals.SIGNAL_SCHEMA``.
        meshes: ``meshes.npz``: mesh of each asset and phase that the actors use. Stored with the
            motion, they keep it independent of later changes of the catalogue and spare making them
            again.
        parked: ``parked.parquet``, the same columns, one row for each parked vehicle, which is
            there at every step.
    """

    manifest: dict[str, Any]
    rows: ActorRows
    signals: pa.Table
    meshes: Mapping[MeshKey, LabelledMesh] = field(default_factory=dict)
    parked: pa.Table = field(default_factory=ACTOR_SCHEMA.empty_table, kw_only=True)

    def __post_init__(self) -> None:
        """Accept a table as rows."""
        object.__setattr__(self, "rows", as_rows(self.rows))

    @cached_property
    def actors(self) -> pa.Table:
        """All rows as one table: half a gigabyte for an hour with a hundred actors."""
        return self.rows.table()

    @property
    def step_s(self) -> float:
        """Time between steps, seconds."""
        return float(self.manifest["step_s"])

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """The warnings of its manifest."""
        return warnings_of(self.manifest)

    def times(self) -> NDArray[np.float64]:
        """Return the times (T,) of all steps, seconds, including steps without actors."""
        return self._times.copy()

    @cached_property
    def _times(self) -> NDArray[np.float64]:
        return step_times(int(self.manifest["steps"]), self.step_s)

    def at(self, time_s: float) -> NDArray[np.void]:
        """Return the actors of one step: a structured array with the fields of ``ACTOR_SCHEMA``.

        Text fields hold ``str`` objects. The rows are sorted by track.

        Raises:
            InputError: the motion has no step at that time.
        """
        times = self._times
        nearest = int(np.abs(times - time_s).argmin())
        if abs(float(times[nearest]) - time_s) > 1e-6:
            raise InputError(
                f"the motion has no step at {time_s:g} s",
                expected=f"a multiple of {self.step_s:g} s from 0 to {float(times[-1]):g} s",
            )
        rows = self._moving(nearest)
        if not self.parked.num_rows:
            return rows
        standing = self._standing.copy()
        standing["time_s"] = times[nearest]
        both = np.concatenate([rows, standing])
        return both[np.argsort(both["track"], kind="stable")]

    def _moving(self, step: int) -> NDArray[np.void]:
        """Return the rows of a step without those of parked vehicles."""
        first = step - step % _STEPS_AT_ONCE
        margin = np.array([-1e-6, 1e-6])
        read = self._read.get(first)
        if read is None:
            times = self._times[first : first + _STEPS_AT_ONCE]
            read = _structured(self.rows.between(*(times[[0, -1]] + margin).tolist()))
            self._read.clear()
            self._read[first] = read
        return read[slice(*read["time_s"].searchsorted(self._times[step] + margin))].copy()

    @cached_property
    def _read(self) -> dict[int, NDArray[np.void]]:
        """The steps read last, by the number of the first."""
        return {}

    @cached_property
    def _standing(self) -> NDArray[np.void]:
        return _structured(self.parked)

    def sha256(self) -> str:
        """Return the SHA-256 of all contents of the motion, in hexadecimal."""
        digest = hashlib.sha256(json.dumps(self.manifest, sort_keys=True).encode())
        stream = pa.BufferOutputStream()
        self.rows.write(stream)
        digest.update(stream.getvalue())
        for table in (self.signals, self.parked):
            stream = pa.BufferOutputStream()
            write_rows([table], stream, table.schema)
            digest.update(stream.getvalue())
        for key, mesh in sorted(self.meshes.items()):
            digest.update(repr(key).encode())
            for name in MESH_FORM:
                digest.update(np.ascontiguousarray(getattr(mesh, name)).tobytes())
        return digest.hexdigest()

    def mesh(self, asset: str, phase: int) -> LabelledMesh:
        """Return the mesh of an asset in a phase: that of the motion, else that of the catalogue.

        Raises:
            InputError: neither has it.
        """
        return mesh_among(self.meshes, asset, phase, asset_mesh)

    def with_meshes(self, tell: Progress = untold) -> Motion:
        """Return the motion with the mesh of every asset and phase that its actors use.

        Args:
            tell: called with the fraction done (0..1) and what is being done.
        """
        keys = set()
        for rows in (self.rows, as_rows(self.parked)):
            shown = rows.distinct(["asset", "phase"])
            pairs = zip(shown["asset"].to_pylist(), shown["phase"].to_pylist(), strict=True)
            keys |= {(AssetName.of(asset).unsized, phase) for asset, phase in pairs}
        # Meshes of other phases are scaled by the size of phase 0.
        keys |= {(asset, 0) for asset, _ in keys}
        meshes = {key: self.mesh(*key) for key in each(sorted(keys), tell, "meshes of the actors")}
        return replace(self, meshes=meshes)

    def save(self, folder: Path) -> None:
        """Write the folder atomically; the same motion gives the same bytes.

        Raises:
            InputError: the folder holds something else.
        """
        with replaced_folder(folder, kind="motion") as scratch:
            self.write(scratch)

    def write(self, folder: Path) -> None:
        """Write the files of a motion into an existing folder."""
        self.rows.write(folder / "actors.parquet")
        write_rows([self.signals], folder / "signals.parquet", SIGNAL_SCHEMA)
        if self.parked.num_rows:
            write_rows([self.parked], folder / _PARKED_FILE)
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
        checked = validated(manifest, MotionManifest, file=path, expected="a motion's manifest")
        motion = cls(
            manifest,
            read_rows(folder / "actors.parquet"),
            read_parquet(folder / "signals.parquet", _TABLE_NAME, schema=SIGNAL_SCHEMA),
            read_meshes(folder / "meshes.npz"),
            **_read_parked(folder / _PARKED_FILE),
        )
        check_motion(motion.rows, motion.signals, checked.steps * checked.step_s, folder)
        if motion.parked.num_rows:
            check_actors(motion.parked, folder / _PARKED_FILE)
        return motion


def step_times(steps: int, step_s: float) -> NDArray[np.float64]:
    """Return the times (steps,) of a motion, seconds, rounded to nanoseconds."""
    return np.round(np.arange(steps) * step_s, 9)


def describe(folder: Path) -> dict[str, Any]:
    """Return a summary of a motion folder, for ``urbantwin info``.

    Raises:
        InputError: it is not a motion.
    """
    motion = Motion.load(folder)
    file = folder / "motion.json"
    validated(motion.manifest, MotionReport, file=file, expected="a motion's manifest")
    counts = Counter(motion.rows.distinct(["track", "class"])["class"].to_pylist())
    return {
        "kind": "motion",
        "version": motion.manifest["version"],
        "seed": motion.manifest["seed"],
        "steps": motion.manifest["steps"],
        "step_s": motion.step_s,
        "duration_s": motion.manifest["duration_s"],
        "actors": {name: counts[name] for name in sorted(counts)},
        "parked": motion.parked.num_rows,
        "poses": motion.rows.num_rows,
        "signal_links": len(
            motion.signals.select(["signal", "link"]).group_by(["signal", "link"]).aggregate([])
        ),
        "left_out": motion.manifest["left_out"],
        "teleports": motion.manifest["teleports"],
        "collisions": motion.manifest["collisions"],
    }


def _structured(table: pa.Table) -> NDArray[np.void]:
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
    return {"parked": read_parquet(path, _TABLE_NAME, schema=ACTOR_SCHEMA)}


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
