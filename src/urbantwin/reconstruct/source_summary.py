"""Summary of the results of the sources of geometry."""

from __future__ import annotations

from collections import Counter
from typing import Any

__all__ = ["outcome"]

#: Maximum number of problems listed; the report has all.
MOST_PROBLEMS = 5


def outcome(report: dict[str, Any]) -> dict[str, Any]:
    """Return by source its placement, the parts removed from it, and its problems.

    Args:
        report: report of a `Reconstruction`.
    """
    found: dict[str, Any] = {}
    for number, source in enumerate(report["sources"], start=1):
        name = source["name"] if source["name"] not in found else f"{source['name']} ({number})"
        found[name] = _of_source(source)
    return found


def _of_source(source: dict[str, Any]) -> dict[str, Any]:
    placed = source["placed"]
    told: dict[str, Any] = {"placing": placed["summary"]}
    for kind in ("mesh", "cloud"):
        cleaned = source.get(kind) or {}
        removed = Counter(piece.get("what", "piece") for piece in cleaned.get("removed", []))
        if removed:
            told[f"removed of its {kind}"] = dict(sorted(removed.items()))
        if cleaned.get("notes"):
            told["overrides without effect"] = cleaned["notes"]
    for key in ("told_apart", "survey"):
        if source.get(key):
            told[key.replace("_", " ")] = source[key]
    problems = source["problems"] + placed.get("problems", [])
    if problems:
        told["problems"] = problems[:MOST_PROBLEMS]
        if len(problems) > MOST_PROBLEMS:
            told["further problems"] = len(problems) - MOST_PROBLEMS
    return told
