"""Recording: a twin, its motion and a rig become a labelled dataset."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.dataset.frame_times import frame_times
from urbantwin.dataset.manifest import manifest_of_parts, recipe_key, recipe_of, recipe_of_rig
from urbantwin.dataset.moment import FASTEST_M_S
from urbantwin.dataset.one_dataset import MARKS, finish_dataset, record_dataset
from urbantwin.errors import InputError
from urbantwin.lidar import Rig
from urbantwin.lidar.casting.backend import layers_on
from urbantwin.lidar.coverage import ignore_areas
from urbantwin.lidar.riding import boarded

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["record"]


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
    rig_file: str | Path | None = None,
    backend: str = "embree",
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Record every frame of a motion; the layout is in ``docs/architecture.md``.

    Frame n is the world from ``n / rig.rate_hz`` seconds on, whatever ``start_s`` is, so it has
    the same name and the same bytes in every dataset of the same twin, motion, rig and seed. It
    also does not depend on the number of workers.

    The folder appears when it is whole. A run that is interrupted leaves the frames that it
    finished beside it, and the same command goes on from there. With ``fused: false`` in the rig
    there is a dataset for each sensor, in a folder of the sensor's name.

    Args:
        twin: the twin.
        motion: a motion on it.
        rig: the sensors, placed on it.
        out: the dataset's folder; an older dataset there is replaced.
        workers: number of processes; as many as there are processors when not given.
        seed: of all that a sensor leaves to chance.
        start_s: no frame before it.
        stop_s: no frame after it; the motion's last step when not given.
        rig_file: the rig's file, for errors.
        backend: what casts the rays: ``embree``, ``warp`` or ``warp:DEVICE``.
        progress: called with the share that is done and what is being done.

    Raises:
        InputError: a backend that this machine lacks, a motion on another twin, a negative
            number, a span without frames, a rig that rides on an actor that is not there all the
            time, or an ``out`` that holds other files.
        StageError: a worker was killed.
    """
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers", place="workers", expected="1 or more")
    if seed < 0:
        raise InputError(f"the seed is {seed}", place="seed", expected="0 or more")
    if motion.manifest["twin_sha256"] != twin.sha256:
        raise InputError("the motion was made on another twin", expected="a motion on this twin")
    times_s = frame_times(rig.rate_hz, start_s, stop_s, motion.times())
    file = None if rig_file is None else str(rig_file)
    rig = boarded(rig, motion, list(times_s.values()), fastest_m_s=FASTEST_M_S, file=file)
    layers_on(backend)  # Before any work: is it there?
    say = progress or (lambda fraction, doing: None)
    say(0.0, "static world")
    recipe = recipe_of(twin, motion, rig, seed, times_s, backend)
    parts = {"": rig} if rig.fused else {one.sensors[0].name: one for one in rig.separate()}
    total = len(times_s) * len(parts)

    with replaced_folder(out, kind="dataset") as finished:
        partial = out.parent / f".{out.name}.{recipe_key(recipe)}.partial"
        entries: dict[str, list[dict[str, Any]]] = {}
        for number, (name, part) in enumerate(parts.items()):

            def count(frames: int, before: int = number * len(times_s)) -> None:
                ready = before + frames
                say(0.98 * ready / total, f"frame {ready} of {total}")

            entries[name] = record_dataset(
                twin,
                motion,
                part,
                partial / name,
                seed=seed,
                times_s=times_s,
                workers=workers,
                backend=backend,
                progress=count,
            )
        say(0.98, "tables")
        for name, part in parts.items():
            own = {**recipe, **recipe_of_rig(part)}
            ignored = ignore_areas(part, twin.mesh, twin.region)
            finish_dataset(partial / name, own, times_s, entries[name], ignored)
        if not rig.fused:
            write_json(partial / "dataset.json", manifest_of_parts(recipe, entries))
        for name in parts:
            shutil.rmtree(partial / name / MARKS)
        for entry in sorted(partial.iterdir()):
            entry.replace(finished / entry.name)
    _forget_partial(out)
    say(1.0, "done")


def _forget_partial(out: Path) -> None:
    """Take away what interrupted runs left beside a dataset that is now there."""
    for left in out.parent.glob(f".{out.name}.*.partial"):
        shutil.rmtree(left, ignore_errors=True)
    for left in out.parent.glob(f".{out.name}-*"):
        with suppress(OSError):  # Not empty, so not what a killed run leaves.
            left.rmdir()
