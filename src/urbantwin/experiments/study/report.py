"""Output of a study: ``study.json``, tables (Parquet and CSV), pictures and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.experiments.grid import level_text
from urbantwin.experiments.study.effects import Measured, interactions_of, main_effects_of
from urbantwin.experiments.study.factors import by_clock
from urbantwin.experiments.study.file import StudyFile
from urbantwin.experiments.study.judging import ALL, METRICS
from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, LOST, blank, plain, save
from urbantwin.pages import write_page

__all__ = ["KIND", "write_study"]

KIND = "study"
#: Figures given in percent.
_PERCENT = ("seen", "in_box", "ap", "ap_overlap", "recall", "hota", "mota", "idf1")

#: Drawn figures, with the factor to their unit, and their title.
_SHOWN: Mapping[str, tuple[float, str]] = {
    "ap": (100, "average precision, %"),
    "hota": (100, "HOTA, %"),
    "idf1": (100, "IDF1, %"),
    "mota": (100, "MOTA, %"),
    "points": (1, "points on an object"),
    "seen": (100, "objects with 5 points, %"),
    "in_box": (100, "points in their boxes, %"),
}
_COLUMNS = 3
#: Average precision of a detector below which losses are not meaningful.
_LEAST_PRECISION = 0.1


def write_study(
    folder: Path,
    study: StudyFile,
    measured: Sequence[Measured],
    failed: Sequence[Mapping[str, Any]],
    told: Mapping[str, Any],
    doubts: Sequence[str] = (),
) -> dict[str, Any]:
    """Write all outputs of a study into a folder.

    Args:
        folder: the folder.
        study: the study's file.
        measured: figures of every successful recording, by seed.
        failed: ``seed``, ``cell`` and ``why`` of the others.
        told: further entries of ``study.json``: its provenance.
        doubts: known doubts, besides those about the figures.

    Returns:
        Content of ``study.json``.
    """
    axes = study.axes
    effects = main_effects_of(measured, axes)
    together = interactions_of(measured, axes) if study.design == "factorial" else []
    _write_tables(folder, study, measured, effects, together)
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
        _draw_effects(effects, ALL, drawn["Effects"])
        _draw_levels(_along(study, measured), ALL, drawn["Levels"])
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
    effects: Sequence[Mapping[str, Any]],
    together: Sequence[Mapping[str, Any]],
) -> None:
    rows = [
        {
            "cell": one.cell.name(study.axes),
            **{name: level_text(level) for name, level in one.cell.levels.items()},
            "seed": one.seed,
            "class": name,
            "objects": one.objects.get(name, 0),
            **{key: figures.get(key) for key in METRICS},
        }
        for one in measured
        for name, figures in one.figures.items()
    ]
    for name, table in (("cells", rows), ("effects", effects), ("interactions", together)):
        if table:
            _write_table(folder / name, table)


def _write_table(stem: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    import pyarrow as pa

    table = pa.Table.from_pylist([dict(row) for row in rows])
    # A column without values is numeric, too.
    types = [pa.float64() if pa.types.is_null(one.type) else one.type for one in table.schema]
    schema = pa.schema(list(zip(table.column_names, types, strict=True)))
    write_parquet_and_csv(stem, table.cast(schema))


def _weak(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a doubt if the detector finds too few objects for losses to be visible."""
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
    """Return doubts about the figures."""
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
    """Return the headline: the largest significant losses."""
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


def _shown(effects: Sequence[Mapping[str, Any]], name: str) -> list[str]:
    there = {row["figure"] for row in effects if row["class"] == name}
    return [one for one in _SHOWN if one in there]


def _draw_effects(effects: Sequence[Mapping[str, Any]], name: str, path: Path) -> None:
    """Draw the main effects on a class: a panel for every figure, a line for every level.

    Args:
        effects: effects from `effects.main_effects_of`; at least one of the class.
        name: name of the class.
        path: the PNG to write.
    """
    figures = _shown(effects, name)
    labels = list(
        dict.fromkeys(
            f"{row['factor']} = {row['level']}" for row in effects if row["class"] == name
        )
    )
    columns = min(_COLUMNS, len(figures))
    rows = -(-len(figures) // columns)
    height = 0.7 + rows * (1.2 + 0.26 * len(labels))
    figure = blank(13, height)
    grid = figure.add_gridspec(
        rows,
        columns,
        left=0.2,
        right=0.985,
        bottom=0.4 / height,
        top=1 - 0.75 / height,
        hspace=0.4,
        wspace=0.08,
    )
    title = f"Difference to the base level: {name}"
    figure.text(0.012, 1 - 0.22 / height, title, color=INK, fontsize=12, weight="bold", va="center")
    for number, key in enumerate(figures):
        axes = figure.add_subplot(grid[number // columns, number % columns])
        mine = {
            f"{row['factor']} = {row['level']}": row
            for row in effects
            if row["class"] == name and row["figure"] == key
        }
        _forest(axes, labels, mine, key, named=number % columns == 0)
    save(figure, path)


def _forest(
    axes: Axes,
    labels: Sequence[str],
    rows: Mapping[str, Mapping[str, Any]],
    key: str,
    *,
    named: bool,
) -> None:
    times, title = _SHOWN[key]
    worse = -1.0  # more of every figure that is drawn is better
    for place, label in enumerate(labels):
        row = rows.get(label)
        if row is None:
            continue
        middle = times * row["difference"]
        sure = row["low"] is not None and not row["low"] <= 0 <= row["high"]
        colour = (
            COLOURS["real"] if not sure else LOST if middle * worse > 0 else COLOURS["synthetic"]
        )
        if row["low"] is not None:
            axes.plot([times * row["low"], times * row["high"]], [place, place], color=colour, lw=2)
        axes.plot(middle, place, "o", color=colour, markersize=5)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    plain(axes, title)
    axes.grid(visible=True, axis="x", color=FAINT, linewidth=0.6)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_yticks(range(len(labels)), list(labels) if named else [""] * len(labels))


def _draw_levels(
    measured: Sequence[tuple[str, str, int, Mapping[str, float]]], name: str, path: Path
) -> None:
    """Draw the figures of a class over the levels of each factor, a line for every seed.

    Args:
        measured: factor, level, seed and figures, the base level of each factor first; not empty.
        name: name of the class.
        path: the PNG to write.
    """
    factors = list(dict.fromkeys(factor for factor, *_ in measured))
    figures = [one for one in _SHOWN if any(one in row for *_, row in measured)]
    width, height = 1.2 + 2.4 * len(factors), 1.1 + 1.9 * len(figures)
    figure = blank(width, height)
    grid = figure.add_gridspec(
        len(figures),
        len(factors),
        left=0.9 / width,
        right=1 - 0.2 / width,
        bottom=0.4 / height,
        top=1 - 0.75 / height,
        hspace=0.35,
        wspace=0.12,
    )
    title = f"Levels, a line for every seed: {name}"
    figure.text(
        0.15 / width, 1 - 0.22 / height, title, color=INK, fontsize=12, weight="bold", va="center"
    )
    for row, key in enumerate(figures):
        times, title = _SHOWN[key]
        first: Axes | None = None
        for column, factor in enumerate(factors):
            axes = figure.add_subplot(grid[row, column], sharey=first)
            first = first or axes
            mine = [one for one in measured if one[0] == factor]
            levels = list(dict.fromkeys(level for _, level, *_ in mine))
            for seed in dict.fromkeys(one[2] for one in mine):
                places = [
                    (levels.index(level), times * told[key])
                    for _, level, its, told in mine
                    if its == seed and key in told
                ]
                axes.plot(*zip(*places, strict=True), "o-", lw=1, ms=3, color=COLOURS["synthetic"],
                          alpha=0.6)  # fmt: skip
            plain(axes, factor if row == 0 else "")
            axes.set_xticks(range(len(levels)), levels if row == len(figures) - 1 else [])
            # Names of levels at the edges of neighbours stay apart.
            axes.set_xlim(-0.35, len(levels) - 0.65)
            axes.tick_params(labelleft=column == 0)
            if column == 0:
                axes.set_ylabel(title, fontsize=8, color=INK)
    save(figure, path)
