"""Compact exact fingerprint of a motion, and differences between two."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
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

__all__ = ["MotionPrint", "changes_between"]

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
#: Odd multiplier for hashing to 64 bits (golden ratio; Knuth, TAOCP 3, 6.4).
_SPREADS = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, eq=False)
class MotionPrint:
    """A motion's positions to a millimetre, a hash of each row, and its events.

    Attributes:
        rows: a row per actor and step, sorted by step, then track: ``step``, ``track``, ``class``,
            ``x_mm``, ``y_mm``, and a 32-bit hash of all columns of the motion's row.
        told: ``step_s``, ``events`` and the SHA-256 of ``actors``, ``signals``, ``parked`` and
            ``meshes``.
    """

    rows: pa.Table
    told: dict[str, Any]

    @classmethod
    def of(cls, motion: Motion) -> MotionPrint:
        """Return the fingerprint of a motion."""
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
    """Return a hash (N,) of all bits of each row's values."""
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


def changes_between(before: MotionPrint, after: MotionPrint) -> dict[str, Any]:
    """Return the differences of two motions; empty without any.

    Keys, present only if applicable: ``from_s``, the first step at which an actor differs;
    ``first``, that actor (``track``, ``class``, ``change``); ``actors``, a row for each that is
    ``moved`` (``most_m``: largest distance), ``turned`` (same position to a millimetre, other pose
    or mesh), ``added``, ``gone`` or ``there for another time``, sorted by time; ``events``, a row
    for each changed value of an event; and ``also``, other differences.
    """
    found: dict[str, Any] = {}
    rows = _actors(before, after)
    if rows:
        first = rows[0]
        found["from_s"] = first["from_s"]
        found["first"] = {key: first[key] for key in ("track", "class", "change")}
        found["actors"] = rows
    events = list(_events(before.told["events"], after.told["events"]))
    if events:
        found["events"] = events
    also = [
        name
        for name in ("step_s", "signals", "parked", "meshes")
        if before.told[name] != after.told[name]
    ]
    if also:
        found["also"] = also
    return found


def _actors(before: MotionPrint, after: MotionPrint) -> list[dict[str, Any]]:
    """Return a row for each track that differs, sorted by time."""
    if before.told["actors"] == after.told["actors"]:
        return []
    step_s = float(after.told["step_s"])
    keys, columns = [], []
    for one in (before, after):
        table = {name: one.rows[name].to_numpy() for name in ("step", "track", "x_mm", "y_mm")}
        table |= {"hash": one.rows["hash"].to_numpy()}
        keys.append(table["step"].astype(np.int64) << 32 | table["track"].astype(np.int64))
        columns.append(table)
    both, here, there = np.intersect1d(*keys, return_indices=True)
    differs = columns[0]["hash"][here] != columns[1]["hash"][there]
    apart = np.hypot(
        *(
            (columns[1][axis][there].astype(float) - columns[0][axis][here]) / 1000
            for axis in ("x_mm", "y_mm")
        )
    )
    only = [np.setdiff1d(one, both) for one in keys]
    kinds = _classes(before) | _classes(after)
    tracks = [np.unique(one["track"]) for one in columns]
    of_both = (both & 0xFFFFFFFF).astype(np.int64)
    concerned = np.unique(np.concatenate([of_both[differs], *(one & 0xFFFFFFFF for one in only)]))
    rows = []
    for track in concerned.tolist():
        mine = (of_both == track) & differs
        alone = np.concatenate([one[(one & 0xFFFFFFFF) == track] for one in only])
        steps = np.concatenate([both[mine], alone]) >> 32
        most_m = float(apart[mine].max(initial=0.0))
        row: dict[str, Any] = {
            "track": track,
            "class": kinds[track],
            "change": _change(track, tracks, most_m, len(alone) > 0),
            "from_s": round(float(steps.min()) * step_s, 3),
        }
        if most_m > 0:
            row["most_m"] = round(most_m, 3)
        rows.append(row)
    return sorted(rows, key=lambda row: (row["from_s"], row["track"]))


def _change(track: int, tracks: list[NDArray[Any]], most_m: float, alone: bool) -> str:
    if track not in tracks[0]:
        return "added"
    if track not in tracks[1]:
        return "gone"
    if most_m > 0:
        return "moved"
    return "there for another time" if alone else "turned"


def _classes(one: MotionPrint) -> dict[int, str]:
    return dict(zip(one.rows["track"].to_pylist(), one.rows["class"].to_pylist(), strict=True))


def _events(before: list[Any], after: list[Any]) -> Iterator[dict[str, Any]]:
    """Yield the values of events that differ."""
    for number in range(max(len(before), len(after))):
        rows = [told[number] if number < len(told) else {} for told in (before, after)]
        name = str(next(row["event"] for row in rows if row))
        one, other = (dict(_flat(row)) for row in rows)
        for field in sorted({*one, *other}):
            if one.get(field) != other.get(field):
                yield {
                    "number": number + 1,
                    "event": name,
                    "field": field,
                    "before": one.get(field),
                    "after": other.get(field),
                }


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - JSON
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    else:
        yield name, value
