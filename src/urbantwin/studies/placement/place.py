"""Placement algorithm: mounts, views traced once, layouts combined, evaluated and searched."""

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

#: Number of moments traced to measure the time.
_TRIAL_MOMENTS = 6
#: Estimated fraction of new views among those of a search's layouts; the others recur.
_NEW_VIEWS = 0.6


@dataclass(frozen=True, eq=False)
class Question:
    """A search, checked before any ray is traced.

    Attributes:
        spec: ``place.yaml`` with its defaults.
        twin: the twin.
        motion: motion for the evaluation of all layouts.
        mounts: candidate places of sensors.
        views: all views.
        recipe: common data: the motion's moments, the ground, the sensors' models.
        models: a rig with a sensor of each model.
        layouts: number of layouts to evaluate.
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
    """Details of a layout of the front.

    Attributes:
        number: number of the layout.
        by_class: points on actors by class and range.
        hidden: actors that are not seen, with occluders.
    """

    number: int
    by_class: tuple[ClassPoints, ...]
    hidden: tuple[Hidden, ...]


@dataclass(frozen=True, eq=False)
class Placed:
    """Result of a search.

    Attributes:
        question: the search.
        found: all evaluated layouts, in order of evaluation.
        front: numbers of the Pareto-optimal layouts, in order of ascending cost.
        explained: details of each layout of the front.
        views_cast: number of traced views.
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
    """Check a search, and find candidate places.

    Args:
        twin: the twin.
        motion: motion on the twin.
        spec: settings of the search.
        layouts: number of layouts to evaluate.
        seed: random seed of the search.
        file: ``place.yaml``, for errors.

    Raises:
        InputError: an unknown model, no candidate place, one inside an object, a budget below every
            layout, a motion without actors or of another twin, or the extra ``tune`` is not
            installed.
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
    """Search for layouts.

    Args:
        question: the search.
        scratch: folder of traced views, from which an interrupted search continues.
        workers: number of processes; every number gives the same result.
        first: initial layouts.
        tell: called with the fraction done and a description.
        say: called with the expected time, seconds, and its description, once known.

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
    """Return the estimated time of a search, seconds, from one view of each model, and in words."""
    views, moments = question.views, question.recipe.moments
    few, seconds = min(_TRIAL_MOMENTS, len(moments.every)), []
    for model in range(len(question.spec.models)):
        number = next(n for n, one in enumerate(views.every) if one.model == model)
        mounted = views.hung(number, question.recipe.models)
        # The first call includes one-time work and is not counted.
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
    """Return the time to trace some moments, seconds."""
    began = time.perf_counter()
    casts.here.cast(mounted, model, moments)
    return time.perf_counter() - began
