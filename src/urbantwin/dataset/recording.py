"""Recording: from a twin, its motion and a rig to a labelled dataset."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import sha256_of, write_inventory, write_json
from urbantwin.artefact.storage import Storage
from urbantwin.dataset.card.write import write_cards
from urbantwin.dataset.dataset_writer import (
    MARKS_FORMAT,
    Recording,
    check_room_for,
    checksums,
    write_datasets,
)
from urbantwin.dataset.frame_place import MARKS
from urbantwin.dataset.manifest import manifest_of_parts, recipe_key, recipe_of, recipe_of_rig
from urbantwin.dataset.motion_interpolation import FASTEST_M_S, SAME_TIME_S
from urbantwin.dataset.output_place import check_output, opened_output
from urbantwin.dataset.reading.frame_files import STORED
from urbantwin.dataset.split import SplitAsked, check_split
from urbantwin.dataset.workers import Workers
from urbantwin.errors import InputError
from urbantwin.geometry.rays import library_named
from urbantwin.lidar import Rig
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.riding import boarded
from urbantwin.progress import Progress, untold

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["record"]


def record(  # noqa: PLR0913 - every one is a person's choice
    twin: Twin,
    motion: Motion,
    rig: Rig,
    out: Path | Storage,
    *,
    workers: Workers = None,
    seed: int | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    every: int = 1,
    rig_file: str | Path | None = None,
    backend: str | None = None,
    storage: str = "npy",
    split: SplitAsked | None = None,
    asked: Mapping[str, Any] | None = None,
    inputs: Sequence[Path] = (),
    also: Callable[[Path], None] | None = None,
    progress: Progress | None = None,
) -> None:
    """Record every frame of a motion; the layout is in ``docs/architecture.md``.

    Frame n is the world from ``n / rig.rate_hz`` seconds on, whatever ``start_s`` is, so it has the
    same name and bytes in every dataset of the same twin, motion, rig and seed, for any number of
    workers.

    The folder appears when it is complete. An interrupted run leaves its finished frames in a
    scratch folder beside it, and the same command resumes. On storage, workers write frames in
    place, and the inventory, written last, marks completion. With ``fused: false`` in the rig there
    is one dataset per sensor, in a folder of its name.

    Args:
        twin: the twin.
        motion: a motion on it.
        rig: the sensors, placed on it.
        out: folder of the dataset, in which an older dataset is replaced; or empty storage.
        workers: number of processes, or a cluster; one per processor if not given.
        seed: seed of all random effects of sensors; the site's ``traffic.seed`` if not given.
        start_s: earliest frame.
        stop_s: latest frame; the motion's last step if not given.
        every: record only frames whose number is a multiple of this.
        rig_file: the rig's file, for errors.
        backend: ray tracer, see `tracer_on`.
        storage: format of points: ``npy``; ``zstd``, lossless columns in Parquet; or ``laz``, LAS
            1.4 with coordinates in whole millimetres.
        split: split into training, validation and test; by default the usual one.
        asked: requested rig, to reproduce the dataset: see `asked_of`.
        inputs: files and folders besides the twin that ``out`` must not touch: those of motion and
            rig.
        also: called with the folder of the whole dataset before it appears, to add pictures.
        progress: called with the fraction done and a description.

    Raises:
        InputError: an unavailable backend, a motion on another twin, a negative number, or an
            interval without frames. Also a gap that empties a part of the split, a rig on an actor
            that is absent in some frames, and an ``out`` that holds other files.
        StageError: a worker was killed, the disk is full, or the storage fails.
    """
    seed = checked_seed(twin, motion, seed, workers=workers, storage=storage)
    times_s = frame_times(rig.rate_hz, start_s, stop_s, motion.times(), every=every)
    asked_split = split or SplitAsked()
    check_split(list(times_s.values()), asked_split)
    file = None if rig_file is None else str(rig_file)
    rig = boarded(rig, motion, list(times_s.values()), fastest_m_s=FASTEST_M_S, file=file)
    backend = backend or library_named()
    tracer_on(backend)  # checks that it is available
    inputs = [twin.folder, *inputs]
    check_output(out, kind="dataset", inputs=inputs)
    tell = progress or untold
    tell(0.0, "static world")
    if asked is not None:
        asked = {**asked, "split": asked_split.told()}
    recipe = recipe_of(twin, motion, rig, seed, times_s, backend, asked, storage)
    parts = (
        {"": rig} if rig.fused else {single.sensors[0].name: single for single in rig.separate()}
    )

    key = recipe_key(
        {
            **recipe,
            "pictures": also is not None,
            "split": asked_split.told(),
            "storage": storage,
            "marks": MARKS_FORMAT,
        }
    )
    with opened_output(out, kind="dataset", inputs=inputs, key=key) as made:
        folder = made.folder
        if not made.is_whole:
            recordings = {
                name: Recording(
                    part,
                    seed,
                    times_s,
                    folder / name,
                    made.frames(name),
                    {**recipe, **recipe_of_rig(part)},
                )
                for name, part in parts.items()
            }
            if isinstance(out, Path):
                check_room_for(out, recordings, storage)
            entries = write_datasets(
                twin,
                motion,
                recordings,
                split=asked_split,
                workers=workers,
                backend=backend,
                storage=storage,
                progress=lambda share, doing: tell(0.98 * share, doing),
            )
            if not rig.fused:
                manifests = {name: sha256_of(folder / name / "dataset.json") for name in parts}
                write_json(folder / "dataset.json", manifest_of_parts(recipe, entries, manifests))
            if also is not None:
                for name in parts:
                    made.fetch_frame(name, entries[name])
                also(folder)
            write_cards(folder)
            write_inventory(
                folder, known=checksums(entries), without=[MARKS], elsewhere=made.is_elsewhere
            )
        # The inventory marks completion: an interruption from here on loses nothing.
        made.remove_marks(parts)
    tell(1.0, "done")


def checked_seed(
    twin: Twin, motion: Motion, seed: int | None, *, workers: Workers, storage: str
) -> int:
    """Return the seed of a run, and validate its options.

    Raises:
        InputError: no workers, a negative seed, a motion on another twin, an unknown storage.
    """
    if isinstance(workers, int) and workers < 1:
        raise InputError(f"{workers} workers", place="workers", expected="1 or more")
    seed = int(twin.site["traffic"]["seed"]) if seed is None else seed
    if seed < 0:
        raise InputError(f"the seed is {seed}", place="seed", expected="0 or more")
    if motion.manifest["twin_sha256"] != twin.sha256:
        raise InputError("the motion was made on another twin", expected="a motion on this twin")
    if storage not in STORED:
        expected = ", ".join(STORED)
        raise InputError(f"unknown storage {storage!r:.40}", place="--storage", expected=expected)
    return seed


def frame_times(
    rate_hz: float,
    start_s: float,
    stop_s: float | None,
    steps_s: Any,  # noqa: ANN401
    *,
    every: int = 1,
) -> dict[int, float]:
    """Return frame number -> time: the multiples of 1 / rate in the interval.

    Only frames whose number is a multiple of ``every``.

    Raises:
        InputError: the interval is empty or exceeds the motion.
    """
    if not len(steps_s):
        raise InputError("the motion has no steps", expected="a motion with traffic")
    first, last = float(steps_s[0]), float(steps_s[-1])
    stop = last if stop_s is None else stop_s
    span = f"a span within the motion's {first:g} to {last:g} s"
    if not (math.isfinite(start_s) and math.isfinite(stop)):
        raise InputError(f"{start_s} to {stop} s is not a span", place="start_s", expected=span)
    if start_s < first - SAME_TIME_S:
        raise InputError(f"{start_s:g} s is before the motion", place="start_s", expected=span)
    if stop > last + SAME_TIME_S:
        raise InputError(f"{stop:g} s is after the motion", place="stop_s", expected=span)
    low = math.ceil((start_s - SAME_TIME_S) * rate_hz)
    high = math.floor((stop + SAME_TIME_S) * rate_hz)
    if every < 1:
        raise InputError(f"each {every}th frame", place="every", expected="1 or more")
    low, high = -(-low // every) * every, high // every * every
    if high < low:
        raise InputError(
            f"no frame at {rate_hz / every:g} Hz lies in {start_s:g} to {stop:g} s",
            place="stop_s",
            expected=span,
        )
    return {index: index / rate_hz for index in range(low, high + 1, every)}
