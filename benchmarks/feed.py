"""Frames per second that `Frames.torch` hands to a training, against a plain loop of NumPy.

The loop reads what every loader must: `np.load` of the points and `np.fromfile` of their labels,
and nothing of boxes. The loader reads these, takes the labels apart, filters and brings the boxes,
and puts frames together to batches; with any number of workers. Both go over the same frames, which
the machine has in memory: a disk that is slower than either bounds both.

Then somebody takes the batches who is busy for a given time per frame, as a GPU is (this process
sleeps: its processor is free): which share of the time does it wait for the next batch?
PointPillars takes 16 ms for a frame forwards (Lang et al. 2019, CVPR, on a GTX 1080 Ti), and a step
of training about three times as much; 10 ms a frame is a GPU of today, several times as fast.

    python benchmarks/feed.py                      # records 60 frames of the street of record.py
    python benchmarks/feed.py out/dataset --workers 0 1 2 4 8 --busy-ms 10
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

import urbantwin as ut
from record import RATE_HZ, circling_motion, static_world, twin_of
from urbantwin.dataset import record
from urbantwin.dataset.reading.torch_frames import FrameDataset
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec, SensorSpec

FRAMES, ACTORS, BATCH = 60, 50, 4


def recorded(folder: Path) -> Path:
    """Record the street of `record.py` by an OS1-128 of 1024 columns."""
    twin = twin_of(static_world(), folder / "twin")
    motion = circling_motion(twin, ACTORS, FRAMES)
    sensor = SensorSpec(name="pole", model="OS1-128", east_m=0, north_m=0, height_m=6, columns=1024)
    rig = place_rig(RigSpec(sensors=[sensor], rate_hz=RATE_HZ), twin.mesh)
    record(twin, motion, rig, folder / "dataset")
    return folder / "dataset"


def plain(folder: Path, names: list[str], rounds: int) -> tuple[float, float]:
    """Frames per second of the loop, and milliseconds of processor time of a frame."""
    began, worked = time.perf_counter(), time.process_time()
    for _ in range(rounds):
        for name in names:
            np.load(folder / "points" / f"{name}.npy")
            np.fromfile(folder / "semantic" / f"{name}.label", "<u4")
    frames = rounds * len(names)
    return frames / (time.perf_counter() - began), 1e3 * (time.process_time() - worked) / frames


def fed(
    samples: FrameDataset, workers: int, rounds: int, busy_s: float = 0.0
) -> tuple[float, float, float]:
    """Frames per second, the share of the time that who takes them waited, and of processor time.

    The last is of this process, in milliseconds a frame: without workers, all that there is.
    """
    loader = samples.loader(batch_size=BATCH, workers=workers, shuffle=True)
    for _ in loader:  # workers start, and the machine has read the files
        pass
    frames, waited, began, worked = 0, 0.0, time.perf_counter(), time.process_time()
    for _ in range(rounds):
        batches = iter(loader)
        while True:
            asked = time.perf_counter()
            batch = next(batches, None)
            waited += time.perf_counter() - asked
            if batch is None:
                break
            frames += len(batch["frame"])
            time.sleep(busy_s * len(batch["frame"]))
    taken = time.perf_counter() - began
    return frames / taken, waited / taken, 1e3 * (time.process_time() - worked) / frames


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", nargs="?", type=Path)
    parser.add_argument("--workers", nargs="+", type=int, default=[0, 1, 2, 4])
    parser.add_argument("--busy-ms", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=4)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        dataset = ut.Dataset.open(asked.dataset or recorded(Path(scratch)))
        some = dataset.where(frames=dataset.names[:100], classes=["car"], min_points=5)
        points = np.mean([len(frame.points) for frame in some])
        loop, loop_ms = max(plain(dataset.folder, list(some.names), asked.rounds) for _ in range(2))
        print(
            f"{len(some)} frames of {points:,.0f} points, batches of {BATCH}, "
            f"{os.cpu_count()} processors"
        )
        print(
            f"plain loop of np.load, points and labels: {loop:.0f} frames/s, "
            f"{loop_ms:.1f} ms of processor time a frame"
        )
        for name, samples in (
            ("points, labels and boxes", some.torch()),
            ("and flow", some.torch(flow=True)),
        ):
            print(f"{name}:")
            for workers in asked.workers:
                free, _, own_ms = fed(samples, workers, asked.rounds)
                held, waits, _ = fed(samples, workers, asked.rounds, asked.busy_ms / 1e3)
                print(
                    f"  {workers} workers: {free:6.0f} frames/s, {free / loop:.2f} of the loop, "
                    f"{own_ms:.1f} ms of processor time a frame in this process; "
                    f"busy for {asked.busy_ms:g} ms a frame: {held:.0f} frames/s, "
                    f"waits {waits:.0%} of the time"
                )


if __name__ == "__main__":
    main()
