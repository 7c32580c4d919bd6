"""The folder of a study: tables, pictures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.tables import write_parquet_and_csv
from urbantwin.pages import write_page
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
_PICTURES = {
    "bitrate": "Bits",
    "curves": "What goes wrong",
    "failure": "A node falls silent",
}
_DEFINITIONS = {
    "mAP": "Mean over the classes of the average precision (forty levels of recall) at a distance "
    "of centres of 1 m, trucks and buses 2 m; docs/method/detectors.md. All settings are judged "
    "on the same objects: those with 5 points of all nodes together within the range.",
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
        folder: the output folder.
        told: description of the study: inputs, nodes, numbers of frames and objects.
        rows: rows of the settings, see `result.Result.row`.
        over_time: rows of the study of a node that stops sending.

    Returns:
        Contents of ``fusion.json``.
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
    write_page(
        folder / f"{KIND}.html",
        "studies/fusion/page.html.j2",
        report=report,
        rows=rows,
        over_time=over_time,
        studies={study: _TITLES[study] for study in STUDIES},
        pictures={_PICTURES[name]: pictures / f"{name}.png" for name in draw if draw[name]},
    )
    write_json(folder / f"{KIND}.json", report)
    return report


def in_short(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the headline: the score of the receiver alone and the best score of each way."""
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


def _value(row: Mapping[str, Any], name: str) -> str:
    return "–" if row[name] is None else format(row[name], ".1f")
