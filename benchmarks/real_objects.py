"""Actors in real frames against ours in their boxes, with what chance does to each figure.

    python benchmarks/real_objects.py [SET ...] [--json FILE] [--coats 6] [--bright]

Sets are those of `notebook/real_lidar.md`. Of shapes: medians over objects. Of losses and codes:
all rays between neighbours that return from one object. Intervals are the middle 95 % of a
bootstrap over objects. With `--coats` only: what is lost with so many other draws of coats,
least and most. With `--bright` only: points on cars far beyond white, of plates, lamps and
reflectors.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pandaset_frame import pandaset_frame
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.objects.measure import ObjectSeen, compare_objects
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import sensor

DATA = Path(__file__).parents[1].parent / "shared/data"
KITTI = DATA / "recordings/kitti-training"
#: Recording, sensor, frames, and the sensor of several that is looked at.
SETS = {
    "kitti-fitted": ("kitti", "HDL-64E", (*range(12), *range(24, 37)), None),
    "kitti-judged": ("kitti", "HDL-64E", (*range(12, 24), *range(37, 50)), None),
    "argoverse-upper-fitted": ("argoverse", "VLP-32C", (0, 1), 0),
    "argoverse-lower-judged": ("argoverse", "VLP-32C", (0, 1), 1),
    "pandaset-judged": ("pandaset", "Pandar64", (0,), None),
}
SPANS_M = ((0, 80), *pairwise((0, 10, 20, 40)))
DRAWS, FEWEST_RAYS, FEWEST_POINTS = 400, 100, 20
#: Codes beyond these of 255 are of no paint: beyond 4 and 1.5 times white.
BRIGHT = {"argoverse": 130, "pandaset": 150}
#: An end of a car is so deep, metres.
END_M = 0.4


def frames_of(name: str, numbers: tuple[int, ...], only: int | None) -> list[tuple[int, Frame]]:
    """Return the frames of a set, with their numbers."""
    if name == "pandaset":
        return [(0, pandaset_frame())]
    if name == "argoverse":
        recording = open_recording(DATA / "lidar/argoverse2-pittsburgh")
        return [(k, of_sensor(recording.read(k), only)) for k in numbers]
    recording = open_recording(KITTI)
    rows = [k for k, stem in enumerate(recording.names) if int(stem) in numbers]
    return [(int(recording.names[k]), recording.read(k)) for k in rows]


def of_sensor(frame: Frame, only: int | None) -> Frame:
    """Return a frame with the points of one of its sensors alone."""
    if only is None or frame.sensor is None or frame.ring is None or frame.intensity is None:
        return frame
    mine = frame.sensor == only
    return replace(
        frame,
        points=frame.points[mine],
        intensity=frame.intensity[mine],
        ring=frame.ring[mine],
        time_s=None,
        column=None,
        sensor=None,
        sensor_places=frame.sensor_places[only : only + 1],
    )


def seen_in(name: str, coats: int = 0) -> list[ObjectSeen]:
    """Return the objects of a set, in one draw of coats."""
    recording, model, numbers, only = SETS[name]
    seen: list[ObjectSeen] = []
    for number, frame in frames_of(recording, numbers, only):
        scale = None if frame.intensity is None else full_scale(float(frame.intensity.max()))
        try:
            seen += compare_objects(frame, sensor(model), scale=scale, seed=number, coats=coats)
        except InputError as error:
            print(f"left out: {error}")
    return seen


def interval(values: list, figure) -> list[float]:
    """Return the middle 95 % of a figure of objects drawn again."""
    random = np.random.default_rng(0)
    drawn = [
        figure([values[k] for k in random.integers(0, len(values), len(values))])
        for _ in range(DRAWS)
    ]
    return [round(float(one), 3) for one in np.nanpercentile(drawn, (2.5, 97.5))]


def shapes(seen: list[ObjectSeen]) -> dict:
    """Return Chamfer distances, of ours to ours drawn again too, and ratios of points."""
    chamfer = {
        f"chamfer_{key}_m": [one.chamfer_m[key] for one in seen if one.chamfer_m[key] is not None]
        for key in ("both", "opaque", "again")
    }
    ratio = [
        one.counts["mended"] / one.counts["real"]
        for one in seen
        if one.counts["real"] >= FEWEST_POINTS
    ]
    row: dict = {"objects": len(seen)}
    for key, values in (chamfer | {"points": ratio}).items():
        if values:
            row[key] = [round(float(np.median(values)), 3), interval(values, np.median)]
    return row


def losses(seen: list[ObjectSeen]) -> dict:
    """Return shares lost and median codes of real and ours, and the real ones' intervals."""
    row: dict = {}
    for key, pane in (("lost", None), ("lost_opaque", False), ("lost_panes", True)):
        counted = []
        for one in seen:
            rays = one.rays
            mine = rays.judged if pane is None else rays.judged & (rays.pane == pane)
            counted.append((mine.sum(), rays.real_lost[mine].sum(), rays.lost[mine].sum()))
        total, real, ours = np.sum(counted, axis=0)
        if total >= FEWEST_RAYS:
            share = interval(counted, lambda some: np.divide(*np.sum(some, axis=0)[[1, 0]]))
            row[key] = [round(real / total, 3), round(ours / total, 3), share, int(total)]
    both = [(one.real_codes, one.codes) for one in seen if len(one.real_codes)]
    if both and sum(len(real) for real, _ in both) >= FEWEST_RAYS:
        sides = [np.median(np.concatenate(side)) for side in zip(*both, strict=True)]
        reals = interval([real for real, _ in both], lambda some: np.median(np.concatenate(some)))
        row["code"] = [*(round(float(one), 3) for one in sides), reals]
    through = np.array([(one.rays.real_far.sum(), one.counts["real"]) for one in seen]).sum(axis=0)
    ours = np.array([(one.rays.far.sum(), one.counts["mended"]) for one in seen]).sum(axis=0)
    row["through"] = [round(float(a / b), 3) for a, b in (through, ours)]
    return row


def losses_by_coats(name: str, draws: int) -> None:
    """Print real losses of a set beside the least, the mean and the most of several draws."""
    seen = [seen_in(name, coats) for coats in range(1, draws + 1)]
    for low, high in SPANS_M:
        rows = [losses([one for one in some if low <= one.distance_m < high]) for some in seen]
        for key in ("lost", "lost_opaque", "lost_panes"):
            if key in rows[0]:
                ours = [row[key][1] for row in rows]
                told = {"least": min(ours), "mean": round(float(np.mean(ours)), 3)}
                told |= {"most": max(ours), "real": rows[0][key][0]}
                told["real_95"] = rows[0][key][2]
                print(json.dumps({"set": name, "range_m": [low, high], key: told}), flush=True)


def bright(name: str) -> dict:
    """Return points on cars that are far beyond white, of real cars and of ours.

    Shares of points (with the middle 95 % of the real one), how many cars have any, and where they
    lie: at the front or rear end, or on the sides; the median height in parts of the car's.
    """
    seen = [one for one in seen_in(name) if one.class_name == "car"]
    row: dict = {"set": name, "cars": len(seen)}
    for side in ("real", "ours"):
        counted, front, high = [], [], []
        for one in seen:
            points, codes = (one.real, one.real_codes) if side == "real" else (one.ours, one.codes)
            beyond = codes > BRIGHT[SETS[name][0]] / 255
            counted.append((int(beyond.sum()), len(codes)))
            x, y, z, length, _, height, yaw = one.mended_box
            away = points[beyond] - [x, y, z]
            along = away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw)
            front += np.where(np.abs(along) > length / 2 - END_M, np.sign(along), 0).tolist()
            high += (away[:, 2] / height + 0.5).tolist()
        total, of = np.sum(counted, axis=0)
        row[side] = {
            "share": round(float(total / of), 5),
            "cars": sum(count > 0 for count, _ in counted),
            "front": front.count(1),
            "rear": front.count(-1),
            "sides": front.count(0),
            "height": round(float(np.median(high)), 2) if high else None,
        }
        if side == "real":
            share = interval(counted, lambda some: np.divide(*np.sum(some, axis=0)))
            row["real"]["share_95"] = share
    return row


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sets", nargs="*", default=list(SETS))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--coats", type=int, help="so many other draws of coats, losses alone")
    parser.add_argument("--bright", action="store_true", help="points far beyond white alone")
    given = parser.parse_args()
    if given.bright:
        for name in given.sets:
            if SETS[name][0] in BRIGHT:
                print(json.dumps(bright(name)), flush=True)
        return
    if given.coats:
        for name in given.sets:
            losses_by_coats(name, given.coats)
        return
    rows = []
    for name in given.sets:
        seen = seen_in(name)
        groups = {"all": seen}
        for kind in sorted({one.class_name for one in seen}):
            groups[kind] = [one for one in seen if one.class_name == kind]
        for kind, mine in groups.items():
            for low, high in SPANS_M:
                here = [one for one in mine if low <= one.distance_m < high]
                if here:
                    row = {"set": name, "class": kind, "range_m": [low, high]}
                    rows.append(row | shapes(here) | losses(here))
                    print(json.dumps(rows[-1]), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
