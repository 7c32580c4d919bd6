"""Placement, as its algorithm: mounts, views cast once, layouts combined, judged and searched."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.lidar import Rig
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sight.junction import Junction
from urbantwin.progress import Progress, untold
from urbantwin.studies.placement.beam_voxels import occupied_voxels
from urbantwin.studies.placement.judge import ClassPoints, Hidden, Judge, Verdict, hidden_actors
from urbantwin.studies.placement.moments import Squares, moments_of
from urbantwin.studies.placement.mount import Mounts, find_mounts
from urbantwin.studies.placement.place_file import PlaceSpec
from urbantwin.studies.placement.search import Found, pareto_front, possible_layouts, search
from urbantwin.studies.placement.sighting import Casts, Recipe, casts_in
from urbantwin.studies.placement.view import Layout, Views
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["Explained", "Placed", "Question", "ask", "place"]

#: Number of moments that are cast to measure how long one takes.
_TRIAL_MOMENTS = 6
#: Share of the views of layouts that are new, in a search that finds good ones: the others recur.
_NEW_VIEWS = 0.6


@dataclass(frozen=True, eq=False)
class Question:
    """What is searched, checked before anything is cast.

    Attributes:
        spec: ``place.yaml`` with its defaults.
        twin: the twin.
        motion: that all layouts see.
        mounts: where sensors may hang.
        views: every view.
        recipe: what all casts share: the motion's moments, the ground, the sensors' models.
        models: a rig with a sensor of each model.
        layouts: number of layouts to judge.
    """

    spec: PlaceSpec
    twin: Twin
    motion: Motion
    mounts: Mounts
    views: Views
    recipe: Recipe
    models: Rig
    layouts: int


@dataclass(frozen=True)
class Explained:
    """A layout of the front, looked at closely.

    Attributes:
        number: among all layouts.
        by_class: points on actors by class and range.
        hidden: actors that are not seen, and why.
    """

    number: int
    by_class: tuple[ClassPoints, ...]
    hidden: tuple[Hidden, ...]


@dataclass(frozen=True, eq=False)
class Placed:
    """What a search found.

    Attributes:
        question: what was searched.
        found: every layout that was judged, in the order in which it was.
        front: numbers of those that no other is better than, the cheapest first.
        explained: each of the front, looked at closely.
        views_cast: how many views it took.
    """

    question: Question
    found: tuple[Found, ...]
    front: tuple[int, ...]
    explained: tuple[Explained, ...]
    views_cast: int


def ask(
    twin: Twin,
    motion: Motion,
    spec: PlaceSpec,
    *,
    layouts: int,
    seed: int,
    file: Path | None = None,
) -> Question:
    """Check a question, and find where sensors may hang.

    Args:
        twin: the twin.
        motion: on it.
        spec: what is searched.
        layouts: number of layouts to judge.
        seed: of the search.
        file: ``place.yaml``, for errors.

    Raises:
        InputError: an unknown model, no place to hang a sensor, one inside something, a budget
            that no layout meets, a motion without actors or of another twin, or the extra
            ``tune`` is not installed.
    """
    check_extra("tune", "a search for layouts")
    if motion.manifest["twin_sha256"] != twin.sha256:
        raise InputError("the motion was made on another twin", expected="a motion on this twin")
    spec.sensors_of_models(file)
    junction = Junction(np.array(spec.middle_m), twin.roads, twin.region, twin.mesh)
    mounts = find_mounts(spec, twin, junction, file)
    views = Views(spec, mounts.every, file)
    rooms = sum(len(one.heights_m) for one in mounts.every)
    if rooms < spec.sensors.least:
        raise InputError(
            f"there is room for {rooms} sensors",
            file=file,
            place="sensors.least",
            expected=f"{rooms} or fewer, or more candidates",
        )
    cheapest = views.cost(views.cheapest())
    if spec.budget is not None and cheapest > spec.budget:
        raise InputError(
            f"no layout costs {spec.budget:g} or less: the cheapest costs {cheapest:g}",
            file=file,
            place="budget",
            expected=f"{cheapest:g} or more, fewer sensors, or cheaper models",
        )
    near = shapely.Point(spec.middle_m).buffer(spec.reach_m)
    where = shapely.intersection(twin.region, near)
    moments = moments_of(motion, where, spec.rate_hz, spec.step_s)
    models = views.models(twin.mesh, twin.reflectivity)
    recipe = Recipe(
        twin.mesh,
        twin.surface_materials,
        motion.meshes,
        moments,
        Squares(junction.ground, junction.ground.on_crossings(twin.roads)),
        occupied_voxels(moments.targets, len(moments.every), spec.voxel_m),
        models.sensors,
        spec.conditions,
        seed,
    )
    return Question(spec, twin, motion, mounts, views, recipe, models, layouts)


def place(
    question: Question,
    scratch: Path,
    *,
    workers: int = 1,
    first: Sequence[Layout] = (),
    tell: Progress | None = None,
    say: Progress | None = None,
) -> Placed:
    """Search.

    Args:
        question: what is searched.
        scratch: folder for what is cast; an interrupted search goes on from there.
        workers: processes that cast; every number finds the same.
        first: layouts to begin with.
        tell: called with the share that is done and what is being done.
        say: called with the expected seconds, and these in words, once they are known.

    Raises:
        StageError: a worker was killed.
    """
    report = tell or untold
    report(0.0, "static world")
    views, recipe, layouts = question.views, question.recipe, question.layouts
    with casts_in(scratch, views, recipe, workers) as casts:
        if say is not None:
            say(*_forecast(question, casts, workers))
        judge = Judge(recipe.moments, recipe.squares, recipe.voxels)
        done = 0

        def judged(asked: Sequence[Layout]) -> list[Verdict]:
            def count(made: int, of: int) -> None:
                share = 0.98 * (done + len(asked) * made / of) / layouts
                report(share, f"view {casts.made}, layout {done}")

            casts.ensure([number for layout in asked for number in layout], count)
            return [judge.verdict(casts.of(layout), views.cost(layout)) for layout in asked]

        def counted(count: int) -> None:
            nonlocal done
            done = count
            report(0.98 * count / layouts, f"layout {count} of {layouts}")

        found = search(views, judged, layouts=layouts, seed=recipe.seed, first=first, tell=counted)
        front = pareto_front(found, question.spec.objectives)
        front.sort(key=lambda n: (found[n].verdict.values["cost"], n))
        report(0.98, "what is hidden")
        explained = []
        for number in front:
            seen = casts.of(found[number].layout)
            hidden = hidden_actors(recipe.moments, seen)
            explained.append(Explained(number, tuple(judge.by_class(seen)), tuple(hidden)))
        used = {number for one in found for number in one.layout}
        return Placed(question, tuple(found), tuple(front), tuple(explained), len(used))


def _forecast(question: Question, casts: Casts, workers: int) -> tuple[float, str]:
    """Return how many seconds a search takes, from one view of each model, and that in words."""
    views, moments = question.views, question.recipe.moments
    few, seconds = min(_TRIAL_MOMENTS, len(moments.every)), []
    for model in range(len(question.spec.models)):
        number = next(n for n, one in enumerate(views.every) if one.model == model)
        mounted = views.hung(number, question.recipe.models)
        # What is made once, in the first cast, does not count.
        _, first, several = (_seconds(casts, mounted, model, count) for count in (1, 1, few))
        per_moment = max(several - first, 0.0) / max(few - 1, 1)
        seconds.append(first + per_moment * (len(moments.every) - 1))
    sensors = (question.spec.sensors.least + question.spec.sensors.most) / 2
    layouts = min(question.layouts, possible_layouts(views))
    count = min(len(views.every), int(layouts * sensors * _NEW_VIEWS) + 1)
    total = count * float(np.mean(seconds)) / max(workers, 1)
    words = f"{total / 60:.0f} min" if total >= 90 else f"{max(total, 1):.0f} s"
    return total, (
        f"{len(question.mounts.every)} places, {len(views.every)} views, {layouts} layouts, "
        f"{len(moments.every)} moments with {len(np.unique(moments.targets.track))} actors: "
        f"about {words}"
    )


def _seconds(casts: Casts, mounted: MountedSensor, model: int, moments: int) -> float:
    """Return how long a cast of some moments takes, seconds."""
    began = time.perf_counter()
    casts.here.cast(mounted, model, moments)
    return time.perf_counter() - began
