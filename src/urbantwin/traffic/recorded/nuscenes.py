"""Tracks as nuScenes has them: its tables of annotations, or a submission to its tracking task."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.artefact.document import read_json_value
from urbantwin.errors import InputError
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.row_list import RowList, yaw_of_quaternion
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["nuscenes_rows"]

_EXPECTED = "nuScenes: sample_annotation.json or a tracking submission, with sample.json beside it"
_US = 1e-6


def nuscenes_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks from ``sample_annotation.json`` or from a tracking submission.

    ``sample.json`` beside it gives the times; without it samples follow each other by ``rate_hz``
    in the file's order. Classes of annotations are those of ``instance.json`` and
    ``category.json``. Sizes are width, length, height, rotations w, x, y, z
    (nuScenes, "Database schema"; "Tracking task", results format).

    Raises:
        InputError: a file is missing, or is none; the entry is named.
    """
    rows = RowList(path, _EXPECTED)
    whole = read_json_value(path, _EXPECTED)
    if isinstance(whole, dict) and isinstance(whole.get("results"), dict):
        items = [
            (f"results.{sample}[{k}]", item, "tracking_id")
            for sample, found in whole["results"].items()
            for k, item in enumerate(found if isinstance(found, list) else [None])
        ]
        kinds: dict[str, str] = {}
    elif isinstance(whole, list):
        items = [(f"[{k}]", item, "instance_token") for k, item in enumerate(whole)]
        kinds = _kinds(path.parent)
    else:
        raise InputError("is neither", file=path, expected=_EXPECTED)
    samples = [str(item.get("sample_token")) for _, item, _ in items if isinstance(item, dict)]
    times = _times(path.parent, samples, spec, rows)
    for place, item, key in items:
        if not isinstance(item, dict):
            raise rows.error(place, "is no annotation")
        for field, count in (("translation", 3), ("size", 3), ("rotation", 4)):
            value = item.get(field)
            if not isinstance(value, list) or len(value) != count:
                raise rows.error(f"{place}.{field}", f"is not {count} numbers")
            if not all(isinstance(one, int | float) for one in value):
                raise rows.error(f"{place}.{field}", "holds something else than numbers")
        sample, track = str(item.get("sample_token")), item.get(key)
        if sample not in times:
            raise rows.error(f"{place}.sample_token", f"{sample[:40]!r} is not in sample.json")
        if track is None:
            raise rows.error(f"{place}.{key}", "is missing")
        kind = item.get("tracking_name") or item.get("category_name") or kinds.get(str(track))
        if kind is None:
            raise rows.error(place, "has no class: instance.json and category.json are not there")
        width, length, height = item["size"]
        yaw = yaw_of_quaternion(*item["rotation"])
        xyz, size = item["translation"], (length, width, height)
        rows.add(place, str(track), times[sample], str(kind), xyz, yaw, size)
    return rows.made()


def _times(folder: Path, samples: list[str], spec: TracksSpec, rows: RowList) -> dict[str, float]:
    """Return sample -> time, seconds."""
    if (folder / "sample.json").is_file():
        found = _table(folder / "sample.json")
        return {token: float(row.get("timestamp", 0)) * _US for token, row in found.items()}
    if spec.rate_hz is None:
        raise rows.error("sample_token", "sample.json is not beside it, and there is no rate_hz")
    return {token: k / spec.rate_hz for k, token in enumerate(dict.fromkeys(samples))}


def _kinds(folder: Path) -> dict[str, str]:
    """Return instance -> name of its category, as far as the tables are there."""
    if not (folder / "instance.json").is_file() or not (folder / "category.json").is_file():
        return {}
    names = {token: str(row.get("name")) for token, row in _table(folder / "category.json").items()}
    return {
        token: names.get(str(row.get("category_token")), "unknown")
        for token, row in _table(folder / "instance.json").items()
    }


def _table(path: Path) -> dict[str, dict[str, Any]]:
    """Return a table of nuScenes by its tokens."""
    whole = read_json_value(path, _EXPECTED)
    if not isinstance(whole, list) or not all(
        isinstance(row, dict) and isinstance(row.get("token"), str) for row in whole
    ):
        raise InputError("is no table of nuScenes", file=path, expected="rows with tokens")
    return {row["token"]: row for row in whole}
