"""The folder of a study: tables, pictures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.fidelity.report_html import html_picture, html_table, write_html
from urbantwin.studies.fusion.figure import draw_bitrate, draw_curves, draw_failure
from urbantwin.studies.fusion.setting import STUDIES

__all__ = ["KIND", "in_short", "write_report"]

KIND = "fusion"
_TITLES = {
    "bitrate": "Bits",
    "latency": "Latency",
    "clock": "Clocks",
    "pose": "Poses",
    "loss": "Lost packets",
    "nodes": "Number of nodes",
    "failure": "A node falls silent",
}
_DEFINITIONS = {
    "mAP": "Mean over the classes of the average precision (forty levels of recall) at a distance "
    "of centres of 1 m, trucks and buses 2 m; docs/evaluation.md. All settings are asked for the "
    "same objects: those with 5 points of all nodes together within the range.",
    "small numbers": "2.5th to 97.5th percentile of draws of frames, neighbours together "
    "(moving blocks). Frames of one drive say nothing of other hours and places.",
    "gain": "mAP less that of the receiver alone, with the interval of the difference over the "
    "same draws.",
    "kbit/s": "Bits of all messages that the receiver used, as they were encoded and with their "
    "headers (58 bytes a packet); UDP and IP add 28 bytes a packet that are not counted.",
    "early": "Clouds are sent and put together in the site by the poses that nodes report.",
    "middle": "What the detector's encoder says of pillars is sent and merged by greatest values "
    "before the backbone.",
    "late": "Boxes are sent, matched and fused.",
    "moved by its stamp": "What is old is moved to now: boxes, and points and cells in boxes of "
    "road users that move, by the speed that the sender's own tracks tell and the difference of "
    "the stamps. For clouds and features these boxes are sent, too, and counted.",
    "pose": "Errors of each node's place and heading are drawn anew for every frame; a curve is "
    "the mean over errors, not one bad calibration.",
    "age": "Of what the receiver used, mean over nodes and frames, seconds.",
}


def write_report(
    folder: Path,
    told: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    over_time: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Write ``fusion.json``, the tables, the pictures and ``fusion.html`` into a folder.

    Args:
        folder: where.
        told: what was studied: inputs, nodes, numbers of frames and objects.
        rows: of the settings, see `result.Result.row`.
        over_time: rows of a node that falls silent.

    Returns:
        What ``fusion.json`` holds.
    """
    pictures = folder / "pictures"
    pictures.mkdir()
    draw = {
        "bitrate": draw_bitrate(rows, pictures / "bitrate.png"),
        "curves": draw_curves(rows, pictures / "curves.png"),
        "failure": draw_failure(over_time, pictures / "failure.png"),
    }
    _write_table(folder / "settings", rows)
    if over_time:
        _write_table(folder / "over_time", over_time)
    report: dict[str, Any] = as_json(
        {"kind": KIND, "schema": 1, **told, "in_short": in_short(rows), "definitions": _DEFINITIONS}
    )
    _write_page(folder, report, rows, over_time, {name for name, there in draw.items() if there})
    write_json(folder / f"{KIND}.json", report)
    return report


def in_short(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the headline: the receiver alone, and the best of each way with its bits."""
    alone = next(row for row in rows if row["way"] == "alone")
    said = [f"alone {_value(alone, 'map')}"]
    for way in ("early", "middle", "late"):
        ideal = [row for row in rows if row["way"] == way and _is_ideal(row)]
        if ideal:
            best = max(ideal, key=lambda row: row["map"])
            said.append(f"{way} {_value(best, 'map')} at {best['kbit_s']:.0f} kbit/s")
    told = "; ".join(said)
    return f"Mean average precision, %, the best of each way: {told}; n = {alone['objects']}."


def _is_ideal(row: Mapping[str, Any]) -> bool:
    names = ("latency_s", "clock_error_s", "place_error_m", "yaw_error_deg", "loss")
    return not any(row[name] for name in names) and row["silent_from_s"] is None


def _write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    import pyarrow as pa

    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: [row.get(name) for row in rows] for name in names})
    write_parquet_and_csv(path, table)


def _write_page(
    folder: Path,
    report: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    over_time: Sequence[Mapping[str, Any]],
    drawn: set[str],
) -> None:
    nodes = ", ".join(one["name"] for one in report["nodes"])
    counts = ", ".join(f"{name} {count}" for name, count in report["objects"].items())
    parts = [
        f"<h1>Fusion of {escape(nodes)}</h1>",
        f'<p class="lead">{escape(report["in_short"])}</p>',
        *(f'<p class="doubt">{escape(one)}</p>' for one in report["doubts"]),
        f"<p>{report['frames']} frames of {escape(report['nodes'][0]['name'])}, which receives; "
        f"objects within {report['within_m']:g} m: {escape(counts)}, of {report['distinct']} "
        f"distinct ones. Packets of {report['mtu']} bytes. Detector {escape(report['model'])}, "
        f"trained on {escape(report['trained_on'])}.</p>",
    ]
    if "bitrate" in drawn:
        parts.append(html_picture("Bits", folder / "pictures" / "bitrate.png"))
    if "curves" in drawn:
        parts.append(html_picture("What goes wrong", folder / "pictures" / "curves.png"))
    if "failure" in drawn:
        parts.append(html_picture("A node falls silent", folder / "pictures" / "failure.png"))
    for study in STUDIES:
        mine = [row for row in rows if row["study"] == study]
        if mine:
            parts += ["<details><summary>" + _TITLES[study] + "</summary>", _table(mine),
                      "</details>"]  # fmt: skip
    if over_time:
        parts += ["<details><summary>Over time</summary>", _of_time(over_time), "</details>"]
    parts += [
        "<details><summary>Definitions</summary>",
        html_table(("Word", "What it means"), _DEFINITIONS.items(), text=True),
        "</details>",
    ]
    write_html(folder / f"{KIND}.html", f"Fusion of {nodes}", parts)


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    head = ("", "told", "value", "moved by its stamp", "kbit/s", "kbit a frame", "packets a frame",
            "age, s", "mAP, %", "gain", "mAP at BEV IoU 0.5", "n")  # fmt: skip
    return html_table(
        head,
        [
            (
                row["way"] + (" (a node falls silent)" if row["silent_from_s"] is not None else ""),
                row["told"],
                "" if row["value"] is None else f"{row['value']:g} {row['unit']}",
                "yes" if row["aligned"] else "",
                f"{row['kbit_s']:,.1f}",
                f"{row['kbit_frame']:,.1f}",
                f"{row['packets_frame']:.1f}",
                "" if row["age_s"] is None else f"{row['age_s']:.2f}",
                _with_ends(row, "map"),
                _with_ends(row, "gain", "+"),
                _value(row, "map_bev_iou_0.5"),
                str(row["objects"]),
            )
            for row in rows
        ],
    )


def _of_time(rows: Sequence[Mapping[str, Any]]) -> str:
    head = ("", "from, s", "to, s", "frames", "mAP, %", "n")
    return html_table(
        head,
        [
            (
                row["way"] + (" (a node falls silent)" if row["silent_from_s"] is not None else ""),
                f"{row['from_s']:.1f}",
                f"{row['to_s']:.1f}",
                str(row["frames"]),
                _with_ends(row, "map"),
                str(row["objects"]),
            )
            for row in rows
        ],
    )


def _value(row: Mapping[str, Any], name: str, sign: str = "") -> str:
    return "–" if row.get(name) is None else format(row[name], f"{sign}.1f")


def _with_ends(row: Mapping[str, Any], name: str, sign: str = "") -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    if low is None or high is None:
        return _value(row, name, sign)
    return f"{_value(row, name, sign)} <small>{low:{sign}.0f} to {high:{sign}.0f}</small>"
