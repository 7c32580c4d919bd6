"""`compare` on a hundred pairs of frames, timed whole; P95 Hausdorff beside Open3D in the same run.

Real frames are recorded in the street of `record.py`: an OS1-128 with 1024 columns among 50 actors,
with labels, beams and noise. The twin is recorded by a sensor 0.1 m beside, with other traffic and
other noise; all frames are then made 100,000 points long (points are drawn, or drawn again with
1 cm of noise). With `--sweeps`, frames are made of real sweeps in the same way, without labels: the
twin of a frame is another sweep, turned and moved a little. Everything is seeded.

`compare` runs as a person runs it, in a process of its own, with all default measures, both
anchors, pictures and the page. Processor time is that of all its processes together: it tells more
than the clock where the machine has other work to do. Memory is the sum of the shares of all of
them. The arbitrary site is recorded before, as it is once for every rig.

    python benchmarks/fidelity.py
    python benchmarks/fidelity.py --sweeps DATA/argoverse2-pittsburgh --json
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from record import RATE_HZ, circling_motion, static_world, twin_of
from urbantwin.dataset import record
from urbantwin.fidelity import Frame, P95Hausdorff, nearest_distances
from urbantwin.fidelity.arbitrary import arbitrary_recording
from urbantwin.fidelity.readers import open_recording
from urbantwin.lidar import place_rig
from urbantwin.processes import usable_processors
from urbantwin.site.rig import RigSpec, SensorSpec

NOISE_M = 0.01


def drawn(count: int, wanted: int, seed: int) -> NDArray[np.int64]:
    """Rows of ``wanted`` of ``count`` points in order: some of them, or all and some twice."""
    rng = np.random.default_rng(seed)
    again = rng.choice(count, wanted % count, replace=False)
    return np.sort(np.concatenate([np.tile(np.arange(count), wanted // count), again]))


def resized(folder: Path, points: int) -> None:
    """Give every frame of a dataset of ours so many points."""
    for index, file in enumerate(sorted((folder / "points").glob("*.npy"))):
        table = np.load(file)
        rows = drawn(len(table), points, index)
        table = table[rows]
        twice = np.flatnonzero(np.diff(rows, prepend=-1) == 0)
        rng = np.random.default_rng(index)
        table[twice, :3] += rng.normal(scale=NOISE_M, size=(len(twice), 3))
        np.save(file, table)
        rays = folder / "rays" / file.name
        np.save(rays, np.load(rays)[rows])
        labels = folder / "semantic" / f"{file.stem}.label"
        np.fromfile(labels, "<u4")[rows].tofile(labels)


def recorded(scratch: Path, frames: int, points: int) -> tuple[Path, Path]:
    """Folders of frames of the street and of its twin."""
    for name, seed, actors, aside in (("real", 1, 50, 0.0), ("twin", 2, 45, 0.1)):
        world = twin_of(static_world(), scratch / f"{name}-world")
        sensor = SensorSpec(
            name="os1", model="OS1-128", columns=1024, east_m=aside, north_m=0.0, height_m=5.0
        )
        rig = place_rig(RigSpec(rate_hz=RATE_HZ, sensors=[sensor]), world.mesh)
        motion = circling_motion(world, actors, frames + 1)
        last = frames if name == "real" else frames - 1  # the last real frame's neighbour
        record(world, motion, rig, scratch / name, seed=seed, stop_s=last / RATE_HZ)
        resized(scratch / name, points)
    return scratch / "real", scratch / "twin"


def of_sweeps(data: Path, scratch: Path, frames: int, points: int) -> tuple[Path, Path]:
    """Folders of frames made of real sweeps, and of others of them."""
    sweeps = list(open_recording(data))
    for part, name in enumerate(("real", "twin")):
        (scratch / name).mkdir()
        for index in range(frames + 1 - part):
            rng = np.random.default_rng([part, index])
            sweep = sweeps[(index + part) % len(sweeps)]
            rows = drawn(len(sweep.points), points, index + part * frames)
            place = sweep.points[rows] + rng.normal(scale=NOISE_M, size=(points, 3))
            if part:
                turn = np.radians(rng.normal(scale=0.2))
                c, s = np.cos(turn), np.sin(turn)
                place[:, :2] = place[:, :2] @ np.array([[c, s], [-s, c]]) + rng.normal(0, 0.05, 2)
            shade = np.zeros(points) if sweep.intensity is None else sweep.intensity[rows]
            table = np.column_stack([place, shade]).astype(np.float32)
            np.save(scratch / name / f"{index:06d}.npy", table)
    return scratch / "real", scratch / "twin"


def family(root: int) -> list[int]:
    """A process and all that it started."""
    found, parents = [root], {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text().rsplit(")")[-1].split()[1]
                )
            except OSError:
                continue
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def shares_mb(root: int) -> float:
    """What a process and all that it started have in memory: pages of several in equal shares."""
    total = 0
    for one in family(root):
        try:
            text = Path(f"/proc/{one}/smaps_rollup").read_text(encoding="utf-8")
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:"))
    return total / 1024


def timed_compare(real: Path, twin: Path, out: Path, workers: int) -> dict[str, float]:
    """Run `urbantwin compare` and watch it."""
    command = [sys.executable, "-m", "urbantwin", "compare", str(real), str(twin), "-o", str(out)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    run = subprocess.Popen([*command, "--workers", str(workers), "--quiet"], env=os.environ)
    most, ended = [0.0], threading.Event()

    def watch() -> None:
        while not ended.wait(0.5):
            most[0] = max(most[0], shares_mb(run.pid))

    watcher = threading.Thread(target=watch)
    watcher.start()
    code = run.wait()
    took = time.perf_counter() - began
    ended.set()
    watcher.join()
    if code:
        raise SystemExit(code)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"seconds": took, "processor_s": used, "memory_mb": most[0]}


def beside_open3d(real: list[Frame], twin: list[Frame], rounds: int) -> dict[str, float]:
    """P95 Hausdorff of pairs by us and by Open3D's nearest distances, in turn; medians, seconds."""
    import open3d as o3d

    def ours(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        return P95Hausdorff.of(nearest_distances(a, b)).both

    def theirs(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(one)) for one in (a, b)]
        away = [np.asarray(clouds[k].compute_point_cloud_distance(clouds[1 - k])) for k in (0, 1)]
        return max(float(np.percentile(one, 95)) for one in away)

    taken: dict[str, list[float]] = {"ours": [], "open3d": [], "ours_cpu": [], "open3d_cpu": []}
    apart = 0.0
    for number in range(rounds):
        for one, other in zip(real, twin, strict=True):
            a, b = one.points, other.points
            found = {}
            for name in ("ours", "open3d") if number % 2 else ("open3d", "ours"):
                began, used = time.perf_counter(), time.process_time()
                found[name] = ours(a, b) if name == "ours" else theirs(a, b)
                if number:  # the first round warms up
                    taken[name].append(time.perf_counter() - began)
                    taken[f"{name}_cpu"].append(time.process_time() - used)
            apart = max(apart, abs(found["ours"] - found["open3d"]))
    middle = {name: float(np.median(values)) for name, values in taken.items()}
    return {
        "hausdorff_ms": 1000 * middle["ours"],
        "open3d_ms": 1000 * middle["open3d"],
        "times_open3d": middle["ours"] / middle["open3d"],
        "times_open3d_processor": middle["ours_cpu"] / middle["open3d_cpu"],
        "largest_difference_m": apart,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--points", type=int, default=100_000, help="of every frame")
    parser.add_argument("--workers", type=int, default=usable_processors())
    parser.add_argument("--sweeps", type=Path, help="real sweeps to make the frames of")
    parser.add_argument("--rounds", type=int, default=6, help="of P95 Hausdorff on five pairs")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        if given.sweeps is None:
            real, twin = recorded(scratch, given.pairs, given.points)
        else:
            real, twin = of_sweeps(given.sweeps, scratch, given.pairs, given.points)
        arbitrary_recording(open_recording(twin), given.pairs, scratch / "arbitrary")
        result: dict[str, float] = {"pairs": given.pairs, "points": given.points}
        result["workers"] = given.workers
        result |= timed_compare(real, twin, scratch / "report", given.workers)
        result["seconds_a_pair"] = result["seconds"] / given.pairs
        report = json.loads((scratch / "report/report.json").read_text())
        result["pairs_with_arbitrary"] = sum(
            one["arbitrary_figures"] is not None for one in report["frames"]
        )
        frames = [[open_recording(side).read(k) for k in range(5)] for side in (real, twin)]
        result |= beside_open3d(*frames, given.rounds)
    if given.json:
        print(json.dumps(result, indent=2))
    else:
        print("\n".join(f"{key}: {value:.4g}" for key, value in result.items()))


if __name__ == "__main__":
    main()
