"""Sensor placements: search for sensor models and positions before installation."""

from __future__ import annotations

import shutil
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from urbantwin.artefact import check_folder, read_json, replaced_folder
from urbantwin.artefact.tables import read_parquet
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.result_warning import ResultWarning, warnings_of

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from urbantwin.interface.motion import Motion
    from urbantwin.interface.twin import Twin
    from urbantwin.studies.placement.place_file import PlaceSpec

__all__ = ["Placement", "place"]

_KIND = "placement"


class Placement(Artefact):
    """Sensor layouts evaluated on one motion; it can be passed as its folder.

    Attributes:
        folder: the placement's folder; ``report.html`` in it is the report page.
        manifest: content of ``placement.json``.

    Example:
        >>> placement = ut.rig.place(twin, motion, layouts=100)
        >>> ut.record(twin, motion, rig=placement.rigs[-1])
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        file = self.folder / f"{_KIND}.json"
        self.manifest: dict[str, Any] = read_json(file, kind=_KIND)
        from urbantwin.studies.placement.folder import check_placement

        check_placement(self.manifest, file)

    @classmethod
    def open(cls, folder: AnyPath) -> Placement:
        """Open a placement's folder.

        Raises:
            InputError: the folder is not a placement.
        """
        return cls(folder)

    @cached_property
    def layouts(self) -> pa.Table:
        """All evaluated layouts, with their measures and intervals."""
        from urbantwin.studies.placement.folder import read_layouts

        return read_layouts(self.folder / "layouts.parquet")

    @cached_property
    def hidden(self) -> pa.Table:
        """Actors that the layouts of the front miss, and what occludes them from each sensor."""
        return read_parquet(self.folder / "hidden.parquet", "a table of the placement")

    @cached_property
    def trained(self) -> pa.Table | None:
        """Precision and tracking of the layouts that detectors were trained for."""
        path = self.folder / "trained.parquet"
        return read_parquet(path, "a table of the placement") if path.is_file() else None

    @property
    def rigs(self) -> list[Path]:
        """``rig.yaml`` of every layout of the front, in order of ascending cost."""
        return [self.folder / "rigs" / f"{name}.yaml" for name in self.manifest.get("front", ())]

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings."""
        return warnings_of(self.manifest)

    def __repr__(self) -> str:
        """Return the number of evaluated layouts, and the folder."""
        front = len(self.manifest.get("front", ()))
        layouts = self.manifest.get("layouts")
        return f"Placement: {layouts} layouts, {front} on the front ({self.folder})"

    def summary(self) -> Summary:
        """Return the front's main figures."""
        names = ["cost", *(one for one in self.manifest["objectives"] if one != "cost")]
        rows = self.layouts.filter(self.layouts["front"]).select(["layout", *names, "what"])
        rows = rows.sort_by([("cost", "ascending"), ("layout", "ascending")]).to_pylist()
        kept = {
            key: self.manifest[key]
            for key in ("layouts", "views_cast", "candidates", "moments", "actors")
        }
        return Summary(
            path=str(self.folder),
            report=str(self.folder / "report.html"),
            **kept,
            front=rows,
            trained=[] if self.trained is None else self.trained.to_pylist(),
            warnings=[str(one) for one in self.warnings],
        )

    def plot(self) -> Figure:
        """Plot all layouts by cost and the other objectives."""
        from urbantwin.drawing.style import figure_of_picture

        return figure_of_picture(self.folder / "pictures" / "front.png")


@command
def place(
    twin: Twin | AnyPath,
    motion: Motion | AnyPath,
    out: AnyPath | None = None,
    *,
    wish: AnyPath | None = None,
    layouts: Annotated[int, Ge(1)] = 500,
    train: Annotated[int, Ge(0)] = 0,
    steps: Annotated[int, Ge(1)] = 1000,
    seed: Annotated[int, Ge(0)] = 0,
    workers: Annotated[int | None, Ge(1)] = None,
    progress: ShowProgress = True,
) -> Placement:
    """Search for the sensor layouts that see most.

    Each candidate sensor is ray-traced once over the motion, and layouts combine these results: no
    layout needs a recording. After an interruption, the same call continues with the same result.

    Args:
        twin: twin, or its folder.
        motion: motion on the twin, or its folder; the same for all layouts.
        out: folder to write; ``placement`` beside the twin if not given.
        wish: ``place.yaml``: candidate places, models with prices, objectives; poles, signals,
            facades and new poles, and three models, if not given.
        layouts: number of layouts to evaluate.
        train: number of layouts of the front that are also evaluated by detectors (average
            precision and tracking), trained on traffic of another seed.
        steps: training steps of the common detector; each layout's own detector adds a quarter.
        seed: random seed of the search.
        workers: number of processes; every number gives the same bytes.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the request cannot be satisfied (unknown model, a place inside an object, a
            budget below every layout), or ``out`` holds other files.
        StageError: a worker was killed, or the disk is full.

    Example:
        $ urbantwin rig place urbantwin-demo/twin urbantwin-demo/motion -o placement/ --layouts 100
    """
    from urbantwin import __version__
    from urbantwin.dataset.manifest import recipe_key, recipe_of_rig
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.trained_layouts import (
        LayoutTraining,
        shortlist,
        trained_layouts,
        training_words,
    )
    from urbantwin.interface.twin import Twin
    from urbantwin.processes import usable_processors
    from urbantwin.progress import between
    from urbantwin.studies.placement.folder import layout_name, write_placement, write_rig
    from urbantwin.studies.placement.place import ask
    from urbantwin.studies.placement.place import place as search

    if train:
        from urbantwin.learn.torch_device import check_torch

        check_torch("cpu")
    usable = workers or usable_processors()
    target = beside(twin, _KIND, out)
    file = None if wish is None else Path(wish)
    spec = _spec_of(file)
    inputs = [Path(twin), Path(motion), file]
    check_folder(target, kind=_KIND, inputs=inputs)
    on, moving = Twin.open(twin), Motion.open(motion)
    with shown_stage("place", progress) as tell:
        tell(0.0, "where sensors may hang")
        question = ask(on, moving, spec, layouts=layouts, seed=seed, file=file)
        told = {
            "version": __version__,
            "twin_sha256": on.sha256,
            "motion_sha256": moving.sha256(),
        }
        models = recipe_of_rig(question.models)
        asked = {"spec": spec.written(), "models": models, "layouts": layouts, "seed": seed}
        key = recipe_key({**told, **asked, "train": train, "steps": steps})
        with replaced_folder(target, kind=_KIND, inputs=inputs, key=key) as folder:
            casts = folder / "casts"
            found = search(
                question,
                casts,
                workers=usable,
                tell=between(tell, 0.0, 0.4 if train else 1.0),
                say=lambda _, words: tell_line(f"place: {words}", progress),
            )
            trained = None
            if train:
                how = LayoutTraining(steps, seed=seed, workers=usable)
                numbers = shortlist(found.front, train)
                tell_line(f"place: {training_words(len(numbers), how)}", progress)
                rigs = {}
                for number in numbers:
                    rigs[number] = folder / "training" / "rigs" / f"{layout_name(number)}.yaml"
                    rigs[number].parent.mkdir(parents=True, exist_ok=True)
                    write_rig(found, found.found[number].layout, rigs[number])
                trained = trained_layouts(
                    rigs, on, moving, folder / "training", how, between(tell, 0.4, 1.0)
                )
                shutil.rmtree(folder / "training")
            write_placement(folder, found, told, trained)
            shutil.rmtree(casts)
    made = Placement(target)
    tell_result("place", target, made.warnings, progress)
    return made


def _spec_of(file: Path | None) -> PlaceSpec:
    from urbantwin.studies.placement.place_file import PlaceSpec, load_place_spec

    return PlaceSpec() if file is None else load_place_spec(file)
