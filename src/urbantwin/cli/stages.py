"""The stages as the commands run them: with progress shown, and every check at its place."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import replaced_folder
from urbantwin.cli.console import Console
from urbantwin.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from urbantwin.geometry import LabelledMesh
    from urbantwin.lidar import Rig
    from urbantwin.reconstruct import Reconstruction
    from urbantwin.site import RigSpec, Site
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = [
    "build_stage",
    "dataset_pictures_stage",
    "new_folder",
    "placed_rig",
    "record_stage",
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


def placed_rig(spec: RigSpec, mesh: LabelledMesh, *, file: Path, field: str = "") -> Rig:
    """Place a rig; an error names the field as it stands in ``file``, below ``field``."""
    from urbantwin.lidar.rig import place_rig

    try:
        return place_rig(spec, mesh, file=file)
    except InputError as error:
        if not field or error.file != str(file):
            raise
        place = f"{field}.{error.place}" if error.place else field
        raise InputError(error.problem, file=file, place=place, expected=error.expected) from None


def site_with_known_sensors(path: Path) -> Site:
    """Read a site and check its sensors against the catalogue, which needs no twin."""
    import numpy as np

    from urbantwin.geometry import LabelledMesh
    from urbantwin.site import load_site
    from urbantwin.site.rig import FARTHEST_M
    from urbantwin.taxonomy import material_id, semantic_id

    site = load_site(path)
    far = FARTHEST_M + 1.0
    plane = LabelledMesh.build(
        np.array([[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]]),
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("terrain"),
        material_id("grass"),
    )
    placed_rig(site.rig, plane, file=site.rig_file, field=_rig_field(site))
    return site


def build_stage(site: Site, out: Path, console: Console, *, pictures: bool = True) -> Twin:
    """Build a twin that the site's own rig stands in; draw how its geometry was cleaned."""
    from urbantwin.twin import build_twin, load_twin

    found: list[Reconstruction] = []
    with (
        new_folder(out.parent),
        replaced_folder(out, kind="twin") as scratch,
        console.stage("twin") as progress,
    ):
        twin = build_twin(site, scratch / "twin", progress, watch=found.append)
        placed_rig(site.rig, twin.mesh, file=site.rig_file, field=_rig_field(site))
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
) -> None:
    """Record a dataset with the rig of a file, or with the twin's own."""
    from urbantwin.dataset import record
    from urbantwin.site import load_rig_spec

    file = twin.folder / "rig.yaml" if rig_file is None else rig_file
    rig = placed_rig(load_rig_spec(file, twin.frame), twin.mesh, file=file)
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
