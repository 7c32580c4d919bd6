"""Campaigns: recordings of all combinations of sites, seeds, scenarios, rigs and weather."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, check_room, claimed, replaced_folder
from urbantwin.errors import InputError
from urbantwin.interface.campaign_folder import (
    INDEX,
    KIND,
    SHARDS,
    SPLIT,
    Campaign,
    dataset_name,
    shard_sources,
)
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.progress import Progress

if TYPE_CHECKING:
    from urbantwin.experiments.campaign.file import CampaignFile, Shards
    from urbantwin.experiments.course import Course, Step
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.twin import Twin

__all__ = ["campaign"]

#: Most cells shown in the picture.
_MAX_DRAWN = 12


@dataclass
class CampaignMaker:
    """Runs the steps of a campaign, in any process.

    Attributes:
        file: the campaign's grid.
        folder: the campaign's folder.
        twins: folders of existing twins, by site name.
    """

    file: CampaignFile
    folder: Path
    twins: Mapping[str, Path]
    # Last motion with its twin, kept because motions are large and its recordings are consecutive.
    _last: tuple[str, Twin, Motion] | None = None

    def made(self, step: Step, workers: int, tell: Progress) -> dict[str, Any]:
        """Run a step, and return its entry in the journal."""
        folder = self.folder / step.place
        if step.kind == "twin":
            from urbantwin.interface.twin import build_of, site_with_known_sensors

            site = site_with_known_sensors(self.file.sites[step.name])
            build_of(site, folder, pictures=False, progress=tell)
            return {}
        if step.kind == "motion":
            self._drive(step, folder, tell)
            return {}
        return self._record(step, folder, workers, tell)

    def _twin(self, step: Step) -> Twin:
        from urbantwin.interface.twin import Twin

        site = step.cell["site"]
        return Twin.open(self.twins.get(site, self.folder / "twins" / site))

    def _drive(self, step: Step, folder: Path, tell: Progress) -> None:
        from urbantwin.interface.motion import driven
        from urbantwin.traffic.events import load_scenario

        twin, events = self._twin(step), self.file.scenarios[step.cell["scenario"]]
        changes = {} if events is None else {"scenario": load_scenario(events, twin, step.size)}
        driven(twin, folder, changes, self.file.duration_s, int(step.cell["seed"]), tell)

    def _record(self, step: Step, folder: Path, workers: int, tell: Progress) -> dict[str, Any]:
        from urbantwin.experiments.campaign.index import dataset_counts
        from urbantwin.experiments.campaign.steps import rig_at_rate
        from urbantwin.interface.motion import Motion
        from urbantwin.interface.recording import recorded
        from urbantwin.interface.rig import rig_spec_on

        place = step.needs[-1]
        if self._last is None or self._last[0] != place:
            self._last = place, self._twin(step), Motion.open(self.folder / place)
        _, twin, motion = self._last
        spec, rig_file = rig_spec_on(twin, self.file.rigs[step.cell["rig"]])
        spec = rig_at_rate(spec, self.file.rate_hz)
        setting = next(one for one in self.file.weather if one.name == step.cell["weather"])
        recorded(
            twin,
            motion,
            setting.applied_to(spec),
            rig_file,
            folder,
            start_s=self.file.start_s,
            every=self.file.every,
            storage=self.file.storage,
            split=self.file.time_split,
            workers=workers,
            seed=int(step.cell["seed"]),
            inputs=[twin.folder, motion.folder],
            pictures=False,
            progress=tell,
        )
        return dataset_counts(folder)


def campaign(
    grid: Path,
    out: AnyPath | None = None,
    *,
    plan: bool = False,
    most: int | None = None,
    workers: int | None = None,
    ray: str | None = None,
    progress: ShowProgress = True,
) -> Campaign:
    """Record every site with every seed, scenario, rig and weather; see `experiment.run`.

    A twin is built once per site, a motion is simulated once per site, seed and scenario, and is
    recorded by each rig in each weather. The next call repeats failed steps.

    Raises:
        InputError: the file, or a file that it names, cannot be used, or ``out`` holds another
            campaign.
        StageError: the disk is full.
    """
    from urbantwin.experiments.campaign.file import CampaignFile
    from urbantwin.experiments.campaign.steps import steps_of
    from urbantwin.experiments.course import Course
    from urbantwin.experiments.workers import RUNNING, run_here, run_on_cluster
    from urbantwin.interface.campaign_table import shown_course
    from urbantwin.processes import usable_processors

    file = CampaignFile.read(grid if ray is None else grid.absolute())
    place = beside(file.file, KIND, out)
    place = place if ray is None else place.absolute()
    inputs = _inputs(file)
    check_folder(place / INDEX, kind=KIND, inputs=inputs)
    steps = steps_of(file)
    course = Course(steps.all, place, file.storage)
    other = course.journal.row("grid").get("name", file.file.name)
    if other != file.file.name:  # cells of the same name would replace each other
        raise InputError(
            f"holds the campaign of {other!s:.80}", file=place,
            expected=f"another folder, or that file ({file.file.name} was given)",
        )  # fmt: skip
    count = usable_processors() if workers is None else workers
    if plan:
        return Campaign(place, plan=_plan(course, count))
    with claimed(place / "journal"):
        course = Course(steps.all, place, file.storage)  # another run may have continued
        check_room(place, _least_bytes(file, course), f"the campaign {file.file.name}")
        course.journal.note("grid", state="told", name=file.file.name)
        shutil.rmtree(place / RUNNING, ignore_errors=True)
        show = partial(shown_course, file.file.name, progress)
        try:
            if ray is None:
                maker = CampaignMaker(file, place, steps.twins)
                with show(count) as tell:
                    tell(course)
                    run_here(course, maker, count, most, tell)
            else:
                twins = {name: one.absolute() for name, one in steps.twins.items()}
                maker = CampaignMaker(file, place, twins)
                run_on_cluster(course, maker, ray, inputs, workers, most, show)
        finally:
            shutil.rmtree(place / RUNNING, ignore_errors=True)
        return _finished(file, steps.twins, course, progress)


def _inputs(file: CampaignFile) -> list[Path]:
    others = (*file.rigs.values(), *file.scenarios.values())
    return [file.file, *file.sites.values(), *(one for one in others if one is not None)]


def _plan(course: Course, workers: int) -> dict[str, Any]:
    """Return the remaining work of a campaign, for its summary."""
    plan = course.plan()
    known = plan.measured["dataset"]
    return {
        "cells": len(course.of("dataset")),
        "done": dict(plan.measured),
        "left": plan.steps,
        "frames_left": plan.frames,
        "processor_hours": round(plan.seconds / 3600, 3),
        "hours": round(plan.seconds / 3600 / workers, 3),
        "workers": workers,
        "gigabytes": round(plan.size / 1e9, 3),
        "by": f"what {known} recordings took" if known else "reckoning; --most 1 measures",
    }


def _least_bytes(file: CampaignFile, course: Course) -> float:
    """Return the least number of bytes of datasets and shards."""
    from urbantwin.dataset.dataset_writer import BYTES_PER_POINT, LEAST_LEFT, LEAST_RETURNED

    left = sum(step.work for step in course.to_make if step.kind == "dataset")
    rays = left * LEAST_LEFT[file.storage]
    if file.shards is not None:  # shards hold all frames again, compressed as zstd
        rays += sum(step.work for step in course.of("dataset")) * LEAST_LEFT["zstd"]
    return rays * LEAST_RETURNED * BYTES_PER_POINT


def _finished(
    file: CampaignFile, twins: Mapping[str, Path], course: Course, progress: ShowProgress
) -> Campaign:
    """Write the outputs over all datasets: split, index and shards."""
    from urbantwin.artefact import read_json
    from urbantwin.experiments.campaign.index import index_of, write_index

    place = course.folder
    sources: dict[str, Any] = {}
    for name in file.sites:
        manifest = twins.get(name, place / "twins" / name) / "twin.json"
        if manifest.is_file():
            for one in read_json(manifest, kind="twin")["inputs"]:
                sources[str(one.get("sha256") or one["name"])] = one
    index = index_of(file, course, list(sources.values()))
    made = Campaign(place, index)
    with shown_stage("index", progress, brief=True) as tell:
        tell(0.0, "which scenario is of which part")
        _divide(made, file, course)
        with replaced_folder(place / INDEX, kind=KIND) as folder:
            tell(0.3, "pictures")
            picture = _picture(made, folder)
            write_index(folder, index, picture)
    rows = (*index["datasets"], *index["failed"])
    names = {Path(row["path"]).parts[1] for row in rows}
    datasets = place / "datasets"
    there = [one.name for one in datasets.iterdir()] if datasets.is_dir() else []
    others = sum(not one.startswith(".") and one not in names for one in there)
    if others:
        tell_line(
            f"campaign: {others} datasets in {datasets} are of no cell of this grid: "
            "they stay, and are not in the index",
            progress,
        )
    if index["datasets"] and file.shards is not None:
        _write_shards(made, file.shards, progress)
    return made


def _divide(made: Campaign, file: CampaignFile, course: Course) -> None:
    """Write the split by scenario, and remove an outdated one."""
    from urbantwin.artefact import sha256_of
    from urbantwin.dataset.split import datasets_at, shares_of, split_by_scenario
    from urbantwin.dataset.split.document import write_split_document
    from urbantwin.dataset.split.scenarios import Scenario

    target = made.folder / SPLIT
    groups: dict[tuple[Any, Any], list[Path]] = {}
    for row in made.manifest["datasets"]:
        group = row["levels"]["site"], row["levels"]["seed"]
        groups.setdefault(group, []).append(made.folder / row["path"])
    if file.split.by == "scenario" and len(groups) > 1:  # a single one cannot be divided
        scenarios = [
            Scenario(tuple(datasets_at(folders)), (f"site {site}, seed {seed}",))
            for (site, seed), folders in groups.items()
        ]
        shares = shares_of(file.split.shares)
        written = split_by_scenario(scenarios, shares, moved_m=None, seed=file.split.seed)
        write_split_document(target, written)
        course.journal.note("split", state="told", sha256=sha256_of(target))
    # A split written later by `urbantwin dataset split` is not the campaign's, and stays.
    elif target.is_file() and course.journal.row("split").get("sha256") == sha256_of(target):
        target.unlink()


def _picture(made: Campaign, folder: Path) -> Path | None:
    """Draw a frame of some cells, evenly spread over the grid."""
    rows = made.manifest["datasets"]
    if not rows:
        return None
    from urbantwin.drawing.campaign_cells import cells_picture
    from urbantwin.drawing.labelled_frame import read_labelled_points
    from urbantwin.drawing.pictures import attributions

    count = min(len(rows), _MAX_DRAWN)
    chosen = [rows[number * len(rows) // count] for number in range(count)]
    frames = [
        (dataset_name(row), read_labelled_points(made.folder / row["path"])) for row in chosen
    ]
    (folder / "pictures").mkdir()
    path = folder / "pictures" / "cells.png"
    return cells_picture(frames, path, attribution=attributions(made.manifest))


def _write_shards(made: Campaign, asked: Shards, progress: ShowProgress) -> None:
    from urbantwin.exports.frames.shards import export_shards

    with shown_stage("shards", progress) as tell:
        export_shards(
            shard_sources(made),
            asked.format,
            made.folder / SHARDS,
            size=asked.megabytes * 1e6,
            seed=asked.seed,
            progress=tell,
        )
