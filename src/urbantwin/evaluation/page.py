"""The report as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.evaluation.breakdown import KINDS
from urbantwin.evaluation.criterion import CRITERIA, near, overlapping
from urbantwin.evaluation.definitions import DEFINITIONS
from urbantwin.evaluation.false_alarms import REASONS
from urbantwin.fidelity.report_html import html_picture, html_table, write_html

__all__ = ["in_short", "write_page"]

_TITLES = {"bev_iou": "BEV IoU", "iou_3d": "3D IoU", "distance_m": "within"}


def in_short(report: Mapping[str, Any]) -> str:
    """Return the headline: every class at its distance and at an overlap of a half, in per cent."""
    points, said = report["semantic"], []
    of_points = f"classes of points: mean IoU {_percent(points['mean_iou'])}" if points else ""
    if points and not any(row["detections"] for row in report["classes"].values()):
        return f"No boxes; {of_points}; {report['frames']} frames."
    for name, row in report["classes"].items():
        if name == "large" or not row["objects"]:
            continue
        figures = [_percent(row["ap"][one.name]["ap"]) for one in (near(name), overlapping())]
        said.append(
            f"{name} {figures[0]} within {near(name).limit:g} m, {figures[1]} at BEV IoU 0.5 "
            f"(n = {row['objects']})"
        )
    said += [of_points] if of_points else []
    return f"Average precision: {'; '.join(said)}; {report['frames']} frames."


def write_page(
    report: Mapping[str, Any],
    pictures: Mapping[str, Path],
    path: Path,
) -> None:
    """Write the page.

    Args:
        report: what ``evaluation.json`` holds.
        pictures: ``figures``, and ``misses`` and ``false_alarms`` where there are any.
        path: the HTML file; the same report gives the same bytes.
    """
    title = f"{report['predictions']} on {report['data']}"
    classes = report["classes"]
    parts = [
        f"<h1>Evaluation: {escape(title)}</h1>",
        f'<p class="lead">{escape(report["in_short"])}</p>',
        *(f'<p class="doubt">{escape(one)}</p>' for one in report["doubts"]),
        f"<p>{report['frames']} frames; {report['boxes_counted']} labelled boxes count, of "
        f"{report['distinct']} distinct objects; labelled {escape(report['labelled_view'])}. In "
        "per cent, 95 % intervals small.</p>",
        _precision(classes),
        html_picture("Precision and range", pictures["figures"], head=False),
        _operation(classes),
        _errors(classes),
        _tracks(report["tracking"]),
        _semantic(report["semantic"]),
    ]
    for kind, name in (("misses", "Worst misses"), ("false_alarms", "Worst false alarms")):
        if kind in pictures:
            parts.append(html_picture(name, pictures[kind]))
    parts += [
        "<details><summary>By range, points and what is hidden</summary>",
        *(_breakdown(classes, kind) for kind in KINDS),
        "</details>",
        "<details><summary>Definitions</summary>",
        html_table(("Figure", "Definition"), DEFINITIONS.items(), text=True),
        "</details>",
        "<h2>Notes</h2>",
        "<ul>" + "".join(f"<li>{escape(one)}</li>" for one in report["notes"]) + "</ul>",
    ]
    write_html(path, title, parts)


def _semantic(told: Mapping[str, Any] | None) -> str:
    if told is None:
        return ""
    rows = [
        (name, str(row["points"]), _percent(row["iou"]), _percent(row["recall"]))
        for name, row in told["classes"].items()
    ]
    rows.append(("mean", "", _percent(told["mean_iou"]), ""))
    head = ("Classes of points, %", "n", "IoU", "recall")
    return html_table(head, rows)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"


def _precision(classes: Mapping[str, Any]) -> str:
    head = ["Average precision, %", "n", "distinct"]
    for one in CRITERIA:
        unit = " m" if one.measure == "distance_m" else ""
        head.append(f"{_TITLES[one.measure]} {one.limit:g}{unit}")
    rows = []
    for name, row in classes.items():
        cells = []
        for one in CRITERIA:
            value = row["ap"][one.name]
            sure = value["ap_ci95"]
            small = (
                "" if sure is None else f" <small>{100 * sure[0]:.0f}–{100 * sure[1]:.0f}</small>"
            )
            cells.append(_percent(value["ap"]) + small)
        rows.append((name, str(row["objects"]), str(row["distinct"]), *cells))
    return html_table(head, rows)


def _operation(classes: Mapping[str, Any]) -> str:
    rows = []
    for name, row in classes.items():
        best, alarms = row["best_f1"], row["false_alarms"]
        at = row["recall_at_false_alarms_per_frame"]
        standing = alarms["standing"]
        rows.append(
            (
                name,
                str(row["objects"]),
                *(
                    ("–",) * 4
                    if best is None
                    else (
                        f"{best['score']:.2f}",
                        _percent(best["f1"]),
                        _percent(best["precision"]),
                        _percent(best["recall"]),
                    )
                ),
                f"{alarms['per_frame']:.2f}",
                *(str(alarms["reasons"][reason]) for reason in REASONS),
                "–" if standing is None else f"{standing['detections']} at {standing['places']}",
                *(_percent(value) for value in at.values()),
            )
        )
    head = (
        "At the best F1",
        "n",
        "score",
        "F1",
        "precision",
        "recall",
        "false alarms a frame",
        "found twice",
        "misplaced",
        "another class",
        "nothing there",
        "standing, places",
        "recall at 0.1 a frame",
        "at 1 a frame",
    )
    return "<h2>What it finds, and false alarms</h2>" + html_table(head, rows)


_ERRORS: dict[str, tuple[str, str]] = {
    "boxes": ("n", "d"),
    "ate_m": ("ATE, m", ".2f"),
    "ase": ("ASE", ".2f"),
    "aoe_rad": ("AOE, rad", ".2f"),
    "ahead_m": ("ahead, m", "+.2f"),
    "left_m": ("left, m", "+.2f"),
    "up_m": ("up, m", "+.2f"),
    "longer_m": ("longer, m", "+.2f"),
    "wider_m": ("wider, m", "+.2f"),
    "higher_m": ("higher, m", "+.2f"),
    "axis_median_deg": ("axis off, median, °", ".1f"),
}


def _errors(classes: Mapping[str, Any]) -> str:
    rows = []
    for name, row in classes.items():
        errors = row["errors"]
        if errors is not None:
            cells = [format(errors[key], form) for key, (_, form) in _ERRORS.items()]
            rows.append((name, *cells, _percent(errors["turned_round"])))
    if not rows:
        return ""
    head = ("Within 2 m", *(title for title, _ in _ERRORS.values()), "turned round, %")
    return "<h2>How far off the boxes are</h2>" + html_table(head, rows)


def _tracks(classes: Mapping[str, Any] | None) -> str:
    if not classes:
        return ""
    head = (
        "Tracks",
        "n",
        "tracks",
        "found",
        "HOTA, %",
        "DetA",
        "AssA",
        "MOTA, %",
        "swaps",
        "IDF1, %",
    )
    rows = [
        (
            name,
            str(row["objects"]),
            str(row["tracks"]),
            str(row["tracks_found"]),
            *(_percent(row[key]) for key in ("hota", "deta", "assa", "mota")),
            str(row["swaps"]),
            _percent(row["idf1"]),
        )
        for name, row in classes.items()
    ]
    return "<h2>Who is who</h2>" + html_table(head, rows)


def _breakdown(classes: Mapping[str, Any], kind: str) -> str:
    rows: list[Sequence[str]] = []
    for name, row in classes.items():
        mine = [one for one in row["by"] if one["by"] == kind]
        if mine:
            rows.append((name,))
        for one in mine:
            figures = [_percent(one[what.name]) for what in (near(name), overlapping())]
            rows.append((one["bin"], str(one["objects"]), *figures, _percent(one["found"])))
    if not rows:
        return ""
    title = {"range": "Range", "points": "Points", "occlusion": "Hidden"}[kind]
    head = (title, "n", "AP by distance, %", "AP at BEV IoU 0.5, %", "found, %")
    return html_table(head, rows)
