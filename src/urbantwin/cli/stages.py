"""The stages as the commands run them: with progress shown, and every check at its place."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import replaced_folder
from urbantwin.cli.console import Console
from urbantwin.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from urbantwin.lidar import Rig
    from urbantwin.reconstruct import Reconstruction
    from urbantwin.site import Site
    from urbantwin.site.rig_changes import RigChanges
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = [
    "build_stage",
    "dataset_pictures_stage",
    "fields_below",
    "new_folder",
    "record_stage",
    "rig_on",
    "site_with_known_sensors",
    "traffic_stage",
    "twin_pictures_stage",
    "whole_line",
]


@contextmanager
def new_folder(folder: Path) -> Iterator[None]:
    """Take a folder away again if the block made it and then failed with nothing in it."""
    existed = folder.exists()
    try:
        yield
    except BaseException:
        if not existed and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise


def rig_on(twin: Twin, rig_file: Path | None = None, changes: RigChanges | None = None) -> Rig:
    """Place the rig of a file, or the twin's own, on a twin."""
    from urbantwin.lidar.rig import place_rig
    from urbantwin.site import load_rig_spec

    file = twin.folder / "rig.yaml" if rig_file is None else rig_file
    spec = load_rig_spec(file, twin.frame)
    if changes is not None:
        spec = changes.applied_to(spec)
    return place_rig(spec, twin.mesh, file=file, anchor_height_m=twin.anchor_height_m)


@contextmanager
def fields_below(field: str, file: Path) -> Iterator[None]:
    """Name the fields of errors in ``file`` as they stand there, below ``field``."""
    try:
        yield
    except InputError as error:
        if not field or error.file != str(file):
            raise
        place = f"{field}.{error.place}" if error.place else field
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None


def site_with_known_sensors(path: Path) -> Site:
    """Read a site and check its sensors against the catalogue, which needs no twin."""
    from urbantwin.lidar.rig import check_models
    from urbantwin.site import load_site

    site = load_site(path)
    with fields_below(_rig_field(site), site.rig_file):
        check_models(site.rig, file=site.rig_file)
    return site


def build_stage(site: Site, out: Path, console: Console, *, pictures: bool = True) -> Twin:
    """Build a twin that the site's own rig stands in; draw how its geometry was cleaned."""
    from urbantwin.lidar.rig import place_rig
    from urbantwin.twin import build_twin, load_twin

    found: list[Reconstruction] = []
    with (
        new_folder(out.parent),
        replaced_folder(out, kind="twin") as scratch,
        console.stage("twin") as progress,
    ):
        twin = build_twin(site, scratch / "twin", progress, watch=found.append)
        with fields_below(_rig_field(site), site.rig_file):
            place_rig(
                site.rig,
                twin.mesh,
                file=site.rig_file,
                anchor_height_m=twin.anchor_height_m,
            )
        for entry in sorted((scratch / "twin").iterdir()):
            entry.replace(scratch / entry.name)
        (scratch / "twin").rmdir()
        if pictures and found:
            from urbantwin.view.geometry_pictures import pictures_of_geometry
            from urbantwin.view.pictures import attributions

            sources = attributions({"inputs": site.inputs()})
            pictures_of_geometry(found[0], scratch / "pictures", attribution=sources)
    return load_twin(out)


def traffic_stage(
    twin: Twin, out: Path, console: Console, *, seconds: float | None, seed: int | None
) -> Motion:
    """Drive a twin's traffic; what is not given is as the twin's site asks."""
    from urbantwin.traffic import run_traffic

    with new_folder(out.parent), console.stage("traffic") as progress:
        return run_traffic(twin, out, seconds=seconds, seed=seed, progress=progress)


def record_stage(
    twin: Twin,
    motion: Motion,
    rig_file: Path | None,
    out: Path,
    console: Console,
    *,
    workers: int | None,
    seed: int | None = None,
    start_s: float = 0.0,
    stop_s: float | None = None,
    changes: RigChanges | None = None,
    backend: str = "embree",
    background: Sequence[str] = (),
    fuse: bool = False,
) -> None:
    """Record a dataset with the rig of a file, or with the twin's own, and changes to it."""
    from urbantwin.dataset import record
    from urbantwin.lidar.measured_file import rig_with_backgrounds

    file = twin.folder / "rig.yaml" if rig_file is None else rig_file
    rig = rig_with_backgrounds(rig_on(twin, rig_file, changes), background, fused=fuse)
    with new_folder(out.parent), console.stage("record") as progress:
        record(
            twin,
            motion,
            rig,
            out,
            workers=workers,
            seed=twin.site["traffic"]["seed"] if seed is None else seed,
            start_s=start_s,
            stop_s=stop_s,
            rig_file=file,
            backend=backend,
            progress=progress,
        )


def twin_pictures_stage(twin: Twin, console: Console) -> list[Path]:
    """Draw a twin's plan and scene into its ``pictures/``."""
    from urbantwin.view.pictures import pictures_of_twin

    with console.stage("pictures") as progress:
        return pictures_of_twin(twin, twin.folder / "pictures", progress=progress)


def dataset_pictures_stage(
    dataset: Path, twin: Twin, motion: Motion, console: Console
) -> list[Path]:
    """Draw a recorded frame and the points of each class into the dataset's ``pictures/``."""
    from urbantwin.view.pictures import pictures_of_dataset

    with console.stage("pictures") as progress:
        return pictures_of_dataset(dataset, twin=twin, motion=motion, progress=progress)


def whole_line(
    site: Site, out: Path, console: Console, *, workers: int | None, pictures: bool = True
) -> dict[str, Any]:
    """Go from a site to a dataset with pictures, and say where everything is."""
    with new_folder(out):
        twin = build_stage(site, out / "twin", console, pictures=pictures)
        motion = traffic_stage(twin, out / "motion", console, seconds=None, seed=None)
        record_stage(twin, motion, None, out / "dataset", console, workers=workers)
        drawn: list[Path] = []
        if pictures:
            drawn += twin_pictures_stage(twin, console)
            drawn += dataset_pictures_stage(out / "dataset", twin, motion, console)
    return {
        "twin": str(out / "twin"),
        "motion": str(out / "motion"),
        "dataset": str(out / "dataset"),
        "attribution": list(dict.fromkeys(item["attribution"] for item in site.inputs())),
        "pictures": [str(picture) for picture in drawn],
    }


def _rig_field(site: Site) -> str:
    return "rig" if site.rig_file == site.file else ""
