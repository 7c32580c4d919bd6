"""Bodies of the catalogue in the boxes of labelled real frames, along the frames' own rays.

Points, shape, intensity and lost rays of simulated road users beside the real ones, by class and
distance; notebook/real_objects.md says how each figure is measured. It needs no twin. Without a
folder: the frames of KITTI of ../shared/data.

    python benchmarks/real_objects.py kitti/training --frames 12-23 37-49
    python benchmarks/real_objects.py clouds/ --sensor OS1-64 --json figures.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from objects_in_boxes.figures import FIGURES, figures_of
from objects_in_boxes.measure import ObjectSeen, compare_objects
from urbantwin.errors import InputError
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import sensor

KITTI = Path(__file__).parents[2] / "shared/data/recordings/kitti-training"
#: Sensors that recorded the data sets of a layout.
SENSORS = {
    "kitti": "HDL-64E",
    "semantic-kitti": "HDL-64E",
    "argoverse2": "VLP-32C",
    "nuscenes": "HDL-32E",
    "tumtraf": "OS1-64",
}
#: Draws of the bootstrap over objects.
DRAWS = 400


def numbers_of(spans: list[str], count: int) -> list[int]:
    """Return frame numbers of spans such as ``12-23``; all of them without a span."""
    chosen = []
    for span in spans:
        first, _, last = span.partition("-")
        chosen += range(int(first), int(last or first) + 1)
    return [number for number in chosen if number < count] if spans else list(range(count))


def objects_of(folder: Path, model: str | None, spans: list[str]) -> list[ObjectSeen]:
    """Return the labelled objects of a recording with a body of the catalogue in each."""
    recording = open_recording(folder)
    name = model or SENSORS.get(recording.layout)
    if name is None:
        raise SystemExit(f"{folder} does not say which sensor recorded it: give --sensor")
    seen: list[ObjectSeen] = []
    scale = 0.0
    for number in numbers_of(spans, len(recording)):
        try:
            frame = recording.read(number)
            if frame.intensity is not None:
                scale = max(scale, full_scale(float(frame.intensity.max())))
            seen += compare_objects(frame, sensor(name), scale=scale or None, seed=number)
        except InputError as error:
            print(f"left out: {error}")
    return seen


def interval(values: list[float]) -> list[float]:
    """Return the middle 95 % of the median when objects are drawn again."""
    random = np.random.default_rng(0)
    drawn = np.median(random.choice(values, (DRAWS, len(values))), axis=1)
    return [round(float(one), 3) for one in np.percentile(drawn, (2.5, 97.5))]


def with_intervals(row: dict, seen: list[ObjectSeen]) -> dict:
    """Add 95 % intervals of the ratio of points and of the shape's distance to a row."""
    mine = [
        one
        for one in seen
        if one.class_name == row["class"] and row["from_m"] <= one.distance_m < row["to_m"]
    ]
    ratios = [one.counts["mended"] / one.counts["real"] for one in mine if one.counts["real"] >= 20]
    away = [one.chamfer_m["both"] for one in mine if one.chamfer_m["both"] is not None]
    for name, values in (("points_ratio", ratios), ("chamfer_both_m", away)):
        if values:
            row[f"{name}_95"] = interval(values)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=KITTI)
    parser.add_argument("--sensor", metavar="MODEL", help="model that recorded the frames")
    parser.add_argument("--frames", nargs="*", default=[], metavar="FIRST-LAST")
    parser.add_argument("--json", type=Path, help="write figures and objects to this file")
    given = parser.parse_args()
    if not given.folder.is_dir():
        raise SystemExit(f"{given.folder} is missing")
    seen = objects_of(given.folder, given.sensor, given.frames)
    rows = [with_intervals(row, seen) for row in figures_of(seen)]
    for row in rows:
        print(json.dumps({key: value for key, value in row.items() if value is not None}))
    if given.json:
        objects = [one.as_json() for one in seen]
        written = {"figures": rows, "objects": objects, "definitions": FIGURES}
        given.json.write_text(json.dumps(written, indent=1))


if __name__ == "__main__":
    main()
