"""Recording a fleet: nodes that stand and nodes that ride see one motion together."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.artefact import (
    INVENTORY,
    as_json,
    check_folder,
    replaced_folder,
    write_inventory,
    write_json,
)
from urbantwin.dataset.block_sums import write_block_sums
from urbantwin.dataset.card.write import write_cards, write_index
from urbantwin.dataset.dataset_writer import (
    MARKS_FORMAT,
    Recording,
    check_room_for,
    checksums,
    write_datasets,
)
from urbantwin.dataset.fleet.common_boxes import write_common_boxes
from urbantwin.dataset.fleet.manifest import manifest_of_fleet
from urbantwin.dataset.fleet.node import Node, PlacedRig, placed_nodes
from urbantwin.dataset.fleet.node_table import node_rows, write_nodes
from urbantwin.dataset.frame_place import MARKS, FolderPlace
from urbantwin.dataset.manifest import hashes_of, recipe_key, recipe_of
from urbantwin.dataset.provenance import asked_of
from urbantwin.dataset.reading.fleet_manifest import KIND
from urbantwin.dataset.recording import checked_seed, frame_times
from urbantwin.dataset.split import SplitAsked, check_split
from urbantwin.dataset.workers import Workers
from urbantwin.geometry.rays import library_named
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.progress import Progress, untold
from urbantwin.site.nodes import NodesFile

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["record_fleet"]


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
    """Record what all nodes see of a motion; the layout is in ``docs/nodes.md``.

    Each node has a dataset of its own, as `recording.record` makes it with the node's rig and
    seed, of the frames in which it is there. The frames of all have the same names at the same
    times. All datasets are cut in time alike: what one node is trained on, none is tested on.

    Args:
        twin: the twin.
        motion: a motion on it.
        asked: the nodes.
        rigs: the rig of each, placed on the twin.
        out: the fleet's folder; an older fleet there is replaced.
        workers: number of processes, or a cluster; as many as there are processors when not given.
        seed: of the run; the site's ``traffic.seed`` when not given.
        start_s: no frame before it.
        stop_s: no frame after it; the motion's last step when not given.
        every: of the frames only those whose number is a multiple of this.
        backend: what casts the rays, see `tracer_on`.
        storage: of points, see `recording.record`.
        split: into training, validation and test; the usual one when not given.
        inputs: files and folders besides the twin that ``out`` must not touch.
        also: called with the folder of the whole fleet before it appears, for what else belongs
            into it: pictures.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: as `recording.record`; or nodes that do not go together (`placed_nodes`).
        StageError: a worker was killed, or the disk is full.
    """
    seed = checked_seed(twin, motion, seed, workers=workers, storage=storage)
    rate_hz = rigs[0].rig.rate_hz
    times_s = frame_times(rate_hz, start_s, stop_s, motion.times(), every=every)
    asked_split = split or SplitAsked()
    check_split(list(times_s.values()), asked_split)
    nodes = placed_nodes(asked, rigs, motion, times_s, seed)
    backend = backend or library_named()
    tracer_on(backend)  # Before any work: is it there?
    inputs = [twin.folder, *inputs]
    check_folder(out, kind=KIND, inputs=inputs)
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
        if not _without_gap(node.times_s):  # whose carrier came back: no one span has its frames
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
    with replaced_folder(out, kind=KIND, inputs=inputs, key=key) as folder:
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
                write_block_sums(folder / node.name, entries[node.name])
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
    write_json(folder / f"{KIND}.json", manifest)
