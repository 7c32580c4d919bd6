"""Proof that two recordings differ in one factor: their manifests, seeds and actors compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from urbantwin.experiments.suite.motion_print import MotionPrint, changes_between
from urbantwin.traffic import Motion

__all__ = ["proof_of"]

#: What of a dataset's manifest says how it was made; the rest is what came out.
_RECIPE = ("made_from", "seeds", "urbantwin", "python", "dependencies", "backend", "scene_sha256")
#: What of the recipe is a result of the traffic that was asked for.
_RESULTS = ("made_from.motion.made.",)


def proof_of(
    first: Mapping[str, Any], second: Mapping[str, Any], before: Motion, after: Motion
) -> dict[str, Any]:
    """Compare two recordings, as ``variation.json`` keeps it.

    Args:
        first: manifest of the dataset without the change.
        second: of the one with it.
        before: the motion that the first shows.
        after: that the second shows.

    Returns:
        ``one_factor``: whether one field alone of what was asked for differs; ``changed``: fields
        of how they were made, with their values before and after; ``same_random_streams``: whether
        every seed is the same (each random choice of a frame is drawn from the seed, the frame's
        number, the sensor and what it is for); ``actors``: the number with the ``identical`` poses
        at every step, tracks whose poses are ``changed``, ``added`` and ``removed``, and the time
        from which on anything differs, ``differ_from_s``, seconds; ``None`` where nothing does.
    """
    one, other = (
        dict(_flat({key: manifest.get(key) for key in _RECIPE})) for manifest in (first, second)
    )
    changed = [
        {"field": name, "before": one.get(name), "after": other.get(name)}
        for name in sorted({*one, *other})
        if one.get(name) != other.get(name) and not name.startswith(_RESULTS)
    ]
    rows = changes_between(MotionPrint.of(before), MotionPrint.of(after)).get("actors", [])
    tracks: dict[str, list[int]] = {"changed": [], "added": [], "gone": []}
    for row in sorted(rows, key=lambda row: int(row["track"])):
        tracks[row["change"] if row["change"] in tracks else "changed"].append(row["track"])
    from_s = None
    if rows:  # the first that differs comes first
        longer = max(before, after, key=lambda motion: len(motion.times()))
        from_s = float(longer.times()[round(rows[0]["from_s"] / longer.step_s)])
    count = len(np.unique(before.rows["track"].to_numpy()))
    same_streams = first.get("seeds") == second.get("seeds")
    return {
        "one_factor": len(changed) == 1 and same_streams,
        "changed": changed,
        "same_random_streams": same_streams,
        "actors": {
            "identical": count - len(tracks["changed"]) - len(tracks["gone"]),
            "changed": tracks["changed"],
            "added": tracks["added"],
            "removed": tracks["gone"],
            "differ_from_s": from_s,
        },
    }


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
