"""Proof that two recordings differ in one factor: their manifests, seeds and actors compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from urbantwin.experiments.suite.changes import changes_between
from urbantwin.experiments.suite.motion_print import MotionPrint
from urbantwin.traffic import Motion

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
    rows = changes_between(MotionPrint.of(before), MotionPrint.of(after)).get("actors", [])
    added, gone, differ = (
        tuple(sorted(row["track"] for row in rows if is_meant(row["change"])))
        for is_meant in (
            lambda change: change == "added",
            lambda change: change == "gone",
            lambda change: change not in ("added", "gone"),
        )
    )
    from_s = None
    if rows:  # the first that differs comes first
        longer = max(before, after, key=lambda motion: len(motion.times()))
        from_s = float(longer.times()[round(rows[0]["from_s"] / longer.step_s)])
    count = len(np.unique(before.rows["track"].to_numpy()))
    return Proof(
        changed,
        first.get("seeds") == second.get("seeds"),
        count - len(differ) - len(gone),
        differ,
        added,
        gone,
        from_s,
    )


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
