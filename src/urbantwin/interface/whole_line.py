"""All stages at once: from a site to twin, motion and dataset; and the demo."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge

from urbantwin.artefact import check_folder, new_folder
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.motion import Motion, drive
from urbantwin.interface.outcome import (
    outcome_of_dataset,
    outcome_of_motion,
    outcome_of_twin,
)
from urbantwin.interface.place import AnyPath, folder_of_site
from urbantwin.interface.recording import recorded, recorders
from urbantwin.interface.rig import fields_below, rig_spec_on
from urbantwin.interface.stage import ShowProgress, tell_line
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.twin import Twin, build_of, rig_field, site_with_known_sensors
from urbantwin.interface.viewing import view
from urbantwin.processes import Helpers
from urbantwin.result_warning import ResultWarning

if TYPE_CHECKING:
    from urbantwin.site import Site

__all__ = ["LATITUDE", "LONGITUDE", "RADIUS_M", "Run", "demo", "helsinki_extract", "run"]

#: Demo site: Unioninkatu, Liisankatu and Kaisaniemenkatu: five arms, signals, cycle lane, park.
LATITUDE, LONGITUDE, RADIUS_M = 60.174, 24.9503, 130.0
#: Frames of the demo's page; one second takes 11 MB.
_ON_THE_PAGE = "0:10"


class Run(Artefact):
    """A twin, its motion and its dataset, in one folder.

    Attributes:
        folder: the folder.
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)

    @cached_property
    def twin(self) -> Twin:
        """The twin."""
        return Twin.open(self.folder / "twin")

    @cached_property
    def motion(self) -> Motion:
        """The motion."""
        return Motion.open(self.folder / "motion")

    @cached_property
    def dataset(self) -> Dataset:
        """The dataset."""
        return Dataset(self.folder / "dataset")

    @property
    def page(self) -> Path:
        """Path of the page with some frames of the dataset, if it was saved."""
        return self.folder / "page.html"

    @property
    def pictures(self) -> list[Path]:
        """Paths of the pictures."""
        return [
            picture
            for kind in ("twin", "motion", "dataset")
            for picture in sorted((self.folder / kind).rglob("pictures/*.png"))
        ]

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings of twin, motion and dataset."""
        return (*self.twin.warnings, *self.motion.warnings, *self.dataset.warnings)

    def __repr__(self) -> str:
        """Return each part on its own line."""
        return f"{self.twin!r}\n{self.motion!r}\n{self.dataset!r}"

    def summary(self) -> Summary:
        """Return results, warnings, paths and attributions."""
        sources = (str(item["attribution"]) for item in self.twin.manifest["inputs"])
        return Summary(
            **outcome_of_twin(self.twin),
            **outcome_of_motion(self.motion),
            **outcome_of_dataset(self.dataset),
            look_at=[str(one) for one in self.warnings],
            **{kind: str(self.folder / kind) for kind in ("twin", "motion", "dataset")},
            attribution=list(dict.fromkeys(sources)),
            pictures=[str(picture) for picture in self.pictures],
            **({"page": str(self.page)} if self.page.is_file() else {}),
        )


@command
def run(
    site: AnyPath,
    out: AnyPath | None = None,
    *,
    workers: Annotated[int | None, Ge(1)] = None,
    pictures: bool = True,
    key_env: Sequence[str] | None = None,
    allow_key: Sequence[str] | None = None,
    progress: ShowProgress = True,
) -> Run:
    """Build, drive and record a site in one go.

    Args:
        site: the ``site.yaml``.
        out: folder for ``twin``, ``motion`` and ``dataset``; ``NAME`` beside the site if not given.
        workers: number of processes; every number gives the same bytes.
        pictures: draw pictures of all three.
        key_env: environment variables that the site's file may use as keys, beside those whose
            names begin with ``URBANTWIN_``.
        allow_key: ``NAME=https://host``: variable, and the server that its key may be sent to.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the site, or a file that it names, cannot be used, or needs a key that is not
            allowed.
        StageError: a stage failed.

    Example:
        $ urbantwin run mysite/site.yaml -o out/
    """
    from urbantwin.download import keys_allowed

    with keys_allowed(key_env, allow_key):
        checked = site_with_known_sensors(Path(site))
        place = folder_of_site(checked.file, checked.name, out)
        return _run_of(checked, place, workers=workers, pictures=pictures, progress=progress)


@command
def demo(
    out: AnyPath = "urbantwin-demo",
    *,
    workers: Annotated[int | None, Ge(1)] = None,
    progress: ShowProgress = True,
) -> Run:
    """Run a real intersection, from the map to frames.

    The place is a signalised junction in central Helsinki.

    Args:
        out: folder to write.
        workers: number of processes; every number gives the same bytes.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: a checkout without the generated map of Helsinki.

    Example:
        $ urbantwin demo -o urbantwin-demo
    """
    from urbantwin.lidar.sight import place_in_sight
    from urbantwin.site.initial_site import init_site

    place = Path(out)
    extract, file = helsinki_extract(), place / "site" / "site.yaml"
    if not file.exists():  # the user may have edited it
        with new_folder(file.parent):
            init_site(
                file.parent,
                extract,
                latitude=LATITUDE,
                longitude=LONGITUDE,
                radius_m=RADIUS_M,
                choose_pole=place_in_sight,
            )
    checked = site_with_known_sensors(file)
    made = _run_of(checked, place, workers=workers, pictures=True, progress=progress)
    try:
        view(made.dataset, save=made.page, frames=_ON_THE_PAGE, progress=progress)
    except InputError as error:  # a checkout may lack the page's script
        tell_line(f"demo: no page: {error}", progress)
    return made


def helsinki_extract() -> Path:
    """Return the demo's map, which a wheel contains and ``hatch_build.py`` generates in a checkout.

    Raises:
        InputError: a checkout without the generated map.
    """
    extract = Path(__file__).parents[1] / "site" / "demo_map" / "Helsinki.osm.pbf"
    if not extract.is_file():
        raise InputError(
            "the map of Helsinki is not made in this checkout",
            place="demo",
            expected="first: python hatch_build.py",
        )
    return extract


def _refuse_what_cannot_be_recorded(site: Site, workers: int | None) -> None:
    """Check early what the last stage would reject.

    Raises:
        InputError: the number of workers is wrong, or the traffic lacks the rig's carrier class.
    """
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers", place="workers", expected="1 or more")
    carrier = site.rig.ride.actor_class if site.rig.ride else None
    if carrier is not None and not site.traffic.per_hour[carrier]:
        with fields_below(rig_field(site), site.rig_file):
            raise InputError(
                f"the traffic has no {carrier}",
                file=site.rig_file,
                place="ride.class",
                expected=f"a class that drives, or traffic.per_hour.{carrier} above 0",
            )


def _run_of(
    site: Site, out: Path, *, workers: int | None, pictures: bool, progress: ShowProgress
) -> Run:
    for kind in ("twin", "motion", "dataset"):
        check_folder(out / kind, kind=kind, inputs=site.files())
    _refuse_what_cannot_be_recorded(site, workers)
    made = Run(out)
    with recorders(workers, pictures=pictures) as crew:
        made.twin = build_of(
            site,
            out / "twin",
            pictures=pictures,
            progress=progress,
            helpers=crew if isinstance(crew, Helpers) else None,
        )
        made.motion = drive(made.twin, out / "motion", pictures=pictures, progress=progress)
        spec, rig_file = rig_spec_on(made.twin, None)
        made.dataset = recorded(
            made.twin,
            made.motion,
            spec,
            rig_file,
            out / "dataset",
            workers=crew,
            inputs=[made.twin.folder, made.motion.folder],
            pictures=pictures,
            progress=progress,
        )
    return made
