"""Rays per second of the ray tracers, end to end: what the host knows goes in, hits come out.

The street and the actors of `scan.py` around an OS1-128 with 2048 columns. Every line counts all
262,144 rays of a turn, and the time from poses in the host's memory to hits in the host's memory.
With several threads (`--threads`) turns are cast side by side, as many as get done: Embree then
uses as many processors, and Warp gets the next turn ready while the device works on one.

    python benchmarks/device.py                     # Embree, bvh, and Warp on the first CUDA device
    python benchmarks/device.py --backend warp:cpu
    python benchmarks/device.py --threads 1 --threads 4 --threads 16
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from record import static_world
from scan import COLUMNS, Job, moments, rig_of
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors, cast_world
from urbantwin.lidar.casting.tracer import Firing, SensorPoses
from urbantwin.lidar.shapes import ActorShape, PresentActors, Shapes, ShapeTable
from urbantwin.lidar.timing import sweeps_of
from urbantwin.traffic.assets import asset_mesh


def best(action: Callable[[int], object], seconds: float, threads: int) -> float:
    """Seconds that an action takes: the median over some time, after two that do not count.

    With several threads: the time divided by how many they get done together.
    """
    action(0), action(1)
    if threads > 1:
        end = time.perf_counter() + seconds

        def many(first: int) -> int:
            done = 0
            while time.perf_counter() < end:
                action(first + threads * done)
                done += 1
            return done

        start = time.perf_counter()
        with ThreadPoolExecutor(threads) as pool:
            done = sum(pool.map(many, range(threads)))
        return (time.perf_counter() - start) / done
    taken, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(taken) < 3:
        start = time.perf_counter()
        action(len(taken))
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def lines(
    backend: str, mesh: LabelledMesh, actors: int, seconds: float, threads: Sequence[int]
) -> dict[int, dict[str, float]]:
    """Seconds per turn of everything that is measured, for each number of threads."""
    job = Job(actors=actors, effects=False)
    rig = rig_of(job, mesh)
    mounted, frames = rig.sensors[0], moments(actors)
    beams, pose = Beams.of(mounted), mounted.site_SE3_sensor
    (sweep,) = sweeps_of(mounted, 3, 0)
    tracer = tracer_on(backend)

    moved = mesh.vertices - pose.translation
    shape = ActorShape(
        LabelledMesh(moved, mesh.faces, mesh.semantic, mesh.material, mesh.part), with_hull=False
    )
    world, rotation = Shapes.of([shape]), pose.rotation[None]
    here = Firing.of(beams, sweep, SensorPoses(rotation, np.zeros((1, 3))))
    there = Firing.of(beams, sweep, SensorPoses(rotation, pose.translation[None]))
    table = ShapeTable(asset_mesh)
    present = [
        (
            np.array([table.number(one.asset, one.phase) for one in frame], np.int64),
            [one.way for one in frame],
        )
        for frame in frames
    ]

    def moving(number: int) -> object:
        shapes, ways = present[number % len(present)]
        found = PresentActors(table.arrays, shapes, Paths.of(ways))
        return cast_actors(tracer, beams, there, found, 120.0, glass=False)

    def standing(_: int) -> object:
        return cast_world(tracer, beams, here, world, glass=False, thorough=False)

    def both(number: int) -> object:
        return standing(number), moving(number)

    scanner = Scanner(mesh, rig, 0, backend=backend)
    measured: dict[str, Callable[[int], object]] = {
        "turn at the street": standing,
        "turn at the actors, street kept": moving,
        "turn at both": both,
        "labelled frame, street kept": lambda n: scanner.scan(n, frames[n % len(frames)]),
    }
    return {
        count: {name: best(action, seconds, count) for name, action in measured.items()}
        for count in threads
    }


def main() -> None:
    """Print a table, or JSON."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--backend", action="append", help="embree, bvh, warp or warp:DEVICE")
    options.add_argument("--actors", type=int, default=50)
    options.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    options.add_argument("--json", action="store_true")
    options.add_argument("--threads", action="append", type=int, help="that cast side by side: 1")
    chosen = options.parse_args()
    mesh = static_world()
    rays = 128 * COLUMNS
    table: dict[str, dict[str, float]] = {}
    for backend in chosen.backend or ["embree", "bvh", "warp"]:
        try:
            found = lines(backend, mesh, chosen.actors, chosen.seconds, chosen.threads or [1])
        except InputError as error:
            print(f"{backend}: {error}")
            continue
        for threads, rows in found.items():
            table[f"{backend} x {threads}" if threads > 1 else backend] = rows
    if chosen.json:
        print(json.dumps({"rays": rays, "triangles": len(mesh.faces), "seconds": table}, indent=1))
        return
    print(f"{rays} rays a turn, {len(mesh.faces)} triangles, {chosen.actors} actors")
    for backend, rows in table.items():
        for row, seconds in rows.items():
            rate = rays / seconds / 1e6
            print(f"{backend:>14}  {row:34} {seconds * 1e3:8.2f} ms  {rate:8.1f} M rays/s")


if __name__ == "__main__":
    main()
