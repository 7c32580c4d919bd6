"""What a study leaves: ``study.json``, tables (Parquet and CSV), pictures and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.experiments.grid import level_text
from urbantwin.experiments.study.effects import Measured, interactions_of, main_effects_of
from urbantwin.experiments.study.factors import by_clock
from urbantwin.experiments.study.figure import draw_effects, draw_levels
from urbantwin.experiments.study.file import StudyFile
from urbantwin.experiments.study.judging import ALL, METRICS
from urbantwin.pages import write_page

__all__ = ["KIND", "write_study"]

KIND = "study"
#: What is told in per cent.
_PERCENT = ("seen", "in_box", "ap", "ap_overlap", "recall", "hota", "mota", "idf1")

#: A detector with less average precision has nothing to lose.
_LEAST_PRECISION = 0.1


def write_study(
    folder: Path,
    study: StudyFile,
    measured: Sequence[Measured],
    objects: Sequence[Mapping[str, int]],
    failed: Sequence[Mapping[str, Any]],
    told: Mapping[str, Any],
    doubts: Sequence[str] = (),
) -> dict[str, Any]:
    """Write everything into a folder.

    Args:
        folder: where.
        study: what was asked for.
        measured: figures of every recording that succeeded, seed by seed.
        objects: how many objects count, by class, in the same order.
        failed: ``seed``, ``cell`` and ``why`` of those that did not.
        told: what else ``study.json`` says: what it was made from.
        doubts: that are known beside those of the figures.

    Returns:
        What ``study.json`` holds.
    """
    axes = study.axes
    effects = main_effects_of(measured, axes)
    together = interactions_of(measured, axes) if study.design == "factorial" else []
    _write_tables(folder, study, measured, objects, effects, together)
    doubts = [*_weak(effects), *doubts, *_doubts(study, measured, failed)]
    report: dict[str, Any] = {
        "kind": KIND,
        "schema": 1,
        **told,
        "design": study.design,
        "factors": {
            one.axis.name: {
                "levels": [level_text(level) for level in one.axis.levels],
                "told": one.factor.told,
                **({"sensors": list(one.sensors)} if one.sensors else {}),
            }
            for one in study.factors
        },
        "seeds": list(study.seeds),
        "recordings": len(measured),
        "failed": list(failed),
        "doubts": doubts,
        "figures": dict(METRICS),
        "in_short": _in_short(effects, len(study.seeds)),
        "effects": [row for row in effects if row["class"] == ALL],
        "warnings": [],
    }
    pictures = folder / "pictures"
    pictures.mkdir()
    drawn = {}
    if effects:
        drawn = {"Effects": pictures / "effects.png", "Levels": pictures / "levels.png"}
        draw_effects(effects, ALL, drawn["Effects"])
        draw_levels(_along(study, measured), ALL, drawn["Levels"])
    classes = sorted(dict.fromkeys(row["class"] for row in effects), key=lambda name: name != ALL)
    write_page(
        folder / "study.html",
        "experiments/study/page.html.j2",
        report=report,
        all=ALL,
        effects={name: [row for row in effects if row["class"] == name] for name in classes},
        together=[row for row in together if row["class"] == ALL],
        in_percent=_PERCENT,
        sensors={
            one.axis.name: ", ".join(one.sensors) or ("first" if one.factor.first_sensor else "all")
            for one in study.factors
        },
        pictures=drawn,
    )
    written: dict[str, Any] = as_json(report)
    write_json(folder / f"{KIND}.json", written)
    return written


def _along(
    study: StudyFile, measured: Sequence[Measured]
) -> list[tuple[str, str, int, Mapping[str, float]]]:
    """Return factor, level, seed and figures where all other factors are at their base."""
    found = []
    for axis in study.axes:
        for level in axis.levels:
            for one in measured:
                if one.cell.levels[axis.name] == level and set(one.cell.varied(study.axes)) <= {
                    axis.name
                }:
                    row = (axis.name, level_text(level), one.seed, one.figures.get(ALL, {}))
                    found.append(row)
    return found


def _write_tables(
    folder: Path,
    study: StudyFile,
    measured: Sequence[Measured],
    objects: Sequence[Mapping[str, int]],
    effects: Sequence[Mapping[str, Any]],
    together: Sequence[Mapping[str, Any]],
) -> None:
    rows = [
        {
            "cell": one.cell.name(study.axes),
            **{name: level_text(level) for name, level in one.cell.levels.items()},
            "seed": one.seed,
            "class": name,
            "objects": counts.get(name, 0),
            **{key: figures.get(key) for key in METRICS},
        }
        for one, counts in zip(measured, objects, strict=True)
        for name, figures in one.figures.items()
    ]
    for name, table in (("cells", rows), ("effects", effects), ("interactions", together)):
        if table:
            _write_table(folder / name, table)


def _write_table(stem: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    import pyarrow as pa

    kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
    schema = pa.schema(
        [
            (
                name,
                next(
                    (kinds[type(row[name])] for row in rows if row[name] is not None), pa.float64()
                ),
            )
            for name in rows[0]
        ]
    )
    table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
    write_parquet_and_csv(stem, table)


def _weak(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return that the detector finds too little for anything to be lost, if so."""
    mine = [row for row in effects if row["class"] == ALL and row["figure"] == "ap"]
    best = max((row["base_mean"] for row in mine), default=1.0)
    if best >= _LEAST_PRECISION:
        return []
    return [
        f"The detector's average precision at the base level is {100 * best:.1f} %: what it loses "
        "at others cannot be seen. It needs more steps, or more to learn from."
    ]


def _doubts(
    study: StudyFile, measured: Sequence[Measured], failed: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Return what speaks against the figures."""
    seeds = len({one.seed for one in measured})
    said = [
        "Objects count that have five points at the base level, some of them by chance: at any "
        "other level a few fall below five, so that small losses of `seen` and recall say little."
    ]
    if seeds < 2:
        said.append("One seed: nothing says how much chance there is in the differences.")
    elif seeds < 5:
        said.append(
            f"{seeds} seeds: intervals are wide, and sizes of effects (d, delta) are uncertain."
        )
    tests = sum(len(one.levels) - 1 for one in study.axes)
    if tests > 1:
        said.append(
            f"{tests} levels are compared: about one in twenty intervals of what does nothing is "
            "beside zero by chance."
        )
    if any(one.factor.name == "traffic_density" for one in study.factors):
        said.append("Levels of traffic_density have motions, and so objects, of their own.")
    if by_clock(study.factors):
        said.append("All frames are collected by the sensors' clocks, those of the base, too.")
    if failed:
        said.append(f"{len(failed)} recordings failed, and are not counted.")
    return said


def _in_short(effects: Sequence[Mapping[str, Any]], seeds: int) -> str:
    """Return the headline: the greatest losses that are beyond chance."""
    key = next((one for one in ("ap", "seen") if any(r["figure"] == one for r in effects)), None)
    if key is None:
        return "Nothing was measured."
    mine = [row for row in effects if row["class"] == ALL and row["figure"] == key]
    sure = [row for row in mine if row["low"] is not None and not row["low"] <= 0 <= row["high"]]
    worst = sorted(sure, key=lambda row: float(row["difference"]))[:3]
    words = {"ap": "average precision", "seen": "objects with 5 points"}[key]
    if not worst:
        middle = min(mine, key=lambda row: float(row["difference"]))
        return (
            f"No level changes {words} beyond chance ({seeds} seeds); the largest difference: "
            f"{middle['factor']} = {middle['level']}, {100 * middle['difference']:+.1f} points."
        )
    said = "; ".join(
        f"{row['factor']} = {row['level']}: {100 * row['difference']:+.1f} "
        f"({100 * row['low']:+.1f} to {100 * row['high']:+.1f})"
        for row in worst
    )
    return f"What changes {words} most, in points of a hundred ({seeds} seeds): {said}."
