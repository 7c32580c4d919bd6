"""Every measure of ``compare`` for the twin of Pittsburgh, with and without what was measured.

Whole frames, with all that the real ones show: facades, trees, poles, the ground beside roads.

    python benchmarks/pittsburgh_frames.py -o reports/
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from argoverse_fidelity import write
from argoverse_log import DATA, SENSORS, Log
from pittsburgh import measure, table
from urbantwin.fidelity import compare
from urbantwin.fidelity.beams import AZIMUTH_CELL_DEG
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording


def whole_frames(data: Path, out: Path) -> list[dict[str, Any]]:
    """Write a report for each twin; the means of each measure over both sweeps, by side.

    Args:
        data: the log's folder.
        out: for the frames and the reports.
    """
    log = Log(data)
    seen: list[Any] = []
    measure(data, keep=seen)
    shutil.rmtree(out / "frames", ignore_errors=True)
    recording = open_recording(log.folder)
    real = [recording.read(index) for index in range(len(recording))]
    # On one scale of intensity, and with the annotated boxes on both sides.
    bright = [np.zeros(0) if one.intensity is None else one.intensity / 255 for one in real]
    real = [
        replace(one, intensity=light, column=columns(one, log))
        for one, light in zip(real, bright, strict=True)
    ]
    write(out / "frames/real", real)
    found: dict[str, dict[str, Any]] = {}
    for side in seen[0][1]:
        name = side.replace(" ", "-")
        pairs = zip(seen, real, strict=True)
        frames = [
            replace(one[1][side], boxes=its.boxes, instance=None, column=columns(one[1][side], log))
            for one, its in pairs
        ]
        report = compare(
            out / "frames/real",
            write(out / "frames" / name, frames),
            out / name,
            arbitrary=None,
            origin=log.mounts["up_lidar"].translation,
        )
        for part, figures in {"whole": report.whole, **report.parts}.items():
            again = figures.real_against_real or {}
            for key, aggregate in figures.twin.items():
                row = found.setdefault(f"{part} {key}", {"part": part, "measure": key})
                row[side] = None if aggregate is None else round(aggregate.mean, 4)
                anchor = again.get(key)
                row["real again"] = None if anchor is None else round(anchor.mean, 4)
    return list(found.values())


def columns(frame: Frame, log: Log) -> NDArray[np.int64]:
    """Cells of azimuth (N,) about each point's sensor: the real sweeps do not name columns."""
    places = np.stack([log.mounts[name].translation for name, _, _ in SENSORS])
    assert frame.sensor is not None
    seen = frame.points - places[frame.sensor]
    turn = np.degrees(np.arctan2(seen[:, 1], seen[:, 0])) % 360.0
    return np.floor(turn / AZIMUTH_CELL_DEG).astype(np.int64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("-o", "--out", type=Path, required=True, help="for frames and reports")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise SystemExit(f"{options.data} is missing")
    print(table(whole_frames(options.data, options.out)))


if __name__ == "__main__":
    main()
