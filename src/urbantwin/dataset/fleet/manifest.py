"""``fleet.json``: which nodes a fleet has, what is wrong with their clocks, poses and radio."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import as_json, sha256_of
from urbantwin.dataset.fleet.node import Node
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.reading.fleet_manifest import KIND
from urbantwin.result_warning import ResultWarning, rows_of

__all__ = ["FORMAT", "TABLES", "manifest_of_fleet"]

#: Changes when the meaning of a fleet's files does.
FORMAT = 1
TABLES = ("boxes.parquet", "nodes.parquet")
#: Of the recipe of its nodes, what all have in common.
_SHARED = (
    *("urbantwin", "python", "platform", "dependencies", "backend", "storage", "anchor"),
    *("region_m", "scene_sha256", "surface_sha256", "motion_sha256", "meshes_sha256", "about"),
)
_LAYOUT = {
    "boxes": "boxes.parquet: one row per frame and actor: its box in the site at the frame's time, "
    "and how each node sees it",
    "nodes": "nodes.parquet: one row per frame and node: pose, clock, and when the others have it",
    "NODE": "NODE/: a dataset for each node, with the frames in which it is there",
}


def manifest_of_fleet(
    folder: Path,
    recipe: Mapping[str, Any],
    nodes: Sequence[Node],
    times_s: Mapping[int, float],
    rows: Mapping[str, Mapping[int, Mapping[str, Any]]],
    inputs: Sequence[Mapping[str, Any]],
    seeds: Mapping[str, int],
) -> dict[str, Any]:
    """Return what ``fleet.json`` holds.

    Args:
        folder: of the fleet, with all its tables and datasets.
        recipe: of one of its nodes, see `dataset.manifest.recipe_of`.
        nodes: all of them.
        times_s: number of each frame of the run -> its time.
        rows: name of each node -> number of each of its frames -> its row of the table.
        inputs: of all nodes.
        seeds: of the run and of the traffic.
    """
    return {
        "kind": KIND,
        "format": FORMAT,
        **{key: recipe[key] for key in _SHARED},
        "seeds": dict(seeds),
        "rate_hz": nodes[0].rig.rate_hz,
        "boxes": nodes[0].rig.boxes,
        "inputs": list(inputs),
        "layout": _LAYOUT,
        "nodes": [_told(folder, node, times_s, rows[node.name]) for node in nodes],
        "tables_sha256": {name: sha256_of(folder / name) for name in TABLES},
        "warnings": rows_of(_warnings(nodes, times_s, rows)),
        "frames": [{"name": frame_name(k), "time_s": time_s} for k, time_s in times_s.items()],
    }


def _told(
    folder: Path,
    node: Node,
    times_s: Mapping[int, float],
    rows: Mapping[int, Mapping[str, Any]],
) -> dict[str, Any]:
    """Return what is said of a node."""
    return {
        "name": node.name,
        "rides": node.rig.ride is not None,
        "carrier": node.rig.carrier,
        "there_s": None if node.spans_s is None else [list(one) for one in node.spans_s],
        "sensors": [{"name": one.name, "model": one.sensor.name} for one in node.rig.sensors],
        "seed": node.seed,
        **{key: as_json(getattr(node.spec, key)) for key in ("clock", "pose_error", "radio")},
        "frames": len(rows),
        "frames_absent": len(times_s) - len(rows),
        "frames_lost": sum(row["lost"] for row in rows.values()),
        "points": sum(row["points"] for row in rows.values()),
        "dataset_sha256": sha256_of(folder / node.name / "dataset.json"),
    }


def _warnings(
    nodes: Sequence[Node],
    times_s: Mapping[int, float],
    rows: Mapping[str, Mapping[int, Mapping[str, Any]]],
) -> Iterator[ResultWarning]:
    for node in nodes:
        own = rows[node.name]
        if len(own) < len(times_s) and node.spans_s is not None:
            spans = " and ".join(f"{on:.9g} to {off:.9g} s" for on, off in node.spans_s)
            yield ResultWarning(
                f"node {node.name}",
                f"absent in {len(times_s) - len(own)} of {len(times_s)} frames",
                f"track {node.rig.carrier}, which carries it, is there from {spans}",
                "--start and --stop within that, or another carrier",
            )
        if own and all(row["lost"] for row in own.values()):
            yield ResultWarning(
                f"node {node.name}", "none of its frames arrives", "radio: loss or outages"
            )
