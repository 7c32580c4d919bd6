"""Recording: a twin, its motion and a rig become a labelled dataset."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.dataset.boxes import write_boxes
from urbantwin.dataset.course import Courses
from urbantwin.dataset.layout import FOLDERS, frame_name, read_json_or_none
from urbantwin.dataset.manifest import manifest_of, recipe_key, recipe_of
from urbantwin.dataset.moment import SAME_TIME_S
from urbantwin.dataset.split import split_frames
from urbantwin.dataset.sweeps import write_sweeps
from urbantwin.dataset.workers import Recipe, Task, record_frames, usable_processors
from urbantwin.errors import InputError
from urbantwin.lidar import Rig
from urbantwin.lidar.timing import span_of

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["frame_times", "record"]


def record(  # noqa: PLR0913 - every one is a person's choice
    twin: Twin,
    motion: Motion,
    rig: Rig,
    out: Path,
    *,
    workers: int | None = None,
    seed: int = 0,
    start_s: float = 0.0,
    stop_s: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Record every frame of a motion; the layout is in ``docs/architecture.md``.

    Frame n is the world at ``n / rig.rate_hz`` seconds, whatever ``start_s`` is, so it has the
    same name and the same bytes in every dataset of the same twin, motion, rig and seed. It also
    does not depend on the number of workers.

    The folder appears when it is whole. A run that is interrupted leaves the frames that it
    finished beside it, and the same command goes on from there.

    Args:
        twin: the twin.
        motion: a motion on it.
        rig: the sensors, placed on it.
        out: the dataset's folder; an older dataset there is replaced.
        workers: number of processes; as many as there are processors when not given.
        seed: of range noise and drop-out.
        start_s: no frame before it.
        stop_s: no frame after it; the motion's last step when not given.
        progress: called with the share that is done and what is being done.

    Raises:
        InputError: a motion on another twin, a negative number, a span without frames, or an
            ``out`` that holds other files.
        StageError: a worker was killed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers", place="workers", expected="1 or more")
    if seed < 0:
        raise InputError(f"the seed is {seed}", place="seed", expected="0 or more")
    if motion.manifest["twin_sha256"] != twin.sha256:
        raise InputError("the motion was made on another twin", expected="a motion on this twin")
    times_s = frame_times(rig.rate_hz, start_s, stop_s, motion.times())
    say = progress or (lambda fraction, doing: None)
    say(0.0, "static world")
    recipe = recipe_of(twin, motion, rig, seed, times_s)

    with replaced_folder(out, kind="dataset") as finished:
        partial = out.parent / f".{out.name}.{recipe_key(recipe)}.partial"
        done = partial / "done"
        for name in ("done", *FOLDERS):
            (partial / name).mkdir(parents=True, exist_ok=True)
        missing = [index for index in times_s if read_json_or_none(_mark(done, index)) is None]

        def tasks() -> Iterator[Task]:
            courses = Courses(motion)
            for index in missing:
                span = span_of(rig.sensors, index, seed)
                yield Task(index, courses.around(times_s[index], *span))

        count = min(usable_processors() if workers is None else workers, max(1, len(missing)))
        frames = Recipe(twin.mesh, rig, seed, partial, done, motion.meshes, twin.surface_materials)
        ready = len(times_s) - len(missing)
        if missing:
            for number, _ in enumerate(record_frames(frames, tasks(), count), start=ready + 1):
                say(0.98 * number / len(times_s), f"frame {number} of {len(times_s)}")

        say(0.98, "tables")
        entries = [read_json_or_none(_mark(done, index)) for index in times_s]
        _finish(partial, recipe, times_s, entries)
        shutil.rmtree(done)
        for entry in sorted(partial.iterdir()):
            entry.replace(finished / entry.name)
    _forget_partial(out)
    say(1.0, "done")


def frame_times(
    rate_hz: float,
    start_s: float,
    stop_s: float | None,
    steps_s: Any,  # noqa: ANN401
) -> dict[int, float]:
    """Return the number of each frame and its time: the multiples of 1 / rate within the span.

    Raises:
        InputError: the span is empty or leaves the motion.
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
    if high < low:
        raise InputError(
            f"no frame at {rate_hz:g} Hz lies in {start_s:g} to {stop:g} s",
            place="stop_s",
            expected=span,
        )
    return {index: index / rate_hz for index in range(low, high + 1)}


def _finish(
    folder: Path,
    recipe: dict[str, Any],
    times_s: dict[int, float],
    entries: list[dict[str, Any]],
) -> None:
    """Write what needs all frames: the split, the table of boxes and ``dataset.json``."""
    train, validate = split_frames([frame_name(index) for index in times_s])
    (folder / "ImageSets").mkdir(exist_ok=True)
    for name, frames in (("train", train), ("val", validate)):
        text = "".join(f"{frame}\n" for frame in frames)
        (folder / "ImageSets" / f"{name}.txt").write_text(text)
    write_boxes(folder / "boxes.parquet", times_s, entries)
    write_sweeps(folder / "sweeps.parquet", list(times_s), entries)
    manifest = manifest_of(recipe, times_s, entries, (train, validate))
    write_json(folder / "dataset.json", manifest)


def _mark(done: Path, index: int) -> Path:
    return done / f"{frame_name(index)}.json"


def _forget_partial(out: Path) -> None:
    """Take away what interrupted runs left beside a dataset that is now there."""
    for left in out.parent.glob(f".{out.name}.*.partial"):
        shutil.rmtree(left, ignore_errors=True)
    for left in out.parent.glob(f".{out.name}-*"):
        with suppress(OSError):  # Not empty, so not what a killed run leaves.
            left.rmdir()
