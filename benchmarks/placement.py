"""Placement judged: points against recordings, surrogates against trained detectors, other traffic.

    python benchmarks/placement.py TWIN MOTION OTHER_MOTION WORK [--layouts 12] [--steps 600]
        [--validate 4] [--no-train]

Both motions are on the twin. Three questions, each answered in ``WORK/placement.json`` and printed:

- **points**: of some layouts, expected points on each actor against a full recording of the rig.
- **surrogates**: over layouts that differ much, Spearman's rank correlation of every measure with
  the average precision of a detector trained for each layout, with a bootstrap interval over
  layouts. It is what it is: few layouts give a wide interval.
- **traffic**: the same layouts judged by the other motion: rank correlation of each measure with
  itself; and of the precision with a detector's of another seed, with ``--seeds 2``.

What is made lies in WORK, and is not made again.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np
import yaml
from scipy.stats import spearmanr

import urbantwin as ut
from urbantwin.interface.trained_layouts import LayoutTraining, trained_layouts
from urbantwin.studies.placement.judge import Judge
from urbantwin.studies.placement.measure import MEASURES, SURROGATES
from urbantwin.studies.placement.place import Question, ask
from urbantwin.studies.placement.place_file import PlaceSpec, load_place_spec
from urbantwin.studies.placement.search import search
from urbantwin.studies.placement.sighting import casts_in

DRAWS, SEED = 2000, 19


def main() -> None:
    """Answer the three questions."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("twin", "motion", "other", "work"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--wish", type=Path)
    parser.add_argument("--searched", type=int, default=120)
    parser.add_argument("--layouts", type=int, default=12)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--learn", type=int, default=80)
    parser.add_argument("--judge", type=int, default=60)
    parser.add_argument("--own", type=float, default=0.25)
    parser.add_argument("--reach", type=float, default=60.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--validate", type=int, default=4)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--train", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    out = given.work / "placement.json"
    told = json.loads(out.read_text()) if out.is_file() else {}

    def keep(name: str, value: object) -> None:
        told[name] = value
        out.write_text(json.dumps(told, indent=1))
        print(name, json.dumps(value, indent=1), flush=True)

    twin = ut.open(given.twin)
    spec = PlaceSpec() if given.wish is None else load_place_spec(given.wish)
    motions = {name: ut.open(getattr(given, name)) for name in ("motion", "other")}
    asked = {
        name: ask(twin, one, spec, layouts=given.searched, seed=1, file=given.wish)
        for name, one in motions.items()
    }
    began, used = time.perf_counter(), processor_s()
    values, layouts = {}, []
    for name, question in asked.items():
        judge = Judge(question.recipe.moments, question.recipe.squares, question.recipe.voxels)
        place = given.work / f"casts-{name}"
        with casts_in(place, question.views, question.recipe, given.workers) as casts:

            def judged(some, casts=casts, judge=judge, question=question):
                casts.ensure([number for one in some for number in one])
                return [judge.verdict(casts.of(one), question.views.cost(one)) for one in some]

            if name == "motion":
                found = search(question.views, judged, layouts=given.searched, seed=1)
                layouts = spread([one.layout for one in found], found, given.layouts)
                keep("search", {
                    "layouts": len(found), "views_cast": casts.made,
                    "moments": len(question.recipe.moments.every),
                    "wall_s": time.perf_counter() - began, "processor_s": processor_s() - used,
                })  # fmt: skip
            values[name] = [one.values for one in judged(layouts)]
            if name == "motion" and given.validate:
                keep("points", validated(question, casts, layouts[: given.validate], given.work))
    keep("layouts", [
        {"layout": one, "sensors": len(one), **row}
        for one, row in zip(layouts, values["motion"], strict=True)
    ])  # fmt: skip
    keep("traffic", {
        name: correlation([row[name] for row in values["motion"]],
                          [row[name] for row in values["other"]])
        for name in MEASURES if name != "cost"
    })  # fmt: skip
    if given.train:
        for seed in range(given.seeds):
            rows = precision(asked["motion"], layouts, given, seed)
            keep(f"trained_{seed}", rows)
            for kind in ("ap", "hota"):
                keep(f"surrogates_{kind}_{seed}", {
                    name: correlation([row[name] for row in values["motion"]],
                                      [row[kind] for row in rows])
                    for name in ("cost", *SURROGATES)
                })  # fmt: skip
        if given.seeds > 1:
            first, second = ([row["ap"] for row in told[f"trained_{seed}"]] for seed in range(2))
            keep("precision_of_other_seed", correlation(first, second))


def processor_s() -> float:
    """Return the processor time of this process and its workers so far, seconds."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(one.ru_utime + one.ru_stime for one in map(resource.getrusage, kinds))


def spread(layouts: list, found: list, count: int) -> list:
    """Return layouts evenly spread over how much they see: the bad ones, too."""
    order = np.argsort([one.verdict.values["seen_20"] for one in found], kind="stable")
    rows = np.unique(np.round(np.linspace(0, len(order) - 1, count)).astype(int))
    return [layouts[order[k]] for k in rows]


def rig_of(question: Question, layout: tuple[int, ...], path: Path) -> Path:
    """Write the rig of a layout."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        yaml.safe_dump(question.views.rig_spec(layout).written(), sort_keys=False), encoding="utf-8"
    )
    return path


def validated(question: Question, casts: object, layouts: list, work: Path) -> list[dict]:
    """Return how expected points compare with those of full recordings."""
    rows = []
    targets, every = question.recipe.moments.targets, question.recipe.moments.every
    for number, layout in enumerate(layouts):
        rig = rig_of(question, layout, work / "rigs" / f"valid-{number}.yaml")
        step = round(question.recipe.moments.step_s * question.spec.rate_hz)
        began = time.perf_counter()
        data = work / ("valid-" + "-".join(map(str, layout)))
        if not data.exists():
            ut.record(
                question.twin, question.motion, data, rig=rig, every=step, workers=1,
                pictures=False, progress=False,
            )  # fmt: skip
        took = time.perf_counter() - began
        boxes = ut.open(data).boxes
        key = zip(boxes["time_s"].to_pylist(), boxes["track"].to_pylist(), strict=True)
        points = dict(
            zip(((round(t, 3), k) for t, k in key), boxes["num_points"].to_pylist(), strict=True)
        )
        expected = np.stack([one.points for one in casts.of(layout)]).sum(axis=0)
        real = np.array([
            points[round(every[m].time_s, 3), int(k)]
            for m, k in zip(targets.moment, targets.track, strict=True)
        ])  # fmt: skip
        off = expected - real
        rows.append({
            "sensors": len(layout), "rows": len(real),
            "points_expected": float(expected.sum()), "points_recorded": int(real.sum()),
            "bias_percent": float(100 * off.sum() / max(real.sum(), 1)),
            "off_mean": float(off.mean()), "off_sd": float(off.std()),
            "off_95": np.percentile(off, [2.5, 97.5]).tolist(),
            **{f"seen_{n}": [float((expected >= n - 0.5).mean()), float((real >= n).mean()),
                             float(((expected >= n - 0.5) != (real >= n)).mean())]
               for n in (5, 20, 50)},
            "record_s": took,
        })  # fmt: skip
    return rows


def precision(
    question: Question, layouts: list, given: argparse.Namespace, seed: int
) -> list[dict]:
    """Return what detectors of the layouts find, in the order of the layouts."""
    rigs = {
        number: rig_of(question, layout, given.work / "rigs" / f"layout-{number}.yaml")
        for number, layout in enumerate(layouts)
    }
    how = LayoutTraining(
        given.steps,
        reach_m=given.reach,
        own_share=given.own,
        learn=given.learn,
        judge=given.judge,
        seed=seed,
        workers=given.workers,
    )
    return trained_layouts(
        rigs, question.twin, question.motion, given.work / f"training-{seed}", how,
        lambda share, doing: print(f"{100 * share:.0f} % {doing}", flush=True),
    )  # fmt: skip


def correlation(some: list, others: list) -> dict[str, float | list[float] | int | None]:
    """Return Spearman's rank correlation, with its 95 % interval (bootstrap over layouts)."""
    pairs = np.array(
        [(a, b) for a, b in zip(some, others, strict=True) if None not in (a, b)], float
    )
    random = np.random.default_rng(SEED)
    drawn = []
    for _ in range(DRAWS):
        chosen = pairs[random.integers(0, len(pairs), len(pairs))]
        if len(np.unique(chosen[:, 0])) > 1 and len(np.unique(chosen[:, 1])) > 1:
            drawn.append(spearmanr(*chosen.T).statistic)
    flat = len(np.unique(pairs[:, 0])) < 2 or len(np.unique(pairs[:, 1])) < 2
    return {
        "rho": None if flat else round(float(spearmanr(*pairs.T).statistic), 3),
        "ci95": [round(float(x), 3) for x in np.percentile(drawn, [2.5, 97.5])] if drawn else None,
        "n": len(pairs),
    }


if __name__ == "__main__":
    main()
