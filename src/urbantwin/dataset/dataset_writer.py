"""Writer of a dataset: frames and tables, resumed after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.artefact import check_room, sha256_of, write_json
from urbantwin.artefact.tables import PARQUET
from urbantwin.cluster import Cluster
from urbantwin.dataset.box_columns import UNKNOWN_IS_NAN, packed_columns
from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.frame_place import MARKS, FramePlace
from urbantwin.dataset.ignore_regions import IGNORE_REGIONS, areas_of, write_ignore_regions
from urbantwin.dataset.layout import folders_of, frame_name
from urbantwin.dataset.manifest import frames_of, manifest_of
from urbantwin.dataset.reading.columns import BOXES, SEQUENCE_TABLES, arrow_schema
from urbantwin.dataset.reading.frame_files import RAY_TYPE
from urbantwin.dataset.rehearsal import rehearse
from urbantwin.dataset.sequence_tables import write_sequence_tables
from urbantwin.dataset.split.actor_places import Recorded
from urbantwin.dataset.split.asked import SplitAsked
from urbantwin.dataset.split.image_sets import FILES, write_image_sets
from urbantwin.dataset.split.time_split import Split, split_in_time
from urbantwin.dataset.sweep_table import write_sweeps
from urbantwin.dataset.workers import Part, Recipe, Task, Workers, record_frames
from urbantwin.errors import StageError
from urbantwin.lidar import Rig
from urbantwin.lidar.annotated import truck_of_load
from urbantwin.lidar.timing import span_of
from urbantwin.processes import Helpers, helpers, usable_processors
from urbantwin.progress import Progress

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["Recording", "check_room_for", "checksums", "write_boxes", "write_datasets"]


def write_boxes(
    path: Path,
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    motion: Motion,
) -> None:
    """Write ``boxes.parquet``.

    Args:
        path: the file.
        times_s: frame number -> time.
        entries: return value of ``layout.write_frame`` for each frame, in the same order, with
            packed boxes.
        motion: the motion, for parked and towed actors.
    """
    # Imported here: workers, which start with this package, do not need it.
    import pyarrow as pa
    import pyarrow.parquet as pq

    from urbantwin.traffic.paths.coupling import towed_by

    parked, pulls = frozenset(motion.parked["track"].to_pylist()), towed_by(motion.rows)
    boxes = [entry["boxes"] for entry in entries]
    of_frame = np.repeat(np.arange(len(boxes)), [len(item["track"]) for item in boxes])
    names = np.array([frame_name(index) for index in times_s], object)
    columns: dict[str, Any] = {
        "frame": names[of_frame],
        "time_s": np.array(list(times_s.values()), np.float64)[of_frame],
    }
    for name in boxes[0] if boxes else ():
        columns[name] = np.concatenate([item[name] for item in boxes])
    track = columns["track"].tolist()
    columns["parked"] = np.array([item in parked for item in track], np.bool_)
    both = zip(track, columns["class"].tolist(), strict=True)
    columns["towed_by"] = [pulls.get(item, _carries(item, kind)) for item, kind in both]
    schema = arrow_schema(BOXES)
    arrays = [
        pa.array(columns[item.name], item.type, from_pandas=item.name in UNKNOWN_IS_NAN)
        for item in schema
    ]
    pq.write_table(pa.table(arrays, schema=schema), path, **PARQUET)


def _carries(track: int, kind: str) -> int | None:
    """Return the track of the truck whose load has this track and class."""
    return truck_of_load(track) if kind == "trailer" else None


#: Version of the marks: a run does not resume from marks of another version.
MARKS_FORMAT = 2
TABLES = ("boxes.parquet", "sweeps.parquet")
#: Bytes of a point: x, y, z and intensity, label, and ray.
BYTES_PER_POINT = 16 + 4 + RAY_TYPE.itemsize
#: Smallest compressed share, by storage.
LEAST_LEFT = {"npy": 1.0, "zstd": 0.25, "laz": 0.1}
#: Smallest share of rays that return, in a street.
LEAST_RETURNED = 0.4
Entries = list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Recording:
    """A dataset in the making.

    Attributes:
        rig: the sensors, with the carrier assigned.
        seed: random seed.
        times_s: frame number -> time.
        folder: folder of tables and manifest, created if missing.
        place: place of the frames' files.
        recipe: reproducible description of the frames, see `manifest.recipe_of`.
    """

    rig: Rig
    seed: int
    times_s: Mapping[int, float]
    folder: Path
    place: FramePlace
    recipe: Mapping[str, Any]


def record_datasets(
    twin: Twin,
    motion: Motion,
    parts: Mapping[str, Recording],
    missing: Mapping[str, Sequence[int]],
    *,
    workers: Helpers | Cluster,
    backend: str,
    storage: str,
    progress: Callable[[int], None],
) -> dict[str, Entries]:
    """Record missing frames, and return the entries of all frames.

    Args:
        twin: the twin.
        motion: a motion on it.
        parts: the datasets, by name; workers hold the world once for all.
        missing: numbers of the missing frames, by name.
        workers: this process and its helpers, or a cluster.
        backend: ray tracer, see `lidar.Scanner`.
        storage: format of points, see `layout.write_frame`.
        progress: called with the number of finished frames, after each.

    Returns:
        By name of the dataset, the return values of ``layout.write_frame`` for each frame, with
        packed boxes, and the sweeps.
    """

    def tasks() -> Iterator[Task]:
        motions = FrameMotions(motion)
        for part, recording in parts.items():
            for index in missing[part]:
                span = span_of(recording.rig.sensors, index, recording.seed)
                yield Task(part, index, motions.around(recording.times_s[index], *span))

    recipe = Recipe(
        twin.mesh,
        {
            part: Part(recording.rig, recording.seed, recording.place)
            for part, recording in parts.items()
            if missing[part]
        },
        motion.meshes,
        twin.surface_materials,
        twin.region,
        backend,
        storage,
    )
    left = sum(map(len, missing.values()))
    if left:
        done = sum(len(recording.times_s) for recording in parts.values()) - left
        for number, _ in enumerate(record_frames(recipe, tasks(), left, workers), start=done + 1):
            progress(number)
    entries = {part: _entries(recording) for part, recording in parts.items()}
    if any(entry is None for recording in entries.values() for entry in recording):
        raise StageError(
            "marks of finished frames are gone: another run writes to the same place; "
            "look whether it is finished there, or give the same command again"
        )
    return entries


def write_datasets(
    twin: Twin,
    motion: Motion,
    parts: Mapping[str, Recording],
    *,
    split: SplitAsked,
    workers: Workers,
    backend: str,
    storage: str,
    progress: Progress,
) -> dict[str, Entries]:
    """Record datasets of one motion, with tables and manifests; all are split in time alike.

    Args:
        twin: the twin.
        motion: a motion on it.
        parts: the datasets, by name.
        split: split into training, validation and test.
        workers: see `record_datasets`.
        backend: see `record_datasets`.
        storage: see `record_datasets`.
        progress: called with the fraction of finished frames and a description.

    Returns:
        See `record_datasets`.
    """
    total = sum(len(recording.times_s) for recording in parts.values())

    def count(ready: int) -> None:
        progress(ready / total, f"frame {ready} of {total}")

    missing = {name: _missing(recording, storage) for name, recording in parts.items()}
    rigs = {name: recording.rig for name, recording in parts.items()}
    with (
        _crew(workers, sum(map(len, missing.values()))) as crew,
        areas_of(rigs, twin.mesh, twin.region, crew) as ignored,
    ):
        entries = record_datasets(
            twin,
            motion,
            parts,
            missing,
            workers=crew,
            backend=backend,
            storage=storage,
            progress=count,
        )
        progress(1.0, "tables")
        recorded = [
            write_tables(
                recording.folder, recording.recipe, recording.times_s, entries[name], motion, twin
            )
            for name, recording in parts.items()
        ]
        divided = split_in_time(recorded, split)
        for name, recording in parts.items():
            write_ignore_regions(recording.folder / IGNORE_REGIONS, ignored(name))
    for name, recording in parts.items():
        finish_dataset(
            recording.folder, recording.recipe, recording.times_s, entries[name], divided
        )
    return entries


def check_room_for(out: Path, parts: Mapping[str, Recording], storage: str) -> None:
    """Check the free disk space, allowing for what an interrupted run left.

    Raises:
        InputError: the disk has less room than the frames will need at least.
    """
    needed = 0.0
    for recording in parts.values():
        marks = recording.folder / MARKS
        done = len(list(marks.glob("*.json"))) if marks.is_dir() else 0
        rays = sum(mounted.sensor.channels * mounted.columns for mounted in recording.rig.sensors)
        least = rays * LEAST_RETURNED * BYTES_PER_POINT * LEAST_LEFT[storage]
        needed += (len(recording.times_s) - done) * least
    frames = max(len(recording.times_s) for recording in parts.values())
    check_room(out, needed, f"a dataset of {frames} frames")


def write_tables(
    folder: Path,
    recipe: Mapping[str, Any],
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    motion: Motion,
    twin: Twin,
) -> Recorded:
    """Write the tables of all frames; return the input of the split."""
    boxes, sweeps = (folder / name for name in TABLES)
    write_boxes(boxes, times_s, entries, motion)
    write_sweeps(sweeps, list(times_s), entries)
    frames = frames_of(times_s, entries)
    write_sequence_tables(folder, {**recipe, "frames": frames}, folder, motion, twin)
    return Recorded(folder, frames, recipe["dataset_SE3_site"])


def finish_dataset(
    folder: Path,
    recipe: Mapping[str, Any],
    times_s: Mapping[int, float],
    entries: Sequence[Mapping[str, Any]],
    split: Split,
) -> None:
    """Write the lists of the split and ``dataset.json``."""
    frames = frames_of(times_s, entries)
    write_image_sets(folder, split.frames(frames))
    names = (*TABLES, *SEQUENCE_TABLES, IGNORE_REGIONS, *FILES)
    # A twin of meshes alone has no lanes.
    tables = {name: sha256_of(folder / name) for name in names if (folder / name).is_file()}
    split_notes = split.told_of(frames)
    write_json(folder / "dataset.json", manifest_of(recipe, times_s, entries, split_notes, tables))


def checksums(entries: Mapping[str, Entries]) -> dict[str, str]:
    """Return the SHA-256 of every frame's files, by dataset and name."""
    return {
        f"{name}/{file}" if name else file: digest
        for name, entries_of_dataset in entries.items()
        for entry in entries_of_dataset
        for file, digest in entry["sha256"].items()
    }


def _missing(own: Recording, storage: str) -> list[int]:
    """Prepare a dataset's places, and return the numbers of the missing frames."""
    own.folder.mkdir(parents=True, exist_ok=True)
    own.place.prepare(folders_of(storage))
    frames = zip(own.times_s, _entries(own), strict=True)
    return [index for index, entry in frames if entry is None]


def _entries(own: Recording) -> list[Any]:
    """Return the entries of the frames' marks, ``None`` for missing frames.

    There may be ten thousands, so their boxes are packed.
    """
    return [
        None if entry is None else {**entry, "boxes": packed_columns(entry["boxes"])}
        for entry in own.place.entries(frame_name(index) for index in own.times_s)
    ]


@contextmanager
def _crew(workers: Workers, frames: int) -> Iterator[Helpers | Cluster]:
    """Yield the given workers, or helper processes for the block, at most one per frame."""
    if isinstance(workers, Helpers | Cluster):
        yield workers
        return
    most = usable_processors() if workers is None else workers
    with helpers(min(most, frames), rehearse) as crew:
        yield crew
