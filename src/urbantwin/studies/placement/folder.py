"""Folder of a placement: tables, rigs and manifest, written and read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import yaml

from urbantwin.artefact import write_json
from urbantwin.artefact.manifest import Part, PlainName, validated
from urbantwin.artefact.tables import check_finite, read_parquet, write_parquet_and_csv
from urbantwin.errors import InputError
from urbantwin.result_warning import ResultWarning, rows_of
from urbantwin.studies.placement.measure import LEVELS, MEASURES, SURROGATES

if TYPE_CHECKING:
    from urbantwin.studies.placement.place import Placed
    from urbantwin.studies.placement.view import Layout, Views

__all__ = ["check_placement", "layout_name", "read_layouts", "write_placement", "write_rig"]

#: Columns of text and of integers; all others are real numbers.
_TEXT = ("behind", "candidate", "class", "heights_m", "kind", "model", "sensor")
_WHOLE = ("behind_track", "layout", "track")
#: Columns of the table of trained layouts.
_TRAINED = "layout ap ap_low ap_high hota mota idf1"


def layout_name(number: int) -> str:
    """Return the name of a layout, also of its rig's file."""
    return f"layout-{number:04d}"


def write_placement(
    folder: Path,
    placed: Placed,
    about: Mapping[str, Any],
    trained: Sequence[Mapping[str, Any]] | None = None,
) -> None:
    """Write all results of a search.

    Args:
        folder: folder of the artefact.
        placed: the results.
        about: versions and inputs, for the manifest.
        trained: layouts with trained detectors, a row each: ``layout``, ``ap``, ``ap_low``,
            ``ap_high``, ``hota``, ``mota``, ``idf1``.
    """
    from urbantwin.studies.placement.report import write_report

    tables = {
        "layouts": _layouts(placed),
        "sensors": _sensors(placed),
        "points": _points(placed),
        "hidden": _hidden(placed),
        "candidates": _candidates(placed.question.views),
    }
    manifest = _manifest(placed, about)
    if trained is not None:
        manifest["trained"] = [dict(one) for one in trained]
        rows = ([row[name] for name in _TRAINED.split()] for row in trained)
        tables["trained"] = _table(_TRAINED, rows)
    for name, table in tables.items():
        write_parquet_and_csv(folder / name, table)
    rigs = folder / "rigs"
    rigs.mkdir(exist_ok=True)
    for number in placed.front:
        write_rig(placed, placed.found[number].layout, rigs / f"{layout_name(number)}.yaml")
    spec = placed.question.spec.written()
    (folder / "place.yaml").write_text(yaml.safe_dump(spec, sort_keys=False), encoding="utf-8")
    write_json(folder / "placement.json", manifest)
    write_report(folder, placed, manifest)


def write_rig(placed: Placed, layout: Layout, path: Path) -> None:
    """Write the rig of a layout, for ``urbantwin record --rig``."""
    from urbantwin.twin.sensor_files import copy_sensor_files

    views = placed.question.views
    origin = views.file or Path("place.yaml")
    rig = copy_sensor_files(views.rig_spec(layout), origin, path.parent)
    path.write_text(yaml.safe_dump(rig, sort_keys=False), encoding="utf-8")


def _in_words(views: Views, number: int) -> str:
    """Return a view in words."""
    view = views.every[number]
    mount, model = views.mounts[view.mount], views.spec.models[view.model]
    turned = f", {view.yaw_deg:+g} deg" if view.yaw_deg else ""
    return (
        f"{Path(model.model).name} on {mount.name}, {view.height_m:g} m, "
        f"{view.tilt_deg:g} deg down{turned}"
    )


def _table(names: str, rows: Iterable[Sequence[Any]]) -> pa.Table:
    """Return a table of rows, with column names separated by blanks."""
    given = list(rows)
    columns = {}
    for number, name in enumerate(names.split()):
        kind = pa.string() if name in _TEXT else pa.int64() if name in _WHOLE else pa.float64()
        columns[name] = pa.array([row[number] for row in given], kind)
    return pa.table(columns)


def _layouts(placed: Placed) -> pa.Table:
    """Return all layouts with their measures and intervals."""
    views, front = placed.question.views, set(placed.front)
    columns: dict[str, list[Any]] = {
        "layout": list(range(len(placed.found))),
        "front": [number in front for number in range(len(placed.found))],
        "sensors": [len(one.layout) for one in placed.found],
    }
    for name, measure in MEASURES.items():
        columns[name] = [one.verdict.values[name] for one in placed.found]
        if measure.sampled:
            bounds = [one.verdict.intervals[name] for one in placed.found]
            columns[f"{name}_low"] = [low for low, _ in bounds]
            columns[f"{name}_high"] = [high for _, high in bounds]
    columns["what"] = [
        "; ".join(_in_words(views, number) for number in one.layout) for one in placed.found
    ]
    return pa.table(columns)


def _sensors(placed: Placed) -> pa.Table:
    """Return the sensors of all layouts, one per row."""
    views = placed.question.views
    rows = []
    for number, one in enumerate(placed.found):
        for which, chosen in enumerate(one.layout):
            spec = views.sensor_spec(chosen, f"sensor-{which + 1}")
            mount = views.mounts[views.every[chosen].mount]
            row = (number, spec.name, Path(spec.model).name, mount.name, spec.east_m, spec.north_m)
            rows.append((*row, spec.height_m, spec.yaw_deg, spec.pitch_deg))
    names = "layout sensor model candidate east_m north_m height_m yaw_deg tilt_deg"
    return _table(names, rows)


def _points(placed: Placed) -> pa.Table:
    """Return the points on actors for the layouts of the front, by class and range."""
    seen = " ".join(f"seen_{level}" for level in LEVELS)
    return _table(
        f"layout class from_m to_m actor_seconds points {seen}",
        (
            (one.number, row.kind, row.from_m, row.to_m, row.seconds, row.points, *row.seen)
            for one in placed.explained
            for row in one.by_class
        ),
    )


def _hidden(placed: Placed) -> pa.Table:
    """Return the actors missed by layouts of the front, with the occluder of each sensor."""
    views = placed.question.views
    rows = []
    for one in placed.explained:
        for actor in one.hidden:
            row = (one.number, actor.track, actor.kind, actor.from_s, actor.seconds, *actor.middle)
            for which, chosen in enumerate(placed.found[one.number].layout):
                mount = views.mounts[views.every[chosen].mount].name
                behind = (actor.behind[which], actor.tracks[which])
                rows.append((*row, mount, f"sensor-{which + 1}", *behind))
    names = "layout track class from_s seconds x y candidate sensor behind behind_track"
    return _table(names, rows)


def _candidates(views: Views) -> pa.Table:
    """Return the candidate places of sensors."""
    return _table(
        "candidate kind east_m north_m ground_m heights_m",
        (
            (one.name, one.kind, one.east_m, one.north_m, round(one.ground_m, 3))
            + (" ".join(f"{height:g}" for height in one.heights_m),)
            for one in views.mounts
        ),
    )


def _manifest(placed: Placed, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``placement.json``."""
    from urbantwin.lidar.sight import CELL_M

    question = placed.question
    return {
        "kind": "placement",
        **about,
        "seed": question.recipe.seed,
        "layouts_asked": question.layouts,
        "layouts": len(placed.found),
        "views": len(question.views.every),
        "views_cast": placed.views_cast,
        "candidates": len(question.mounts.every),
        "left_out": question.mounts.left_out,
        "moments": len(question.recipe.moments.every),
        "step_s": question.recipe.moments.step_s,
        "actors": question.recipe.moments.targets.class_counts(),
        "lanes_and_crossings_m2": len(question.recipe.squares.crossing) * CELL_M**2,
        "objectives": list(question.spec.objectives),
        "front": [layout_name(number) for number in placed.front],
        "measures": {
            name: {
                "better": "more" if one.more else "less",
                "unit": one.unit,
                "meaning": one.meaning,
                **({"source": one.source} if one.source else {}),
                "surrogate": name in SURROGATES,
            }
            for name, one in MEASURES.items()
        },
        "intervals": "95 %, bootstrap over actors of this motion: nothing of other hours",
        "warnings": rows_of(_warnings(placed)),
    }


def _warnings(placed: Placed) -> list[ResultWarning]:
    """Return the warnings of a search."""
    found, question = [], placed.question
    if len(placed.found) < question.layouts:
        found.append(
            ResultWarning(
                "layouts",
                f"{len(placed.found)} of {question.layouts} were judged",
                "there are no more within the budget",
            )
        )
    if not len(question.recipe.squares.crossing):
        found.append(
            ResultWarning(
                "blind area",
                "is not known",
                "there are no lanes around middle_m",
                "another middle_m",
            )
        )
    tracks = len(set(question.recipe.moments.targets.track.tolist()))
    if tracks < 20:
        found.append(
            ResultWarning(
                "traffic",
                f"{tracks} actors pass",
                "the motion is short or its traffic thin",
                "a longer motion: intervals are wide",
            )
        )
    return found


class _Manifest(Part):
    layouts: int
    views_cast: int
    candidates: int
    moments: int
    actors: dict[str, int]
    objectives: list[str]
    front: list[PlainName]


def check_placement(manifest: dict[str, Any], file: Path) -> None:
    """Check that a manifest is a placement's.

    Raises:
        InputError: a field is missing or wrong; names the first.
    """
    known = validated(manifest, _Manifest, file=file, expected="a placement's manifest")
    for name in known.objectives:
        if name not in MEASURES:
            raise InputError(
                f"{name!r:.40} is no measure", file=file, place="objectives", expected="measures"
            )


def read_layouts(file: Path) -> pa.Table:
    """Read ``layouts.parquet``.

    Raises:
        InputError: it is missing or damaged, or lacks a column.
    """
    expected = "the layouts of a placement"
    table = read_parquet(file, expected)
    kinds = {"layout": pa.int64(), "front": pa.bool_(), "what": pa.string()}
    for name, kind in (kinds | dict.fromkeys(MEASURES, pa.float64())).items():
        if name not in table.column_names:
            raise InputError("is missing", file=file, place=name, expected=expected)
        if table[name].type != kind:
            raise InputError(f"holds {table[name].type}", file=file, place=name, expected=str(kind))
    check_finite(table, [*kinds, *MEASURES], file)
    return table
