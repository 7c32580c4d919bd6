"""Proof that two recordings differ in one factor: their manifests, seeds and actors compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from urbantwin.traffic import Motion
from urbantwin.traffic.motion import ACTOR_SCHEMA

__all__ = ["Proof", "proof_of"]

#: What of a dataset's manifest says how it was made; the rest is what came out.
_RECIPE = ("made_from", "seeds", "urbantwin", "python", "dependencies", "backend", "scene_sha256")
#: What of the recipe is a result of the traffic that was asked for.
_RESULTS = ("made_from.motion.made.",)


@dataclass(frozen=True)
class Proof:
    """How two recordings differ.

    Attributes:
        changed: fields of how they were made: name, value before, value after.
        same_streams: whether every seed is the same: each random choice of a frame is drawn from
            the seed, the frame's number, the sensor and what it is for.
        identical: how many actors have the same poses at every step.
        changed_actors: tracks whose poses differ.
        added: tracks that only the second has.
        removed: tracks that only the first has.
        differ_from_s: when the first actor's pose differs, or one is added or gone, seconds of the
            motion; ``None`` where none does.
    """

    changed: tuple[tuple[str, Any, Any], ...]
    same_streams: bool
    identical: int
    changed_actors: tuple[int, ...]
    added: tuple[int, ...]
    removed: tuple[int, ...]
    differ_from_s: float | None = None

    @property
    def one_factor(self) -> bool:
        """Whether one field alone of what was asked for differs."""
        return len({name for name, _, _ in self.changed}) == 1 and self.same_streams

    def told(self) -> dict[str, Any]:
        """Return it for a manifest."""
        return {
            "one_factor": self.one_factor,
            "changed": [
                {"field": name, "before": before, "after": after}
                for name, before, after in self.changed
            ],
            "same_random_streams": self.same_streams,
            "actors": {
                "identical": self.identical,
                "changed": list(self.changed_actors),
                "added": list(self.added),
                "removed": list(self.removed),
                "differ_from_s": self.differ_from_s,
            },
        }


def proof_of(
    first: Mapping[str, Any], second: Mapping[str, Any], before: Motion, after: Motion
) -> Proof:
    """Compare two recordings.

    Args:
        first: manifest of the dataset without the change.
        second: of the one with it.
        before: the motion that the first shows.
        after: that the second shows.
    """
    one, other = (
        dict(_flat({key: manifest.get(key) for key in _RECIPE})) for manifest in (first, second)
    )
    changed = tuple(
        (name, one.get(name), other.get(name))
        for name in sorted({*one, *other})
        if one.get(name) != other.get(name) and not name.startswith(_RESULTS)
    )
    same, differ, added, removed, from_s = _actors(before, after)
    seeds = first.get("seeds") == second.get("seeds")
    return Proof(changed, seeds, same, differ, added, removed, from_s)


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - JSON
    """Yield what is in mappings and lists by its full name; a scenario counts as one value."""
    if name.endswith(".scenario"):
        yield name, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for number, item in enumerate(value):
            yield from _flat(item, f"{name}[{number}]")
    else:
        yield name, value


def _actors(
    before: Motion, after: Motion
) -> tuple[int, tuple[int, ...], tuple[int, ...], tuple[int, ...], float | None]:
    """Return how many tracks are the same to the bit, which differ, are new, are gone, and when."""
    found = []
    for motion in (before, after):
        table = motion.actors
        order = np.lexsort([table["time_s"].to_numpy(), table["track"].to_numpy()])
        rows = table.take(order).combine_chunks()
        tracks = rows["track"].to_numpy()
        starts = np.flatnonzero(np.diff(tracks, prepend=-1))
        ends = np.append(starts[1:], len(tracks))
        found.append(
            {
                int(tracks[a]): rows.slice(int(a), int(b - a))
                for a, b in zip(starts, ends, strict=True)
            }
        )
    one, other = found
    names = [field.name for field in ACTOR_SCHEMA]
    both = sorted(set(one) & set(other))
    differ = tuple(
        track for track in both if not one[track].select(names).equals(other[track].select(names))
    )
    added, removed = sorted(set(other) - set(one)), sorted(set(one) - set(other))
    times = [float(rows["time_s"][0].as_py()) for track in added for rows in [other[track]]]
    times += [float(one[track]["time_s"][0].as_py()) for track in removed]
    times += [_first_difference(one[track], other[track], names) for track in differ]
    from_s = min(times, default=None)
    return len(both) - len(differ), differ, tuple(added), tuple(removed), from_s


def _first_difference(one: pa.Table, other: pa.Table, names: list[str]) -> float:
    """Return the first time at which two tables of a track differ, seconds."""
    rows, others = (table.select(names).to_pylist() for table in (one, other))
    for row, its in zip(rows, others, strict=False):
        if row != its:
            return float(min(row["time_s"], its["time_s"]))
    longer = rows if len(rows) > len(others) else others
    return float(longer[min(len(rows), len(others))]["time_s"])
