"""Summary of a dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.errors import InputError

__all__ = ["describe", "parts_of"]


def parts_of(path: Path) -> list[Path]:
    """Return the folders of the datasets in a folder: itself, or one per sensor.

    Raises:
        InputError: no dataset.
    """
    manifest = read_manifest(path)
    if manifest["kind"] != "datasets":
        return [path]
    return [path / name for name in manifest["datasets"]]


def describe(path: Path) -> dict[str, Any]:
    """Return a summary of a dataset, for JSON.

    Raises:
        InputError: no dataset, or its manifest is incomplete.
    """
    manifest = read_manifest(path)
    if manifest["kind"] == "datasets":
        parts = parts_of(path)
        if any(read_manifest(part)["kind"] == "datasets" for part in parts):
            raise InputError(
                "names a folder of datasets", file=path / "dataset.json", expected="datasets"
            )
        return {"kind": "datasets", "datasets": {part.name: describe(part) for part in parts}}
    counts = manifest["counts"]
    times = [frame["time_s"] for frame in manifest["frames"]]
    return {
        "kind": "dataset",
        "made_with": f"urbantwin {manifest['urbantwin']}",
        "frames": counts["frames"],
        "storage": manifest.get("storage", "npy"),
        "time_s": f"{times[0]:g} to {times[-1]:g}",
        "rate_hz": manifest["rig"]["rate_hz"],
        "frame_of_points": manifest["frame"],
        "train": counts["train"],
        "val": counts["val"],
        "test": counts.get("test", 0),
        "sensors": [
            {key: entry[key] for key in ("name", "model", "columns")}
            for entry in manifest["rig"]["sensors"]
        ],
        "seeds": manifest["seeds"],
        "points": counts["points"],
        "points_per_frame": round(counts["points"] / counts["frames"]),
        "points_by_class": counts["points_by_class"],
        "boxes": counts["boxes"],
        "boxes_with_points": counts["boxes_with_points"],
        "point_cloud_range": manifest["point_cloud_range"],
        "inputs": [
            {key: entry[key] for key in ("name", "licence", "attribution") if key in entry}
            for entry in manifest["inputs"]
        ],
    }
