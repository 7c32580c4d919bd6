"""Proof that two recordings differ in one factor: their manifests, seeds and actors compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from urbantwin.experiments.suite.motion_print import MotionPrint, changes_between
from urbantwin.traffic import Motion

__all__ = ["proof_of"]

#: Fields of a dataset's manifest that describe its inputs; the others are results.
_RECIPE = ("made_from", "seeds", "urbantwin", "python", "dependencies", "backend", "scene_sha256")
#: Fields of the inputs that are a result of the requested traffic.
_RESULTS = ("made_from.motion.made.",)


def proof_of(
    first: Mapping[str, Any], second: Mapping[str, Any], before: Motion, after: Motion
) -> dict[str, Any]:
    """Compare two recordings; the result is part of ``variation.json``.

    Args:
        first: manifest of the dataset without the change.
        second: manifest of the dataset with the change.
        before: motion of the first dataset.
        after: motion of the second dataset.

    Returns:
        ``one_factor``: whether only one requested field differs.
        ``changed``: fields of the inputs that differ, with their values before and after.
        ``same_random_streams``: whether every seed is the same. Each random choice of a frame
        depends on the seed, the frame number, the sensor and the purpose of the choice.
        ``actors``: the number of actors with ``identical`` poses at every step, tracks with
        ``changed`` poses, tracks ``added`` and ``removed``, and ``differ_from_s``, the time of the
        first difference, seconds; ``None`` if there is none.
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
    if rows:  # sorted by the time of the first difference
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
    """Yield values in mappings and lists with full names; a scenario counts as one value."""
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
