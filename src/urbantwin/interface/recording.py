"""Recording of LiDAR datasets of a twin and its motion, by one rig or by several nodes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, overload

from annotated_types import Ge

from urbantwin.artefact.storage import Storage, is_url
from urbantwin.dataset.output_place import check_output
from urbantwin.dataset.rehearsal import rehearse
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.stored_dataset import StoredDataset
from urbantwin.processes import Helpers, helpers, pool_of

if TYPE_CHECKING:
    from urbantwin.dataset.split import SplitAsked
    from urbantwin.dataset.workers import Workers
    from urbantwin.interface.dataset import Fleet
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.twin import Twin
    from urbantwin.progress import Progress
    from urbantwin.site.rig import RigSpec
    from urbantwin.site.rig_changes import RigChanges

__all__ = ["record", "recorded", "recorders"]


@overload
def record(
    twin: Twin | AnyPath,
    motion: Motion | AnyPath,
    out: AnyPath | None = None,
    *,
    nodes: None = None,
    **options: Any,  # noqa: ANN401
) -> Dataset: ...
@overload
def record(
    twin: Twin | AnyPath,
    motion: Motion | AnyPath,
    out: AnyPath | None = None,
    *,
    nodes: AnyPath,
    **options: Any,  # noqa: ANN401
) -> Fleet: ...
# The options are declared once, below; they do not affect the type of the result.
@command  # type: ignore[misc]
def record(
    twin: Twin | AnyPath,
    motion: Motion | AnyPath,
    out: Annotated[AnyPath | None, "FOLDER|URL"] = None,
    *,
    rig: AnyPath | None = None,
    nodes: AnyPath | None = None,
    start: Annotated[float, Ge(0)] = 0.0,
    stop: Annotated[float | None, Ge(0)] = None,
    every: Annotated[int, Ge(1)] = 1,
    effects: str | None = None,
    weather: str | None = None,
    visibility: float | None = None,
    wet_ground: float | None = None,
    sun_elevation: float | None = None,
    sun_azimuth: float | None = None,
    ride: Annotated[str | None, "TRACK|CLASS"] = None,
    fused: bool | None = None,
    backend: Annotated[str | None, "NAME"] = None,
    storage: Annotated[str, "NAME"] = "npy",
    split: Annotated[str | Sequence[float], "SHARES"] = "70,15,15",
    gap: Annotated[float | None, Ge(0)] = None,
    thin: Annotated[float | None, Ge(0)] = None,
    background: Annotated[Sequence[AnyPath] | AnyPath, "[NAME=]FILE"] = (),
    fuse: bool = False,
    workers: Annotated[int | None, Ge(1)] = None,
    ray: Annotated[str | None, "ADDRESS"] = None,
    seed: Annotated[int | None, Ge(0)] = None,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Dataset | Fleet | StoredDataset:
    """Record labelled LiDAR frames of a motion.

    After an interruption, the same call continues.

    Args:
        twin: twin, or its folder.
        motion: motion on that twin, or its folder.
        out: folder to write, in which an older dataset is replaced; ``dataset`` beside the twin if
            not given, ``fleet`` with ``nodes``. Or an address of storage that fsspec reaches,
            ``s3://bucket/name``, which must be empty (docs/howto/campaigns.md).
        rig: ``rig.yaml``; the twin's own rig if not given.
        nodes: ``nodes.yaml``: several rigs, static and mounted on vehicles, that record together,
            each with its clock, pose and radio (docs/howto/nodes.md); in place of ``rig``.
        start: time of the first frame at the earliest, seconds of the motion.
        stop: time of the last frame at the latest, seconds; the motion's end if not given.
        every: record only every N-th frame of the rig's rate.
        effects: measurement effects to turn on or off: ``none``, ``all``, ``none,noise`` or
            ``no-sun``; the rig's if not given.
        weather: weather: ``clear``, ``rain``, ``fog`` or ``snow``; the rig's if not given.
        visibility: meteorological visibility, metres.
        wet_ground: wetness of the ground: 0 is dry, 1 a film of water.
        sun_elevation: elevation of the sun above the horizon, degrees.
        sun_azimuth: azimuth of the sun, degrees clockwise from north.
        ride: track or class of the actor that carries a rig that is mounted on a vehicle.
        fused: write one dataset of all sensors, or one for each; as the rig says if not given.
        backend: ray tracer: ``embree``, ``bvh`` (built in), ``warp`` (a CUDA device) or
            ``warp:DEVICE``; ``embree`` if not given, ``bvh`` where it is missing.
        storage: format of points: ``npy``, which OpenPCDet reads; ``zstd``, lossless columns in
            Parquet, a third of the size; or ``laz``, LAS 1.4 in whole millimetres.
        split: shares of training, validation and test, percent, cut in time.
        gap: time between the parts, in none of them, seconds; as long as the scene needs to change,
            and no more than a tenth of the recording, if not given.
        thin: leave frames in which no actor moved this many metres out of the parts.
        background: measured static world of a real sensor, ``FILE`` or ``NAME=FILE``, for each
            sensor of the rig.
        fuse: use the twin where a measured background has no data.
        workers: number of processes; every number gives the same bytes.
        ray: Ray cluster to record on: ``HOST:PORT`` of its head, ``auto`` for the one on this
            machine, ``local`` to start one; it gives the same bytes (docs/howto/campaigns.md).
        seed: random seed; the site's ``traffic.seed`` if not given.
        pictures: draw pictures into the dataset's folder.
        progress: show progress; or a function that is called with (share, doing).

    Returns:
        The dataset; of nodes, a `Fleet` with a dataset for each; on storage, a `StoredDataset`.

    Raises:
        InputError: the arguments are inconsistent, ``out`` holds other files, or no cluster can be
            reached.
        StageError: a worker was killed, the disk is full, or storage fails.

    Example:
        >>> dataset = ut.record(twin, motion, rig="rig.yaml", weather="rain", visibility=800)
        >>> fleet = ut.record(twin, motion, nodes="nodes.yaml")
        $ urbantwin record urbantwin-demo/twin urbantwin-demo/motion -o dataset/ --stop 5
    """
    from urbantwin.dataset.split import SplitAsked, shares_of
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.rig import rig_spec_on
    from urbantwin.interface.twin import Twin
    from urbantwin.site.rig_changes import RigChanges

    divided = SplitAsked(shares_of(split), gap, thin)
    changes = RigChanges(
        effects=effects,
        weather=weather,
        visibility_m=visibility,
        wet_ground=wet_ground,
        sun_elevation_deg=sun_elevation,
        sun_azimuth_deg=sun_azimuth,
        ride=ride,
        fused=fused,
    )
    given = [background] if isinstance(background, str | os.PathLike) else background
    measured = [os.fspath(one) for one in given]
    kind = "dataset" if nodes is None else "fleet"
    place = Storage.of(str(out)) if is_url(out) else beside(twin, kind, out)
    rig_file = None if rig is None else Path(rig)
    files = [Path(one) for one in (rig, nodes) if one is not None]
    inputs = [Path(twin), Path(motion), *files]
    check_output(place, kind=kind, inputs=inputs)
    if nodes is not None:
        _refuse_with_nodes(rig=rig, ride=ride, fused=fused, background=measured, fuse=fuse)
        if isinstance(place, Storage):
            raise InputError("is storage", file=str(place), expected="a folder, for several nodes")
    # Helper processes start while the twin is read, which occupies one processor.
    with recorders(workers, ray, pictures=pictures) as crew:
        if nodes is not None and isinstance(place, Path):
            return _recorded_nodes(
                Twin.open(twin),
                Motion.open(motion),
                Path(nodes),
                changes,
                place,
                start_s=start,
                stop_s=stop,
                every=every,
                backend=backend,
                storage=storage,
                split=divided,
                workers=crew,
                ray=ray,
                seed=seed,
                inputs=inputs,
                pictures=pictures,
                progress=progress,
            )
        on = Twin.open(twin)
        spec, file = rig_spec_on(on, rig_file, changes)
        return recorded(
            on,
            Motion.open(motion),
            spec,
            file,
            place,
            background=measured,
            fuse=fuse,
            start_s=start,
            stop_s=stop,
            every=every,
            backend=backend,
            storage=storage,
            split=divided,
            workers=crew,
            ray=ray,
            seed=seed,
            inputs=inputs,
            pictures=pictures,
            progress=progress,
        )


@overload
def recorded(
    on: Twin,
    moving: Motion,
    spec: RigSpec,
    rig_file: Path,
    place: Path,
    **options: Any,  # noqa: ANN401
) -> Dataset: ...
@overload
def recorded(
    on: Twin,
    moving: Motion,
    spec: RigSpec,
    rig_file: Path,
    place: Storage,
    **options: Any,  # noqa: ANN401
) -> StoredDataset: ...
def recorded(  # type: ignore[misc]
    on: Twin,
    moving: Motion,
    spec: RigSpec,
    rig_file: Path,
    place: Path | Storage,
    *,
    background: Sequence[str] = (),
    fuse: bool = False,
    start_s: float = 0.0,
    stop_s: float | None = None,
    every: int = 1,
    backend: str | None = None,
    storage: str = "npy",
    split: SplitAsked | None = None,
    workers: int | Helpers | None = None,
    ray: str | None = None,
    seed: int | None = None,
    inputs: Sequence[Path] = (),
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Dataset | StoredDataset:
    """Record a dataset with a rig; see `record`.

    Args:
        on: the twin.
        moving: the motion.
        spec: the rig, with all changes applied.
        rig_file: the rig's file; relative paths in the rig are relative to its folder.
        place: folder to write, or storage.
        background: measured static worlds of real sensors, ``FILE`` or ``NAME=FILE``.
        fuse: use the twin where a measured background has no data.
        start_s: earliest time of a frame, seconds of the motion.
        stop_s: latest time of a frame, seconds of the motion.
        every: record only every N-th frame.
        backend: ray tracer.
        storage: format of points, see `record`.
        split: split into training, validation and test; the default split if not given.
        workers: number of processes, or running helpers.
        ray: Ray cluster to record on.
        seed: random seed.
        inputs: input files and folders, which must not be overwritten.
        pictures: draw pictures into the folder.
        progress: show progress.
    """
    from urbantwin.dataset.provenance import asked_of
    from urbantwin.dataset.recording import record as record_frames
    from urbantwin.interface.rig import placed
    from urbantwin.lidar.background_file import rig_with_backgrounds

    mounted = rig_with_backgrounds(placed(spec, on, rig_file), list(background), fused=fuse)
    with shown_stage("record", progress) as tell, _crew(workers, ray, backend) as crew:
        also = _drawing(on, moving, tell, crew) if pictures else None
        record_frames(
            on,
            moving,
            mounted,
            place,
            workers=crew,
            seed=seed,
            start_s=start_s,
            stop_s=stop_s,
            every=every,
            rig_file=rig_file,
            backend=backend,
            storage=storage,
            split=split,
            asked=asked_of(spec, rig_file, on, background=background, fuse=fuse),
            inputs=inputs,
            also=also,
            progress=tell,
        )
    made = Dataset(place) if isinstance(place, Path) else StoredDataset(place.url)
    tell_result("record", Path(str(place)), made.warnings, progress)
    return made


def _recorded_nodes(
    on: Twin,
    moving: Motion,
    nodes_file: Path,
    changes: RigChanges,
    place: Path,
    *,
    start_s: float,
    stop_s: float | None,
    every: int,
    backend: str | None,
    storage: str,
    split: SplitAsked,
    workers: int | Helpers | None,
    ray: str | None,
    seed: int | None,
    inputs: Sequence[Path],
    pictures: bool,
    progress: ShowProgress,
) -> Fleet:
    """Record datasets with several nodes; see `record`."""
    from urbantwin.dataset.fleet import record_fleet
    from urbantwin.interface.dataset import Fleet
    from urbantwin.interface.rig import rigs_of_nodes
    from urbantwin.site.nodes import load_nodes

    asked = load_nodes(nodes_file)
    with shown_stage("record", progress) as tell, _crew(workers, ray, backend) as crew:
        tell(0.0, "placing the nodes")
        record_fleet(
            on,
            moving,
            asked,
            rigs_of_nodes(asked, on, changes),
            place,
            workers=crew,
            seed=seed,
            start_s=start_s,
            stop_s=stop_s,
            every=every,
            backend=backend,
            storage=storage,
            split=split,
            inputs=inputs,
            also=_drawing_nodes(on, moving, tell, crew) if pictures else None,
            progress=tell,
        )
    made = Fleet(place)
    tell_result("record", place, made.warnings, progress)
    return made


@contextmanager
def recorders(
    workers: int | None, ray: str | None = None, *, pictures: bool
) -> Iterator[int | Helpers | None]:
    """Yield this process with its helpers, or the number of workers if none help here.

    Starting helpers takes a second, and half a minute if numba has to compile first.

    Args:
        workers: number of processes, this one included; all processors if not given.
        ray: a Ray cluster, which has workers of its own.
        pictures: the helpers also draw pictures.
    """
    if ray is not None or (workers is not None and workers < 2):
        yield workers
        return
    with helpers(workers, rehearse) as crew:
        if pictures and crew.pool is not None:  # drawing imports while the twin is read
            crew.pool.submit(_begin_to_draw)
        yield crew


def _begin_to_draw() -> None:
    import urbantwin.drawing.pictures  # noqa: F401


@contextmanager
def _crew(workers: int | Helpers | None, ray: str | None, backend: str | None) -> Iterator[Workers]:
    """Yield the workers: processes of this machine, or a cluster."""
    if ray is None or isinstance(workers, Helpers):
        yield workers
        return
    from functools import partial

    from urbantwin.cluster import connected
    from urbantwin.dataset.manifest import versions_here

    with connected(ray, agreed=partial(versions_here, backend), workers=workers) as cluster:
        yield cluster


def _drawing(on: Twin, moving: Motion, tell: Progress, crew: Workers) -> Callable[[Path], None]:
    """Return a function that draws the pictures of a dataset's folder."""

    def draw(folder: Path) -> None:
        from urbantwin.drawing.pictures import pictures_of_dataset
        from urbantwin.progress import between

        pictures_of_dataset(
            folder, twin=on, motion=moving, pool=pool_of(crew), progress=between(tell, 0.98, 1.0)
        )

    return draw


def _drawing_nodes(
    on: Twin, moving: Motion, tell: Progress, crew: Workers
) -> Callable[[Path], None]:
    """Return a function that draws the pictures of a fleet and of its nodes."""

    def draw(folder: Path) -> None:
        from urbantwin.dataset.reading import Fleet
        from urbantwin.drawing.pictures import picture_of_fleet, pictures_of_dataset
        from urbantwin.progress import between

        files = Fleet(folder)
        (folder / "pictures").mkdir(exist_ok=True)
        picture_of_fleet(files, folder / "pictures" / "nodes.png")
        for number, name in enumerate(files.node_names):
            begin, end = (0.97 + 0.03 * (number + k) / len(files.node_names) for k in (0, 1))
            pictures_of_dataset(
                folder / name,
                twin=on,
                motion=moving,
                pool=pool_of(crew),
                progress=between(tell, begin, end),
            )

    return draw


def _refuse_with_nodes(**options: object) -> None:
    """Raise an error for options that apply to a single rig.

    Raises:
        InputError: such an option is given together with nodes.
    """
    for name, value in options.items():
        if value not in (None, [], False) or (name == "fused" and value is False):
            raise InputError(
                "is for one rig, and several nodes are given",
                place=f"--{name}",
                expected="it in the file of the nodes, or in the rig of a node",
            )
