"""Contents of ``evaluation.json``, and the report folder with its page and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from urbantwin.artefact import as_json, write_json
from urbantwin.evaluation.bootstrap import same_objects
from urbantwin.evaluation.criterion import CRITERIA, JUDGED, near, overlapping
from urbantwin.evaluation.evaluate import Figures
from urbantwin.evaluation.false_alarms import REASONS
from urbantwin.evaluation.tracks import judged_tracks
from urbantwin.evaluation.worst import Case, worst_false_alarms, worst_misses
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, LOST, blank, legend, plain, save
from urbantwin.geometry import box_corners
from urbantwin.pages import write_page

__all__ = ["KIND", "write_evaluation"]


DEFINITIONS: dict[str, str] = {
    "ap": "Average precision: the mean over forty levels of recall, 1/40 to 1, of the best "
    "precision at that recall or above (Simonelli et al. 2019). Detections are taken by falling "
    "score; each finds the best object that meets the criterion and that none found before.",
    "bev_iou, iou_3d": "Intersection over union of the boxes, in plan and in space.",
    "within": "Distance of the centres in plan.",
    "ap_nuscenes": "The same detections by nuScenes' definition (Caesar et al. 2020): precision "
    "interpolated at 101 levels of recall, above 10 % of recall, as far as it is above 10 %.",
    "ci95": "2.5th to 97.5th percentile of draws of frames with replacement, neighbours together "
    "where they show the same objects (moving blocks, Künsch 1989). Frames of one hour and place "
    "say nothing of other places.",
    "not counted": "Neither help nor hurt: objects with too few points, marked as ignored, or of a "
    "class that is not told apart. A detection that meets the criterion with one, or that lies in "
    "it by half, is left out. So is one outside of what is labelled that finds nothing.",
    "distinct": "Objects counted once however many frames show them: by their tracks, else those "
    "that stand at the same place in the next frame.",
    "best_f1": "At the threshold of the score with the best F1, chosen on these very labels: an "
    "upper bound. By distance: 2 m for trucks, buses and large, 1 m for the others.",
    "found": "Share of the objects that are found at that threshold.",
    "by range, points, hidden": "Objects of other bins neither help nor hurt; wrong detections are "
    "those of the same range, or with as many points in them; for hidden objects all.",
    "errors": "Of detections within 2 m in plan, at any score. ATE: distance of centres in plan; "
    "ASE: 1 - IoU after centres and headings are laid on each other; AOE: smallest difference of "
    "yaw (nuScenes; Argoverse 2 has another ASE). Signed ones are found less labelled, along the "
    "labelled heading.",
    "HOTA, DetA, AssA": "How well objects are found and followed (Luiten et al. 2021), the mean "
    "over 19 similarities. Boxes are as similar as centres are near in plan: 0.5 at 1 m (trucks, "
    "buses, large: 2 m), 0 twice as far. At the threshold of the best F1, as MOTA and IDF1.",
    "MOTA, swaps": "1 less the misses, wrong boxes and swaps of tracks over the objects, of all "
    "frames, at a similarity of 0.5 (Bernardin and Stiefelhagen 2008).",
    "IDF1": "F1 of boxes whose whole tracks are assigned to each other (Ristani et al. 2016).",
    "IoU of points": "Of each class the points rightly said to be of it over those that are or are "
    "said to be (SemanticKITTI, Behley et al. 2019), over all frames; unlabelled points and those "
    "beyond the model's range do not count. The mean is over the classes that are labelled.",
    "false alarms": "Wrong detections at or above the threshold of the best F1. Standing ones come "
    "within 1 m of the same place in half of the frames or more: posts, signs, hedges.",
}


#: Colours of the classes, distinguishable by colour-blind people (Okabe and Ito).
CLASS_COLOURS = {
    "car": "#0072b2",
    "truck": "#e69f00",
    "bus": "#d55e00",
    "motorcycle": "#cc79a7",
    "bicycle": "#009e73",
    "pedestrian": "#56b4e9",
    "large": "#1d2733",
}


def draw_figures(figures: Figures, path: Path) -> None:
    """Write the picture of the results as PNG."""
    figure = blank(15, 4.6)
    grid = figure.add_gridspec(1, 3, left=0.045, right=0.985, top=0.8, bottom=0.12, wspace=0.18)
    legend(
        figure,
        [
            (f"{name} ({one.figures['objects']})", CLASS_COLOURS[name])
            for name, one in figures.classes.items()
        ],
        0.035,
        0.99,
    )
    _curves(figure.add_subplot(grid[0]), figures)
    _by(figure.add_subplot(grid[1]), figures, "range", "Found, by range, %")
    _by(figure.add_subplot(grid[2]), figures, "points", "Found, by points in the box, %")
    save(figure, path)


def _curves(axes: Axes, figures: Figures) -> None:
    plain(axes, "Precision over recall, by distance of centres, %")
    for name, one in figures.classes.items():
        if not one.found.total or not len(one.found.detection):
            continue
        hits = np.cumsum(one.found.right)
        precision = hits / np.arange(1, len(hits) + 1)
        recall = hits / one.found.total
        limit = f"{name}: {near(name).limit:g} m"
        axes.plot(100 * recall, 100 * precision, color=CLASS_COLOURS[name], lw=1.5, label=limit)
    axes.set(xlim=(0, 101), ylim=(0, 102))
    if axes.lines:
        axes.legend(fontsize=8, frameon=False, loc="lower left")


def _by(axes: Axes, figures: Figures, kind: str, title: str) -> None:
    """Draw the share of objects found at the best threshold, one line per class."""
    plain(axes, title)
    bins = list(
        dict.fromkeys(
            row["bin"]
            for one in figures.classes.values()
            for row in one.figures["by"]
            if row["by"] == kind
        )
    )
    bins.sort(key=lambda text: float(text.split()[0]))
    for name, one in figures.classes.items():
        rows = [row for row in one.figures["by"] if row["by"] == kind]
        at = [bins.index(row["bin"]) for row in rows]
        axes.plot(at, [100 * row["found"] for row in rows], "o-", color=CLASS_COLOURS[name], ms=4)
    short = [one.replace(" and more", "+").replace(" to ", "–") for one in bins]
    axes.set_xticks(range(len(bins)), [one.removesuffix(" points") for one in short], fontsize=7.5)
    axes.set_ylim(0, 102)


_COLUMNS = 4
_FOUND = COLOURS["synthetic"]
#: Half the edge of a picture: the larger of a minimum (metres) and a multiple of the box length.
_LEAST_M, _TIMES = 5.0, 1.2
#: Points higher than this above the ground are drawn darker, metres.
_GROUND_M = 0.2


def draw_cases(
    cases: Sequence[Case],
    figures: Figures,
    recording: Recording,
    path: Path,
) -> None:
    """Draw cases, each from above and from the side.

    Args:
        cases: at least one case.
        figures: results with the labels and detections to draw.
        recording: recording with the points.
        path: the PNG to write.
    """
    rows = -(-len(cases) // _COLUMNS)
    figure = blank(15, 0.6 + 5.6 * rows)
    grid = figure.add_gridspec(
        2 * rows,
        _COLUMNS,
        left=0.03,
        right=0.99,
        top=1 - 0.75 / (0.6 + 5.6 * rows),
        bottom=0.03,
        hspace=0.28,
        wspace=0.12,
        height_ratios=[3.0, 1.5] * rows,
    )
    legend(
        figure,
        [("labelled", INK), ("labelled, does not count", "#9aa7b4"), ("detected", _FOUND)]
        + [("false alarm", LOST)] * any(one.score is not None for one in cases),
        0.025,
        0.998,
    )
    clouds: dict[int, NDArray[np.float64]] = {}
    for place, one in enumerate(cases):
        if one.frame not in clouds:
            clouds[one.frame] = recording.read(figures.seen.number[one.frame]).points
        row, column = divmod(place, _COLUMNS)
        above = figure.add_subplot(grid[2 * row, column])
        aside = figure.add_subplot(grid[2 * row + 1, column])
        _draw(above, aside, one, figures, clouds[one.frame])
    save(figure, path)


def _draw(
    above: Axes, aside: Axes, one: Case, figures: Figures, points: NDArray[np.float64]
) -> None:
    reach = max(_LEAST_M, _TIMES * float(one.box[3]))
    near = points[(np.abs(points[:, :2] - one.box[:2]) <= reach).all(axis=1)]
    named = figures.seen.truth.frames[one.frame].rsplit(".", 1)[0]
    score = "" if one.score is None else f" {one.score:.2f}"
    above.set_title(
        f"{one.class_name}{score} in {named[-12:]}, {one.range_m:.0f} m, "
        f"{one.num_points} points\n{one.told}",
        loc="left",
        fontsize=7.5,
        color=INK,
    )
    floor = np.percentile(near[:, 2], 2) if len(near) else 0.0
    high = near[:, 2] > floor + _GROUND_M
    above.plot(*near[~high, :2].T, ".", color=FAINT, markersize=1.2)
    above.plot(*near[high, :2].T, ".", color="#5a6675", markersize=1.6)
    ahead = np.array([np.cos(one.box[6]), np.sin(one.box[6])])
    left = np.array([-ahead[1], ahead[0]])
    strip = near[np.abs((near[:, :2] - one.box[:2]) @ left) <= one.box[4] / 2 + 0.5]
    aside.plot((strip[:, :2] - one.box[:2]) @ ahead, strip[:, 2], ".", color="#5a6675", ms=1.6)
    for box, colour, width in _boxes(one, figures):
        away = np.hypot(*(box[:2] - one.box[:2]))
        if away > 1.5 * reach + box[3:5].sum() / 2:
            continue  # outside of both pictures; poor detectors have hundreds
        corners = box_corners(box)
        above.add_patch(Polygon(corners[:4, :2], fill=False, edgecolor=colour, linewidth=width))
        nose = box[:2] + np.array([np.cos(box[6]), np.sin(box[6])]) * box[3] / 2
        above.plot(*np.array([box[:2], nose]).T, color=colour, linewidth=width / 2)
        if np.abs((box[:2] - one.box[:2]) @ left) <= box[4] / 2 + 0.5:
            u = (corners[:, :2] - one.box[:2]) @ ahead
            low, top = box[2] - box[5] / 2, box[2] + box[5] / 2
            outline = [(u.min(), low), (u.max(), low), (u.max(), top), (u.min(), top)]
            aside.add_patch(Polygon(outline, fill=False, edgecolor=colour, linewidth=width))
    x, y, z = one.box[:3]
    above.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), aspect="equal")
    aside.set(xlim=(-reach, reach), ylim=(z - 0.3 * reach - 1, z + 0.2 * reach + 2))
    aside.set_aspect("equal")
    for axes in (above, aside):
        axes.tick_params(labelsize=6, length=2)
        for spine in axes.spines.values():
            spine.set_color(FAINT)


def _boxes(one: Case, figures: Figures) -> list[tuple[NDArray[np.float64], str, float]]:
    """Return the boxes of the frame with colours and line widths; the case's own box is last."""
    truth, found = figures.seen.truth, figures.seen.detections
    own = figures.classes[one.class_name]
    drawn: list[tuple[NDArray[np.float64], str, float]] = []
    for row in np.flatnonzero(truth.frame == one.frame):
        counts = any(judged.roles[row] > 0 for judged in figures.classes.values())
        drawn.append((truth.box[row], INK if counts else "#9aa7b4", 1.2))
    mine = found.frame == one.frame
    threshold = own.threshold
    shown = np.flatnonzero(mine & (found.score >= threshold))
    drawn += [(found.box[row], _FOUND, 1.2) for row in shown]
    drawn.append((one.box, INK if one.score is None else LOST, 2.4))
    return drawn


KIND = "evaluation"
#: Number of misses and of false alarms drawn.
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
        folder: output folder.
        figures: results of all classes.
        recording: recording with the points.
        told: names of the detections and data, and the settings.
        semantic: result of `semantic.judged_semantic`.

    Returns:
        The contents of ``evaluation.json``.
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
    """Return the headline: precision per class at its distance and at half overlap, in %."""
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
