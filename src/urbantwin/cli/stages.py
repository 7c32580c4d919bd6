"""The stages as the commands run them: with progress shown, and every check at its place."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.cli.console import Console
from urbantwin.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from urbantwin.lidar import Rig
    from urbantwin.progress import Progress
    from urbantwin.reconstruct import Reconstruction
    from urbantwin.site import RigSpec, Site
    from urbantwin.site.rig_changes import RigChanges
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = [
    "build_stage",
    "fields_below",
    "record_stage",
    "rig_on",
    "site_with_known_sensors",
    "traffic_stage",
    "whole_line",
]


def rig_on(twin: Twin, rig_file: Path | None = None, changes: RigChanges | None = None) -> Rig:
    """Place the rig of a file, or the twin's own, on a twin."""
    from urbantwin.lidar.placement import place_rig

    spec, file = _spec_on(twin, rig_file, changes)
    return place_rig(spec, twin.mesh, file=file, anchor_height_m=twin.anchor_height_m)


def _spec_on(twin: Twin, rig_file: Path | None, changes: RigChanges | None) -> tuple[RigSpec, Path]:
    from urbantwin.site import load_rig_spec

    file = twin.folder / "rig.yaml" if rig_file is None else rig_file
    spec = load_rig_spec(file, twin.frame)
    return (spec if changes is None else changes.applied_to(spec)), file


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
    from urbantwin.lidar.sensor_options import check_models
    from urbantwin.site import load_site

    site = load_site(path)
    with fields_below(_rig_field(site), site.rig_file):
        check_models(site.rig, file=site.rig_file)
    return site


def build_stage(site: Site, out: Path, console: Console, *, pictures: bool = True) -> Twin:
    """Build a twin that the site's own rig stands in, with pictures of it and of its geometry."""
    from urbantwin.lidar.placement import place_rig
    from urbantwin.twin import build_twin

    found: list[Reconstruction] = []

    def also(twin: Twin, progress: Progress) -> None:
        with fields_below(_rig_field(site), site.rig_file):
            place_rig(site.rig, twin.mesh, file=site.rig_file, anchor_height_m=twin.anchor_height_m)
        if pictures:
            from urbantwin.view.geometry_pictures import pictures_of_geometry
            from urbantwin.view.pictures import attributions, pictures_of_twin

            folder = twin.folder / "pictures"
            if found:
                sources = attributions({"inputs": site.inputs()})
                pictures_of_geometry(found[0], folder, attribution=sources)
            pictures_of_twin(twin, folder, progress=progress)

    with console.stage("twin") as progress:
        return build_twin(site, out, progress, watch=found.append, also=also)


def traffic_stage(
    twin: Twin, out: Path, console: Console, *, seconds: float | None, seed: int | None
) -> Motion:
    """Drive a twin's traffic; what is not given is as the twin's site asks."""
    from urbantwin.traffic import run_traffic

    with console.stage("traffic") as progress:
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
    inputs: Sequence[Path] = (),
    pictures: bool = True,
) -> None:
    """Record a dataset with the rig of a file, or with the twin's own, and changes to it."""
    from urbantwin.dataset import asked_of, record
    from urbantwin.lidar.background_file import rig_with_backgrounds

    spec, file = _spec_on(twin, rig_file, changes)
    rig = rig_with_backgrounds(rig_on(twin, rig_file, changes), background, fused=fuse)
    with console.stage("record") as progress:

        def also(dataset: Path) -> None:
            from urbantwin.progress import between
            from urbantwin.view.pictures import pictures_of_dataset

            pictures_of_dataset(
                dataset,
                twin=twin,
                motion=motion,
                progress=between(progress, 0.98, 1.0),
            )

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
            asked=asked_of(spec, file, twin, background=background, fuse=fuse),
            inputs=inputs,
            also=also if pictures else None,
            progress=progress,
        )


def whole_line(
    site: Site, out: Path, console: Console, *, workers: int | None, pictures: bool = True
) -> dict[str, Any]:
    """Go from a site to a dataset with pictures, and say where everything is."""
    from urbantwin.artefact import check_folder

    places = {kind: out / kind for kind in ("twin", "motion", "dataset")}
    for kind, place in places.items():
        check_folder(place, kind=kind, inputs=site.files())
    twin = build_stage(site, places["twin"], console, pictures=pictures)
    motion = traffic_stage(twin, places["motion"], console, seconds=None, seed=None)
    record_stage(
        twin,
        motion,
        None,
        places["dataset"],
        console,
        workers=workers,
        inputs=[places["motion"]],
        pictures=pictures,
    )
    return {
        **{kind: str(place) for kind, place in places.items()},
        "attribution": list(dict.fromkeys(item["attribution"] for item in site.inputs())),
        "pictures": [
            str(picture)
            for place in (places["twin"], places["dataset"])
            for picture in sorted(place.rglob("pictures/*.png"))
        ],
    }


def _rig_field(site: Site) -> str:
    return "rig" if site.rig_file == site.file else ""
