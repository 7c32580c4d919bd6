"""Packets of a page: how large a frame is, and how long it takes to make one and to save it.

python benchmarks/page.py [DATASET]   (without one, a VLP-16 at the example junction is recorded)
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import urbantwin as ut
from urbantwin.web import open_shown
from urbantwin.web.chosen_frames import ChosenFrames
from urbantwin.web.wanted import Wanted

EXAMPLE = Path(__file__).parents[1] / "examples" / "two-avenues" / "site.yaml"


def recorded(folder: Path) -> Path:
    twin = ut.build(EXAMPLE, folder / "twin", pictures=False, progress=False)
    motion = ut.drive(twin, folder / "motion", seconds=5, progress=False)
    out = folder / "dataset"
    return ut.record(twin, motion, out, stop=2.0, pictures=False, progress=False).folder


def took_ms(make: Callable[[], object]) -> float:
    began = time.perf_counter()
    make()
    return 1000 * (time.perf_counter() - began)


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        given = Path(sys.argv[1]) if len(sys.argv) > 1 else recorded(Path(scratch))
        began = time.perf_counter()
        shown = open_shown(Wanted(given, frames=ChosenFrames(0, 20)))
        print(f"open: {time.perf_counter() - began:.2f} s")
        count = len(shown.sides[0].entries)
        for kind in ("points", "boxes"):
            names = [f"{kind}/0/{index}" for index in range(count)]
            times = [took_ms(lambda name=name: shown.packet(name)) for name in names]
            sizes = [len(shown.packet(name)) for name in names]
            print(f"{kind}: {np.median(sizes) / 1e3:,.0f} kB, {np.median(times):.1f} ms a frame")
        points = np.median([entry.points for entry in shown.sides[0].entries])
        each = np.median([len(shown.packet(f"points/0/{k}")) for k in range(count)]) / points
        print(f"{points:,.0f} points a frame, {each:.1f} bytes each")
        for name in shown.layers:
            spent = took_ms(lambda name=name: shown.packet(name))
            print(f"{name}: {len(shown.packet(name)) / 1e3:,.0f} kB, {spent:.0f} ms")
        page = Path(scratch) / "page.html"
        spent = took_ms(lambda: ut.view(given, save=page, frames="0:10", progress=False))
        print(f"saved page of 10 frames: {page.stat().st_size / 1e6:.1f} MB, {spent / 1e3:.1f} s")


if __name__ == "__main__":
    main()
