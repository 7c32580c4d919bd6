"""Recording of a fleet: fixed and mounted nodes see one motion together."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.artefact import (
    INVENTORY,
    as_json,
    check_folder,
    replaced_folder,
    sha256_of,
    write_inventory,
    write_json,
)
from urbantwin.dataset.card.write import write_cards, write_index
from urbantwin.dataset.dataset_writer import (
    MARKS_FORMAT,
    Recording,
    check_room_for,
    checksums,
    write_datasets,
)
from urbantwin.dataset.fleet.common_boxes import write_common_boxes
from urbantwin.dataset.fleet.node import Node, PlacedRig, placed_nodes
from urbantwin.dataset.fleet.node_table import node_rows, write_nodes
from urbantwin.dataset.frame_place import MARKS, FolderPlace
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.manifest import hashes_of, recipe_key, recipe_of
from urbantwin.dataset.provenance import asked_of
from urbantwin.dataset.reading.manifest import FLEET
from urbantwin.dataset.recording import checked_seed, frame_times
from urbantwin.dataset.split import SplitAsked, check_split
from urbantwin.dataset.workers import Workers
from urbantwin.geometry.rays import library_named
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.progress import Progress, untold
from urbantwin.result_warning import ResultWarning, rows_of
from urbantwin.site.nodes import NodesFile

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["record_fleet"]


#: Version of the meaning of a fleet's files.
FORMAT = 1
TABLES = ("boxes.parquet", "nodes.parquet")
#: Fields of a node's recipe that all nodes share.
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
    """Return the content of ``fleet.json``.

    Args:
        folder: folder of the fleet, with all tables and datasets.
        recipe: recipe of one node, see `dataset.manifest.recipe_of`.
        nodes: all nodes.
        times_s: frame number -> time, of the run.
        rows: name of each node -> number of each of its frames -> its row of the table.
        inputs: inputs of all nodes.
        seeds: seeds of the run and of the traffic.
    """
    return {
        "kind": FLEET,
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
    """Return the description of a node."""
    return {
        "name": node.name,
        "rides": node.rig.ride is not None,
        "carrier": node.rig.carrier,
        "there_s": None if node.spans_s is None else [list(item) for item in node.spans_s],
        "sensors": [{"name": item.name, "model": item.sensor.name} for item in node.rig.sensors],
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


def record_fleet(  # noqa: PLR0913 - every one is a person's choice
    twin: Twin,
    motion: Motion,
    asked: NodesFile,
    rigs: Sequence[PlacedRig],
    out: Path,
    *,
    workers: Workers = None,
    seed: int | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    every: int = 1,
    backend: str | None = None,
    storage: str = "npy",
    split: SplitAsked | None = None,
    inputs: Sequence[Path] = (),
    also: Callable[[Path], None] | None = None,
    progress: Progress | None = None,
) -> None:
    """Record what all nodes see of a motion; the layout is in ``docs/howto/nodes.md``.

    Each node has its own dataset, as `recording.record` makes it with the node's rig and seed, of
    the frames in which it is present. Frames of all nodes have the same names at the same times.
    All datasets are split in time alike: no node is tested on times that another one is trained on.

    Args:
        twin: the twin.
        motion: a motion on it.
        asked: the nodes.
        rigs: the rig of each, placed on the twin.
        out: folder of the fleet; an older fleet there is replaced.
        workers: number of processes, or a cluster; one per processor if not given.
        seed: seed of the run; the site's ``traffic.seed`` if not given.
        start_s: earliest frame.
        stop_s: latest frame; the motion's last step if not given.
        every: record only frames whose number is a multiple of this.
        backend: ray tracer, see `tracer_on`.
        storage: format of points, see `recording.record`.
        split: split into training, validation and test; by default the usual one.
        inputs: files and folders besides the twin that ``out`` must not touch.
        also: called with the folder of the whole fleet before it appears, to add pictures.
        progress: called with the fraction done and a description.

    Raises:
        InputError: as `recording.record`; or incompatible nodes (`placed_nodes`).
        StageError: a worker was killed, or the disk is full.
    """
    seed = checked_seed(twin, motion, seed, workers=workers, storage=storage)
    rate_hz = rigs[0].rig.rate_hz
    times_s = frame_times(rate_hz, start_s, stop_s, motion.times(), every=every)
    asked_split = split or SplitAsked()
    check_split(list(times_s.values()), asked_split)
    nodes = placed_nodes(asked, rigs, motion, times_s, seed)
    backend = backend or library_named()
    tracer_on(backend)  # checks that it is available
    inputs = [twin.folder, *inputs]
    check_folder(out, kind=FLEET, inputs=inputs)
    say = progress or untold
    say(0.0, "static world")
    hashes = hashes_of(twin, motion)
    recipes: dict[str, dict[str, Any]] = {}
    for node in nodes:
        wanted = {
            **asked_of(node.rig_spec, node.rig_file, twin),
            "split": asked_split.told(),
        }
        recipes[node.name] = recipe_of(
            twin, motion, node.rig, node.seed, node.times_s, backend, wanted, storage, hashes=hashes
        )
        if not _without_gap(
            node.times_s
        ):  # its carrier returned: no single interval holds its frames
            recipes[node.name]["made_from"]["record"] = None
    key = recipe_key(
        {
            "nodes": recipes,
            "asked": [as_json(node.spec) for node in nodes],
            "times": list(times_s.values()),
            "seed": seed,
            "pictures": also is not None,
            "split": asked_split.told(),
            "storage": storage,
            "marks": MARKS_FORMAT,
        }
    )
    with replaced_folder(out, kind=FLEET, inputs=inputs, key=key) as folder:
        if not (folder / INVENTORY).is_file():
            recordings = {
                node.name: Recording(
                    node.rig,
                    node.seed,
                    node.times_s,
                    folder / node.name,
                    FolderPlace(folder / node.name),
                    recipes[node.name],
                )
                for node in nodes
            }
            check_room_for(out, recordings, storage)
            entries = write_datasets(
                twin,
                motion,
                recordings,
                split=asked_split,
                workers=workers,
                backend=backend,
                storage=storage,
                progress=lambda share, doing: say(0.96 * share, doing),
            )
            say(0.96, "common labels")
            seeds = {"record": seed, "traffic": motion.manifest["seed"]}
            _write_common(folder, twin, motion, nodes, times_s, entries, recipes, seeds)
            if also is not None:
                say(0.97, "pictures")
                also(folder)
            for node in nodes:
                write_cards(folder / node.name)
            write_index(folder, [folder / node.name for node in nodes], folder)
            write_inventory(folder, known=checksums(entries), without=[MARKS])
        # With an inventory it is whole, and what an interruption leaves from here on is enough.
        for node in nodes:
            shutil.rmtree(folder / node.name / MARKS, ignore_errors=True)
    say(1.0, "done")


def _without_gap(times_s: Mapping[int, float]) -> bool:
    return len(set(np.diff(list(times_s)).tolist())) <= 1


def _write_common(
    folder: Path,
    twin: Twin,
    motion: Motion,
    nodes: Sequence[Node],
    times_s: Mapping[int, float],
    entries: Mapping[str, Sequence[Mapping[str, Any]]],
    recipes: Mapping[str, Mapping[str, Any]],
    seeds: Mapping[str, int],
) -> None:
    """Write what is of no single node: common labels, poses and clocks, the manifest."""
    numbered = {
        node.name: dict(zip(node.times_s, entries[node.name], strict=True)) for node in nodes
    }
    write_common_boxes(
        folder / "boxes.parquet", twin, motion, nodes, times_s, numbered, seeds["record"]
    )
    rows = {node.name: node_rows(node, numbered[node.name], motion) for node in nodes}
    write_nodes(folder / "nodes.parquet", times_s, nodes, rows)
    inputs = {
        (one.get("kind"), one["name"], one.get("sha256")): one
        for recipe in recipes.values()
        for one in recipe["inputs"]
    }
    manifest = manifest_of_fleet(
        folder, recipes[nodes[0].name], nodes, times_s, rows, list(inputs.values()), seeds
    )
    write_json(folder / f"{FLEET}.json", manifest)
