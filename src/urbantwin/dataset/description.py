"""What a dataset holds, in a few lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from urbantwin.artefact import read_json
from urbantwin.errors import InputError

__all__ = ["describe", "parts_of"]


def parts_of(path: Path) -> list[Path]:
    """Return the folders of the datasets in a folder: itself, or one for each sensor.

    Raises:
        InputError: there is no dataset.
    """
    manifest = read_json(path / "dataset.json", kind="dataset")
    if manifest.get("kind") != "datasets":
        return [path]
    # The names of folders in it, and no way out of it.
    return [path / Path(str(name)).name for name in manifest.get("datasets", [])]


def describe(path: Path) -> dict[str, Any]:
    """Return what a dataset holds, as can stand in JSON.

    Raises:
        InputError: there is no dataset, or its manifest lacks something.
    """
    manifest = read_json(path / "dataset.json", kind="dataset")
    if manifest.get("kind") == "datasets":
        return {
            "kind": "datasets",
            "datasets": {part.name: describe(part) for part in parts_of(path)},
        }
    try:
        counts = manifest["counts"]
        times = [frame["time_s"] for frame in manifest["frames"]]
        return {
            "kind": "dataset",
            "made_with": f"urbantwin {manifest['urbantwin']}",
            "frames": counts["frames"],
            "time_s": f"{times[0]:g} to {times[-1]:g}",
            "rate_hz": manifest["rig"]["rate_hz"],
            "frame_of_points": manifest["frame"],
            "train": counts["train"],
            "val": counts["val"],
            "sensors": [
                {key: one[key] for key in ("name", "model", "columns")}
                for one in manifest["rig"]["sensors"]
            ],
            "seeds": manifest["seeds"],
            "points": counts["points"],
            "points_per_frame": round(counts["points"] / counts["frames"]),
            "points_by_class": counts["points_by_class"],
            "boxes": counts["boxes"],
            "boxes_with_points": counts["boxes_with_points"],
            "point_cloud_range": manifest["point_cloud_range"],
            "inputs": [
                {key: one[key] for key in ("name", "licence", "attribution") if key in one}
                for one in manifest["inputs"]
            ],
        }
    except (KeyError, IndexError, TypeError) as error:
        raise InputError(
            f"lacks {error}", file=path / "dataset.json", expected="a dataset's manifest"
        ) from None
