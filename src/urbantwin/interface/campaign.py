"""Campaigns: sites, seeds, scenarios, rigs and weather recorded with each other."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from multiprocessing import active_children
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

if TYPE_CHECKING:
    from collections.abc import Callable

    from urbantwin.campaigns import CampaignFile, Course, Outcome, Step
    from urbantwin.campaigns.costs import Plan
    from urbantwin.campaigns.course import Pool
    from urbantwin.campaigns.grid_file import Shards

__all__ = ["campaign"]

#: So many cells are in the picture.
_PICTURED = 12


def campaign(
    grid: AnyPath,
    out: AnyPath | None = None,
    *,
    plan: bool = False,
    most: int | None = None,
    workers: int | None = None,
    ray: str | None = None,
    progress: ShowProgress = True,
) -> Campaign:
    """Record every site with every seed, scenario, rig and weather; the same call goes on.

    A twin is built once for each site, a motion driven once for each site, seed and scenario, and
    recorded by each rig in each weather. What is done stays done, also where the grid changes; what
    failed is tried once more, and again by the next call.

    Args:
        grid: the campaign's file: sites, seeds, scenarios, rigs, weather.
        out: the folder to write; ``campaign`` beside the file when not given.
        plan: only say what is left to do, how long it takes and how large it is.
        most: record so many datasets at most, now; what they take is what a plan then goes by.
        workers: processes to work with; every number gives the same bytes.
        ray: a Ray cluster whose nodes all see the files and ``out``, a cell on each of their
            processors: ``HOST:PORT`` of its head, ``auto`` for the one that runs here, ``local`` to
            start one.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: the file or what it names cannot be used, or ``out`` holds another campaign.
        StageError: the disk is full.

    Example:
        >>> ut.experiment.run("grid.yaml", plan=True).summary()
        >>> ut.experiment.run("grid.yaml").where(weather="fog", split="train")
    """
    from urbantwin.campaigns import Course, load_campaign, steps_of
    from urbantwin.campaigns.costs import planned
    from urbantwin.processes import usable_processors

    for name, value in (("workers", workers), ("most", most)):
        if value is not None and value < 1:
            raise InputError(f"is {value}", place=f"--{name}", expected="1 or more")
    asked = load_campaign(Path(grid) if ray is None else Path(grid).absolute())
    place = beside(asked.file, KIND, out)
    place = place if ray is None else place.absolute()
    check_folder(place / INDEX, kind=KIND, inputs=_inputs(asked))
    steps = steps_of(asked)
    course = Course(steps, place)
    _refuse_another(course)
    count = usable_processors() if workers is None else workers
    if plan:
        return Campaign(place, plan=_told_plan(planned(course), course, count))
    with claimed(place / "journal"):
        course = Course(steps, place)  # what another run has done meanwhile is done
        check_room(place, _least_bytes(course), f"the campaign {asked.file.name}")
        course.journal.note("grid", state="told", name=asked.file.name)
        running = place / "journal" / "running"
        shutil.rmtree(running, ignore_errors=True)
        try:
            if ray is None:
                _run(course, count, most, progress)
            else:
                _run_on_cluster(course, ray, workers, most, progress)
        finally:
            shutil.rmtree(running, ignore_errors=True)
        return _finished(course, progress)


def _inputs(asked: CampaignFile) -> list[Path]:
    others = (*asked.rigs.values(), *asked.scenarios.values())
    return [asked.file, *asked.sites.values(), *(one for one in others if one is not None)]


def _refuse_another(course: Course) -> None:
    """Refuse a folder that is another grid's: cells of the same name would replace each other."""
    name = course.journal.row("grid").get("name")
    if name is not None and name != course.steps.asked.file.name:
        raise InputError(
            f"holds the campaign of {name!s:.80}", file=course.place,
            expected=f"another folder, or that file ({course.steps.asked.file.name} was given)",
        )  # fmt: skip


def _told_plan(plan: Plan, course: Course, workers: int) -> dict[str, Any]:
    known = plan.measured["dataset"]
    done = {kind: course.counts[kind]["done"] for kind in course.counts}
    return {
        "cells": course.totals["dataset"],
        "done": done,
        "left": plan.steps,
        "frames_left": plan.frames,
        "processor_hours": round(plan.seconds / 3600, 3),
        "hours": round(plan.seconds / 3600 / workers, 3),
        "workers": workers,
        "gigabytes": round(plan.size / 1e9, 3),
        "by": f"what {known} recordings took" if known else "reckoning; --most 1 measures",
    }


def _least_bytes(course: Course) -> float:
    from urbantwin.dataset.dataset_writer import BYTES_PER_POINT, LEAST_LEFT, LEAST_RETURNED

    asked, points = course.steps.asked, LEAST_RETURNED * BYTES_PER_POINT
    room = course.work["dataset"] * points * LEAST_LEFT[asked.storage]
    if asked.shards is not None:  # hold all frames once more, packed as zstd packs them
        room += sum(one.work for one in course.steps.of("dataset")) * points * LEAST_LEFT["zstd"]
    return room


class _Here:
    """A pool of this process alone: what is submitted is done at once."""

    def submit(self, function: Callable[[Step], Outcome], step: Step, /) -> Future[Outcome]:
        future: Future[Outcome] = Future()
        future.set_result(function(step))
        return future


def _run(course: Course, workers: int, most: int | None, progress: ShowProgress) -> None:
    """Make what is left: cells beside each other, or frames where there are few cells."""
    from urbantwin.interface.campaign_step import Maker, make
    from urbantwin.interface.campaign_table import shown_course

    cells = sum(one.kind == "dataset" for one in course.to_make)
    cells = cells if most is None else min(cells, most)
    asked, twins = course.steps.asked, dict(course.steps.twins)
    with shown_course(progress, workers) as tell:
        tell(course)
        if workers == 1 or cells < workers:
            maker = Maker(asked, course.place, twins, workers, watch=lambda: tell(course))
            course.run(_Here(), maker.outcome, abreast=1, tell=tell, most=most)
            return
        maker = Maker(asked, course.place, twins)
        while True:
            begun = course.counts["dataset"]["done"]
            try:
                with _pool(maker, workers) as pool:
                    course.run(pool, make, abreast=workers, tell=tell, most=most)
                return
            except BrokenExecutor:  # a worker was killed: what it was at is tried again
                if most is not None:
                    most -= course.counts["dataset"]["done"] - begun


def _run_on_cluster(
    course: Course, ray: str, workers: int | None, most: int | None, progress: ShowProgress
) -> None:
    """Make what is left on the nodes of a Ray cluster, which share the campaign's folder."""
    from urbantwin.cluster import connected
    from urbantwin.dataset.manifest import versions_here
    from urbantwin.interface.campaign_step import Maker, begin, check_seen, make
    from urbantwin.interface.campaign_table import shown_course

    asked = course.steps.asked
    twins = {name: one.absolute() for name, one in course.steps.twins.items()}
    with connected(ray, agreed=versions_here, workers=workers) as cluster:
        cluster.on_every_node(check_seen, [course.place / "journal", *_inputs(asked)])
        with (
            cluster.worker_pool(begin, Maker(asked, course.place, twins)) as pool,
            shown_course(progress, pool.workers) as tell,
        ):
            course.run(pool, make, abreast=pool.workers, tell=tell, most=most)


@contextmanager
def _pool(maker: Any, workers: int) -> Iterator[Pool]:  # noqa: ANN401
    """Yield a pool of processes that make steps; what is half made when it is cut off goes."""
    from urbantwin.interface.campaign_step import begin
    from urbantwin.processes import worker_pool

    before = set(active_children())
    with worker_pool(workers, begin, maker) as pool:
        try:
            yield pool
        except BaseException:
            # A cell may take an hour. What is recorded of it stays, for the next run.
            for worker in set(active_children()) - before:
                worker.terminate()
            raise


def _finished(course: Course, progress: ShowProgress) -> Campaign:
    """Write what is over all datasets: the split, the index and the shards."""
    from urbantwin.artefact import read_json
    from urbantwin.campaigns.index import index_of, write_index

    place, steps = course.place, course.steps
    sources: dict[str, Any] = {}
    for name in steps.asked.sites:
        file = steps.twins.get(name, place / "twins" / name) / "twin.json"
        if file.is_file():
            for one in read_json(file, kind="twin")["inputs"]:
                sources[str(one.get("sha256") or one["name"])] = one
    index = index_of(course, list(sources.values()))
    made = Campaign(place, index)
    with shown_stage("index", progress, brief=True) as tell:
        tell(0.0, "which scenario is of which part")
        _divide(made, course)
        with replaced_folder(place / INDEX, kind=KIND) as folder:
            tell(0.3, "pictures")
            picture = _picture(made, folder)
            write_index(folder, index, picture)
    others = _others(made)
    if others:
        tell_line(
            f"campaign: {others} datasets in {place / 'datasets'} are of no cell of this grid: "
            "they stay, and are not in the index",
            progress,
        )
    if index["datasets"] and steps.asked.shards is not None:
        _write_shards(made, steps.asked.shards, progress)
    return made


def _others(made: Campaign) -> int:
    """Return how many datasets of an earlier grid are still there."""
    rows = (*made.manifest["datasets"], *made.manifest["failed"])
    names = {Path(row["path"]).parts[1] for row in rows}
    folder = made.folder / "datasets"
    there = [one.name for one in folder.iterdir()] if folder.is_dir() else []
    return sum(not one.startswith(".") and one not in names for one in there)


def _divide(made: Campaign, course: Course) -> None:
    """Write the split that is asked for; one of an earlier grid, or of more datasets, goes."""
    from urbantwin.artefact import sha256_of

    file, asked = made.folder / SPLIT, course.steps.asked.by_scenario
    rows = made.manifest["datasets"]
    kept = {(row["levels"]["site"], row["levels"]["seed"]) for row in rows}
    if asked is not None and len(kept) > 1:  # one alone cannot be divided
        _split_by_scenario(made, *asked)
        course.journal.note("split", state="told", sha256=sha256_of(file))
    # What `urbantwin dataset split` put there since is not the campaign's, and stays.
    elif file.is_file() and course.journal.row("split").get("sha256") == sha256_of(file):
        file.unlink()


def _split_by_scenario(made: Campaign, shares: tuple[float, float, float], seed: int) -> None:
    """Write ``split.json``: recordings of a site and a seed are one scenario, in one part."""
    from urbantwin.dataset.split import datasets_at, split_by_scenario
    from urbantwin.dataset.split.document import write_split_document
    from urbantwin.dataset.split.scenarios import Scenario

    groups: dict[tuple[Any, Any], list[Path]] = {}
    for row in made.manifest["datasets"]:
        key = row["levels"]["site"], row["levels"]["seed"]
        groups.setdefault(key, []).append(made.folder / row["path"])
    scenarios = [
        Scenario(tuple(datasets_at(folders)), (f"site {site}, seed {seed_of}",))
        for (site, seed_of), folders in groups.items()
    ]
    told = split_by_scenario(scenarios, shares, moved_m=None, seed=seed)
    write_split_document(made.folder / SPLIT, told)


def _picture(made: Campaign, folder: Path) -> Path | None:
    """Draw a frame of some cells, as far apart as they can be."""
    rows = made.manifest["datasets"]
    if not rows:
        return None
    from urbantwin.drawing.campaign_cells import cells_picture
    from urbantwin.drawing.labelled_frame import read_labelled_points
    from urbantwin.drawing.pictures import attributions

    count = min(len(rows), _PICTURED)
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
