"""The report as one self-contained HTML file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.fidelity.definitions import HEADLINE, MEASURES
from urbantwin.fidelity.report import Aggregate, Anchored, Report
from urbantwin.fidelity.report_html import html_picture, html_table, write_html

__all__ = ["Pictures", "write_page"]


@dataclass(frozen=True)
class Pictures:
    """The PNG files that are put into the page.

    Attributes:
        measures: all figures.
        missing: the map of what the twin lacks; None where it lacks nothing.
        worst: the worst pairs, by their number in the report, worst first.
        objects: of labelled objects; None without labels.
    """

    measures: Path
    missing: Path | None
    worst: Mapping[int, Path]
    objects: Path | None


def write_page(report: Report, pictures: Pictures, path: Path) -> None:
    """Write the page: what matters first, every figure at the end.

    Args:
        report: the figures.
        pictures: what is shown between them.
        path: the HTML file; the same report gives the same bytes.
    """
    names = report.folders
    title = f"{names['synthetic']['name']} against {names['real']['name']}"
    count = len(report.frames)
    parts = [
        f"<h1>Fidelity: {escape(title)}</h1>",
        f'<p class="lead">{escape(report.in_short())}</p>',
        _doubts(report),
        f"<p>{count} pair{'s' if count != 1 else ''} of frames; arbitrary site: "
        f"{escape(_name_of(report, 'arbitrary'))}"
        + (f"; foreground is separated by {report.split_by}" if report.split_by else "")
        + ".</p>",
        _headline(report),
        html_picture("Twin, arbitrary site and real against real", pictures.measures),
        "<h2>What to mend next</h2>",
        _missing(report, pictures.missing),
        "<h2>Worst frames first</h2>",
        f"<p>To stand in them, both sides with one camera: <code>urbantwin view "
        f"{escape(str(names['real']['name']))} {escape(str(names['synthetic']['name']))} "
        "--report report</code>, where <code>report</code> is this page's folder.</p>",
        _worst(report, pictures.worst),
        _objects(report, pictures.objects),
        _foreground_objects(report),
        _protocol(report),
        "<details><summary>Every measure</summary>",
        _measures("Whole frames", report.whole),
        *(_measures(name.capitalize(), found) for name, found in report.parts.items()),
        "</details>",
        "<details><summary>Definitions</summary>",
        html_table(
            ("Measure", "Unit", "Definition", "Source"),
            ((m.title, m.unit or "1", m.definition, m.source) for m in MEASURES.values()),
            text=True,
        ),
        "</details>",
        "<h2>Notes</h2>",
        "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in _plain_notes(report)) + "</ul>",
    ]
    write_html(path, title, parts)


def _name_of(report: Report, side: str) -> str:
    return str(report.folders[side]["name"]) if side in report.folders else "none"


def _doubts(report: Report) -> str:
    said = report.doubts + report.problems
    return "".join(f'<p class="doubt">{escape(note)}</p>' for note in said)


def _plain_notes(report: Report) -> list[str]:
    more = report.protocol["notes"] if report.protocol else []
    return [note for note in report.notes if note not in report.doubts] + more


def _number(value: float | None, unit: str = "") -> str:
    return "–" if value is None else f"{value:.3g}{unit}"


def _interval(value: Sequence[float] | None, unit: str = "") -> str:
    return "" if value is None else f" <small>{value[0]:.3g} to {value[1]:.3g}{unit}</small>"


def _headline(report: Report) -> str:
    rows: list[Sequence[str]] = []
    headline = report.headline()
    for part, figures in headline.items():
        if len(headline) > 1:
            rows.append((part.capitalize(),))
        for measure, row in figures.items():
            unit = f" {MEASURES[measure].unit}" if MEASURES[measure].unit else ""
            rows.append(
                (
                    MEASURES[measure].title,
                    _number(row["twin"], unit),
                    _number(row["arbitrary"], unit),
                    _number(row["reduction_percent"], " %")
                    + _interval(row["reduction_percent_ci95"], " %"),
                    _number(row["real_against_real"], unit),
                    _number(row["ratio_to_real"]),
                )
            )
    rows.append(("Published for twins of roadside sensors made by hand in CARLA, other data",))
    for measure, row in headline["whole"].items():
        unit = f" {MEASURES[measure].unit}" if MEASURES[measure].unit else ""
        known = row["published"]
        figures = [f"{known[side]:g}{unit}" for side in ("twin", "arbitrary")]
        less = f"{known['reduction_percent']:.1f} %"
        rows.append((MEASURES[measure].title, *figures, less, "–", "–"))
    return html_table(
        (
            "Mean over frames",
            "Twin",
            "Arbitrary site",
            "Reduction",
            "Real against real",
            "Twin / real",
        ),
        rows,
    )


def _missing(report: Report, picture: Path | None) -> str:
    if not report.missing or picture is None:
        return "<p>No real point is without a surface of the twin nearby.</p>"
    head = ("Place", "x, m", "y, m", "z, m", "Real points a frame", "Nearest of the twin")
    near = report.parameters["missing"]["farther_than_m"]
    return (
        f"<p>Real points{' of the background' if report.parts else ''} that have nothing of the "
        f"twin within {near:g} m, gathered by place, most points first.</p>"
        + html_picture("What the twin lacks", picture, head=False)
        + html_table(
            head,
            (
                (
                    str(number),
                    f"{one['x']:.1f}",
                    f"{one['y']:.1f}",
                    f"{one['low']:.1f} to {one['high']:.1f}",
                    f"{one['points_per_frame']:,.0f}"
                    if one["points_per_frame"] >= 10
                    else f"{one['points_per_frame']:.1f}",
                    f"{one['distance_m']:.2f} m",
                )
                for number, one in enumerate(report.missing, start=1)
            ),
        )
    )


def _worst(report: Report, pictures: Mapping[int, Path]) -> str:
    names = HEADLINE
    rows = []
    for index in report.worst()[:10]:
        frame = report.frames[index]
        found = [_number(frame.twin_figures.get(name)) for name in names]
        rows.append((frame.real, frame.synthetic, *found))
    table = html_table(("Real", "Synthetic", *(MEASURES[name].title for name in names)), rows)
    shown = []
    for place, (index, picture) in enumerate(pictures.items(), start=1):
        frame = report.frames[index]
        figure = _number(frame.twin_figures.get(names[0]), " m")
        shown.append(
            html_picture(
                f"{place}. {frame.real}: {MEASURES[names[0]].title} {figure}", picture, level=3
            )
        )
    return table + "".join(shown)


def _objects(report: Report, picture: Path | None) -> str:
    if picture is None or report.objects is None:
        return ""
    rows = []
    for side in ("synthetic", "arbitrary"):
        found = report.objects.get(f"{side}_against_real")
        if found is None:
            continue
        longer = _typical(found["classes"], "length_m")
        rows.append(
            (
                "Twin" if side == "synthetic" else "Arbitrary site",
                _number(found["boxes_per_frame_ratio"]),
                _number(found["class_mix_js"]),
                _number(found["heat_map_js"]),
                "–" if longer is None else f"{longer:+.2f} m",
                _number(_typical(found["classes"], "points_ratio")),
            )
        )
    head = (
        "Against real",
        "Boxes a frame, ratio",
        "Class mix, JS",
        "Heat map, JS",
        "Length, largest difference",
        "Points a box, farthest ratio",
    )
    return html_picture("Objects", picture) + (html_table(head, rows) if rows else "")


def _foreground_objects(report: Report) -> str:
    found = report.foreground_objects
    if found is None:
        return ""
    rows = [
        (
            f"JS of {name}",
            _number(found["js_twin"][name]),
            _number(found["js_real_against_real"][name]),
            _number(found["ratio_to_real"][name]),
        )
        for name in found["js_twin"]
    ]
    a_frame = found["objects_per_frame"]
    rows.append(("Objects a frame", _number(a_frame["synthetic"]), _number(a_frame["real"]), ""))
    return "<h2>What moves, object by object</h2>" + html_table(
        ("Foreground that lies together", "Twin", "Real against real", "Twin / real"), rows
    )


def _typical(classes: Mapping[str, Any], name: str) -> float | None:
    """Return the value of the class in which it is farthest from the real one."""
    if name == "points_ratio":
        given = [one[name] for one in classes.values() if one[name] is not None]
        return max(given, key=lambda ratio: abs(math.log(ratio)), default=None)
    given = [one["dimensions"][name] for one in classes.values()]
    return max(given, key=abs, default=None)


def _protocol(report: Report) -> str:
    if not report.protocol:
        return ""
    rows = []
    for name, row in report.protocol["scores"].items():
        raw = [f"{row['raw'][c]:.3g} <small>{row['normalised'][c]:.3f}</small>" for c in row["raw"]]
        rows.append(
            (
                name.replace("_", " "),
                _number(row["combined"]),
                _number(row["detection"]),
                f"{row['realism']:.4f}",
                *raw,
            )
        )
    return (
        "<h2>Challenge protocol</h2><p>Against real frames that nothing was fitted to. "
        "<em>Fitted</em>: moved to the mean and covariance of the other real frames; what that "
        "gains is no fidelity.</p>"
        + html_table(("Frames", "Score", "Detection", "Realism", "CD", "MMD", "EMD", "FPD"), rows)
    )


def _measures(title: str, found: Anchored) -> str:
    rows = []
    for name, measure in MEASURES.items():
        twin = found.twin.get(name)
        if twin is None:
            continue
        rows.append(
            (
                measure.title + (f" <small>{measure.unit}</small>" if measure.unit else ""),
                _mean(twin),
                _number(twin.median),
                _number(twin.p95),
                _mean((found.arbitrary or {}).get(name)),
                _number((found.reduction_percent or {}).get(name), " %"),
                _mean((found.real_against_real or {}).get(name)),
                _number((found.ratio_to_real or {}).get(name)),
            )
        )
    head = ("Mean", "Median", "P95", "Arbitrary", "Reduction", "Real against real", "Ratio")
    return html_table((title, *head), rows)


def _mean(value: Aggregate | None) -> str:
    return "–" if value is None else _number(value.mean) + _interval(value.mean_ci95)
