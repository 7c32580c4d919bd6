"""The folder of a placement: tables, rigs, pictures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import yaml

from urbantwin.artefact import write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.result_warning import ResultWarning, rows_of
from urbantwin.studies.placement.measure import LEVELS, MEASURES, SURROGATES
from urbantwin.studies.placement.moments import class_counts
from urbantwin.studies.placement.page import write_placement_page
from urbantwin.studies.placement.pictures import draw_front, draw_layouts
from urbantwin.studies.placement.place import Placed
from urbantwin.studies.placement.site_plan import site_plan
from urbantwin.studies.placement.view import Layout, Views
from urbantwin.twin.sensor_files import copy_sensor_files

__all__ = ["layout_name", "write_placement", "write_rig"]

#: Half the edge of plans, beyond the places of sensors, metres.
_AROUND_M = 20.0


def layout_name(number: int) -> str:
    """Return the name of a layout, of its rig's file too."""
    return f"layout-{number:04d}"


def write_placement(
    folder: Path,
    placed: Placed,
    told: Mapping[str, Any],
    trained: Sequence[Mapping[str, Any]] | None = None,
) -> None:
    """Write everything that a search found.

    Args:
        folder: of the artefact.
        placed: what was found.
        told: for the manifest: versions, inputs.
        trained: of layouts that detectors were trained for, a row each: ``layout``, ``ap``,
            ``ap_low``, ``ap_high``, ``hota``, ``mota``, ``idf1``.
    """
    tables = {
        "layouts": layouts_table(placed),
        "sensors": sensors_table(placed),
        "points": points_table(placed),
        "hidden": hidden_table(placed),
        "candidates": candidates_table(placed.question.views),
    }
    if trained is not None:
        tables["trained"] = _table(trained, _TRAINED)
    for name, table in tables.items():
        write_parquet_and_csv(folder / name, table)
    (folder / "rigs").mkdir(exist_ok=True)
    for number in placed.front:
        write_rig(
            placed, placed.found[number].layout, folder / "rigs" / f"{layout_name(number)}.yaml"
        )
    spec = placed.question.spec.written()
    (folder / "place.yaml").write_text(yaml.safe_dump(spec, sort_keys=False), encoding="utf-8")
    manifest = manifest_of(placed, told)
    if trained is not None:
        manifest["trained"] = [dict(one) for one in trained]
    write_json(folder / "placement.json", manifest)
    middle = placed.question.spec.middle_m
    reach = max(placed.question.spec.candidates.within_m, 45.0) + _AROUND_M
    plan = site_plan(placed.question.twin, (middle[0], middle[1]), reach)
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    draw_front(placed, pictures / "front.png")
    draw_layouts(placed, plan, reach, pictures / "layouts.png")
    write_placement_page(folder / "report.html", placed, manifest, plan, reach)


def write_rig(placed: Placed, layout: Layout, path: Path) -> None:
    """Write the rig of a layout, as ``urbantwin record --rig`` takes it."""
    views = placed.question.views
    origin = views.file or Path("place.yaml")
    rig = copy_sensor_files(views.rig_spec(layout), origin, path.parent)
    path.write_text(yaml.safe_dump(rig, sort_keys=False), encoding="utf-8")


def sensor_words(views: Views, number: int) -> str:
    """Return a view in words."""
    view = views.every[number]
    mount, model = views.mounts[view.mount], views.spec.models[view.model]
    turned = f", {view.yaw_deg:+g} deg" if view.yaw_deg else ""
    return (
        f"{Path(model.model).name} on {mount.name}, {view.height_m:g} m, "
        f"{view.tilt_deg:g} deg down{turned}"
    )


def layouts_table(placed: Placed) -> pa.Table:
    """Return all layouts with their measures and the intervals of those that have one."""
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
        "; ".join(sensor_words(views, number) for number in one.layout) for one in placed.found
    ]
    return pa.table(columns)


def sensors_table(placed: Placed) -> pa.Table:
    """Return the sensors of all layouts, one a row."""
    views = placed.question.views
    rows = []
    for number, one in enumerate(placed.found):
        for which, chosen in enumerate(one.layout):
            view, spec = views.every[chosen], views.sensor_spec(chosen, f"sensor-{which + 1}")
            rows.append(
                {
                    "layout": number,
                    "sensor": spec.name,
                    "model": Path(spec.model).name,
                    "candidate": views.mounts[view.mount].name,
                    "east_m": spec.east_m,
                    "north_m": spec.north_m,
                    "height_m": spec.height_m,
                    "yaw_deg": spec.yaw_deg,
                    "tilt_deg": spec.pitch_deg,
                }
            )
    return _table(rows, _SENSORS)


def points_table(placed: Placed) -> pa.Table:
    """Return the points on actors of the layouts of the front, by class and range."""
    rows = [
        {
            "layout": one.number,
            "class": row.kind,
            "from_m": row.from_m,
            "to_m": row.to_m,
            "actor_seconds": row.seconds,
            "points": row.points,
            **{f"seen_{level}": share for level, share in zip(LEVELS, row.seen, strict=True)},
        }
        for one in placed.explained
        for row in one.by_class
    ]
    return _table(rows, _POINTS)


def hidden_table(placed: Placed) -> pa.Table:
    """Return who is not seen by the layouts of the front, and what hides them from each sensor."""
    views = placed.question.views
    rows = [
        {
            "layout": one.number,
            "track": hidden.track,
            "class": hidden.kind,
            "from_s": hidden.from_s,
            "seconds": hidden.seconds,
            "x": hidden.middle[0],
            "y": hidden.middle[1],
            "candidate": views.mounts[views.every[chosen].mount].name,
            "sensor": f"sensor-{which + 1}",
            "behind": hidden.behind[which],
            "behind_track": hidden.tracks[which],
        }
        for one in placed.explained
        for hidden in one.hidden
        for which, chosen in enumerate(placed.found[one.number].layout)
    ]
    return _table(rows, _HIDDEN)


def candidates_table(views: Views) -> pa.Table:
    """Return the places where sensors may hang."""
    rows = [
        {
            "candidate": one.name,
            "kind": one.kind,
            "east_m": one.east_m,
            "north_m": one.north_m,
            "ground_m": round(one.ground_m, 3),
            "heights_m": " ".join(f"{height:g}" for height in one.heights_m),
        }
        for one in views.mounts
    ]
    return _table(rows, _CANDIDATES)


_TEXT, _REAL, _WHOLE = pa.string(), pa.float64(), pa.int64()
_SENSORS = {
    "layout": _WHOLE,
    "sensor": _TEXT,
    "model": _TEXT,
    "candidate": _TEXT,
    **dict.fromkeys(("east_m", "north_m", "height_m", "yaw_deg", "tilt_deg"), _REAL),
}
_POINTS = {
    "layout": _WHOLE,
    "class": _TEXT,
    **dict.fromkeys(("from_m", "to_m", "actor_seconds", "points"), _REAL),
    **dict.fromkeys((f"seen_{level}" for level in LEVELS), _REAL),
}
_HIDDEN = {
    "layout": _WHOLE,
    "track": _WHOLE,
    "class": _TEXT,
    **dict.fromkeys(("from_s", "seconds", "x", "y"), _REAL),
    **dict.fromkeys(("candidate", "sensor", "behind"), _TEXT),
    "behind_track": _WHOLE,
}
_TRAINED = {
    "layout": _WHOLE,
    **dict.fromkeys(("ap", "ap_low", "ap_high", "hota", "mota", "idf1"), _REAL),
}
_CANDIDATES = {
    "candidate": _TEXT,
    "kind": _TEXT,
    **dict.fromkeys(("east_m", "north_m", "ground_m"), _REAL),
    "heights_m": _TEXT,
}


def _table(rows: Sequence[Mapping[str, Any]], schema: Mapping[str, pa.DataType]) -> pa.Table:
    return pa.Table.from_pylist([dict(one) for one in rows], schema=pa.schema(list(schema.items())))


def manifest_of(placed: Placed, told: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``placement.json`` holds."""
    question = placed.question
    return {
        "kind": "placement",
        **told,
        "seed": question.seed,
        "layouts_asked": question.layouts,
        "layouts": len(placed.found),
        "views": len(question.views.every),
        "views_cast": placed.views_cast,
        "candidates": len(question.mounts.every),
        "left_out": question.mounts.left_out,
        "moments": len(question.moments.every),
        "step_s": question.moments.step_s,
        "actors": class_counts(question.moments.targets),
        "lanes_and_crossings_m2": len(question.squares.crossing) * question.squares.cell_m2,
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
        "warnings": rows_of(warnings_of_placement(placed)),
    }


def warnings_of_placement(placed: Placed) -> list[ResultWarning]:
    """Return what is wrong with a search."""
    found, question = [], placed.question
    if len(placed.found) < question.layouts:
        found.append(
            ResultWarning(
                "layouts",
                f"{len(placed.found)} of {question.layouts} were judged",
                "there are no more, or none that the budget meets",
            )
        )
    if not len(question.squares.crossing):
        found.append(
            ResultWarning(
                "blind area",
                "is not known",
                "there are no lanes around middle_m",
                "another middle_m",
            )
        )
    tracks = len(set(question.moments.targets.track.tolist()))
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
