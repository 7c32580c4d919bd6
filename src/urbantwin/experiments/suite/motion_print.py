"""What is kept of a motion to tell later what became different: small, and exact in every bit."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from urbantwin.artefact.tables import read_parquet
from urbantwin.traffic import Motion
from urbantwin.traffic.fingerprint import meshes_sha256, table_sha256
from urbantwin.traffic.motion_rows import ACTOR_SCHEMA, ActorRows

__all__ = ["MotionPrint"]

_SCHEMA = pa.schema(
    [
        ("step", pa.int32()),
        ("track", pa.int32()),
        ("class", pa.string()),
        ("x_mm", pa.int32()),
        ("y_mm", pa.int32()),
        ("hash", pa.uint32()),
    ]
)
#: An odd number whose multiples spread over 64 bits (the golden ratio's, Knuth, TAOCP 3, 6.4).
_SPREADS = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, eq=False)
class MotionPrint:
    """A motion's places to a millimetre, a hash of each row, and what became of its events.

    Attributes:
        rows: a row for each actor and step, sorted by step, then track: ``step``, ``track``,
            ``class``, ``x_mm``, ``y_mm``, and 32 bits that all columns of the motion's row follow
            into.
        told: ``step_s``, ``events`` and the SHA-256 of ``actors``, ``signals``, ``parked`` and
            ``meshes``.
    """

    rows: pa.Table
    told: dict[str, Any]

    @classmethod
    def of(cls, motion: Motion) -> MotionPrint:
        """Return what is kept of a motion."""
        table = motion.rows
        rows = pa.table(
            {
                "step": np.round(table["time_s"].to_numpy() / motion.step_s).astype(np.int32),
                "track": table["track"],
                "class": table["class"],
                "x_mm": np.round(table["x"].to_numpy() * 1000).astype(np.int32),
                "y_mm": np.round(table["y"].to_numpy() * 1000).astype(np.int32),
                "hash": _hashes(table),
            },
            schema=_SCHEMA,
        )
        told = {
            "step_s": motion.step_s,
            "actors": table_sha256(motion.rows),
            "signals": table_sha256(motion.signals),
            "parked": table_sha256(motion.parked),
            "meshes": meshes_sha256(motion.meshes),
            "events": motion.manifest.get("events", []),
        }
        return cls(rows, told)

    def write(self, path: Path) -> None:
        """Write the rows (Parquet)."""
        pq.write_table(self.rows, path, compression="zstd", compression_level=9)

    @classmethod
    def read(cls, path: Path, told: dict[str, Any]) -> MotionPrint:
        """Read the rows that `write` wrote.

        Raises:
            InputError: they are missing or damaged.
        """
        return cls(read_parquet(path, "what was accepted of a motion", schema=_SCHEMA), told)


def _hashes(table: ActorRows) -> NDArray[np.uint32]:
    """Return a hash (N,) of each row's values, of all their bits."""
    mixed = np.zeros(table.num_rows, np.uint64)
    for field in ACTOR_SCHEMA:
        column = table[field.name]
        if pa.types.is_string(field.type):
            coded = column.combine_chunks().dictionary_encode()
            known = [zlib.crc32(str(one).encode()) for one in coded.dictionary.to_pylist()]
            words = np.array([*known, 0], np.uint64)
            bits = words[coded.indices.fill_null(len(known)).to_numpy(zero_copy_only=False)]
        elif pa.types.is_floating(field.type):
            bits = np.ascontiguousarray(column.to_numpy(), np.float64).view(np.uint64)
        else:
            bits = np.asarray(column.to_numpy(), np.int64).view(np.uint64)
        mixed = (mixed ^ bits) * _SPREADS
        mixed ^= mixed >> np.uint64(29)
    return (mixed >> np.uint64(32)).astype(np.uint32)
