"""What ``evaluation.json`` holds, and the folder with its page and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import as_json, write_json
from urbantwin.evaluation.bootstrap import same_objects
from urbantwin.evaluation.case_picture import draw_cases
from urbantwin.evaluation.criterion import CRITERIA, JUDGED, near, overlapping
from urbantwin.evaluation.definitions import DEFINITIONS
from urbantwin.evaluation.evaluate import Figures
from urbantwin.evaluation.false_alarms import REASONS
from urbantwin.evaluation.figure import draw_figures
from urbantwin.evaluation.tracks import judged_tracks
from urbantwin.evaluation.worst import worst_false_alarms, worst_misses
from urbantwin.fidelity.readers import Recording
from urbantwin.pages import write_page

__all__ = ["KIND", "write_evaluation"]

KIND = "evaluation"
#: So many misses and so many false alarms are drawn.
_SHOWN = 8
_TITLES = {"bev_iou": "BEV IoU {:g}", "iou_3d": "3D IoU {:g}", "distance_m": "within {:g} m"}


def write_evaluation(
    folder: Path,
    figures: Figures,
    recording: Recording,
    told: Mapping[str, Any],
    semantic: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write ``evaluation.json``, ``evaluation.html`` and ``pictures/`` into a folder.

    Args:
        folder: where.
        figures: of all classes.
        recording: whose points are drawn.
        told: names of predictions and data, and the settings.
        semantic: what `semantic.judged_semantic` says.

    Returns:
        What ``evaluation.json`` holds.
    """
    seen = figures.seen
    pictures = folder / "pictures"
    pictures.mkdir()
    paths = {"figures": pictures / "figures.png"}
    draw_figures(figures, paths["figures"])
    cases = {
        "misses": worst_misses(figures, _SHOWN),
        "false_alarms": worst_false_alarms(figures, _SHOWN),
    }
    for kind, some in cases.items():
        if some:
            paths[kind] = pictures / f"{kind}.png"
            draw_cases(some, figures, recording, paths[kind])
    single = [one for name, one in figures.classes.items() if name != "large"]
    counted = np.zeros(len(seen.truth), bool)
    for one in single or figures.classes.values():
        counted |= one.roles > 0
    known = np.unique(seen.truth.track[counted & (seen.truth.track >= 0)])
    report: dict[str, Any] = {
        "kind": KIND,
        "schema": 1,
        **told,
        "in_short": "",
        "frames": len(seen.truth.frames),
        "frames_together": figures.block,
        "boxes_counted": int(counted.sum()),
        "tracks": len(known) if len(known) else None,
        "distinct": len(np.unique(same_objects(seen.truth)[counted])),
        "labelled_view": seen.view,
        "doubts": list(figures.doubts),
        "notes": list(seen.notes),
        "classes": {name: one.figures for name, one in figures.classes.items()},
        "members": {name: list(JUDGED[name]) for name in figures.classes},
        "tracking": judged_tracks(figures),
        "semantic": semantic,
        "worst_misses": [one.row(seen.truth.frames) for one in cases["misses"]],
        "worst_false_alarms": [one.row(seen.truth.frames) for one in cases["false_alarms"]],
        "frame_names": list(seen.truth.frames),
        "definitions": DEFINITIONS,
    }
    report["in_short"] = in_short(report)
    write_page(
        folder / f"{KIND}.html",
        "evaluation/page.html.j2",
        report=report,
        pictures=paths,
        criteria={one.name: _TITLES[one.measure].format(one.limit) for one in CRITERIA},
        reasons=REASONS,
        near=near,
        overlapping=overlapping,
        definitions=DEFINITIONS,
    )
    written: dict[str, Any] = as_json(report)
    write_json(folder / f"{KIND}.json", written)
    return written


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


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"
