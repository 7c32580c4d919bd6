"""Labelled frames per second in memory, against a full recast of the same world by Open3D.

The street of `record.py`: 480,000 triangles, and actors of every class on rings around an OS1-128
with 2048 columns. A frame of ours is whole: casting, returns, points, per-point labels and boxes;
no files. Where actors are at each moment is made before the clock starts, on both sides.
Open3D is timed for what people write without us: all triangles, standing and moving, put into a
new `RaycastingScene` and all rays cast, each frame, with every processor; hits and no labels.

Every line runs in a process of its own, which forks two workers when it is ready. Its memory is
that of all three, the interpreter and what compiled code was loaded included. Open3D runs before
and after, and its faster time counts. Beside the frames per second stands the processor time that
a frame takes on all processors together: it tells more where the machine has other work to do.

    python benchmarks/scan.py
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from record import REACH_M, height, static_world
from urbantwin.geometry import LabelledMesh, Pose, rotation_from_ypr
from urbantwin.lidar import PosedActor, Rig, Scanner, beam_directions, place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Asset, asset, asset_mesh, asset_names

RATE_HZ, SPEED_M_S, COLUMNS = 10.0, 8.0, 2048
#: Frames that are scanned in turn; the clock goes round them.
MOMENTS = 40


@dataclass(frozen=True)
class Job:
    """One line of the table."""

    actors: int = 50
    sensors: int = 1
    effects: bool = True
    rides: bool = False
    workers: int = 2
    seconds: float = 6.0


def kinds_of(count: int) -> list[Asset]:
    """Three fifths are cars, as on a street; the rest every other class in turn."""
    classes = [name for name in ACTOR_CLASSES if asset_names(name)]
    kinds = [classes[0] if n % 5 < 3 else classes[n // 5 % len(classes)] for n in range(count)]
    return [asset(asset_names(kind)[n % len(asset_names(kind))]) for n, kind in enumerate(kinds)]


def moments(count: int) -> list[list[PosedActor]]:
    """Actors that drive round the middle in rings, as many on every square metre of the reach."""
    number = np.arange(count)
    assets = kinds_of(count)
    radius = np.sqrt(8.0**2 + (REACH_M**2 - 8.0**2) * number / count)
    found = []
    for frame in range(MOMENTS):
        angle = 2.4 * number + SPEED_M_S * frame / RATE_HZ / radius
        places = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
        places[:, 2] = height(places[:, 0], places[:, 1])
        turns = rotation_from_ypr(angle + np.pi / 2, 0 * angle, 0 * angle)
        found.append(
            [
                PosedActor(
                    n + 1,
                    one.actor_class,
                    one.name,
                    frame % one.phases,
                    Pose(turns[n], places[n]),
                    SPEED_M_S * turns[n][:, 0],
                )
                for n, one in enumerate(assets)
            ]
        )
    return found


def rig_of(job: Job, mesh: LabelledMesh) -> Rig:
    """Sensors at 5 m in the middle and on a ring around it, or on the roof of the first actor."""
    sensors = []
    for number in range(job.sensors):
        angle, out = number * 2.4, 0.0 if number == 0 else 14.0
        place: dict[str, float] = {
            "east_m": round(out * np.cos(angle), 3),
            "north_m": round(out * np.sin(angle), 3),
            "height_m": 5.0,
        }
        if job.rides:
            place = {"forward_m": 0.0, "left_m": 0.0, "height_m": 2.5}
        one = {"name": f"s{number}", "model": "OS1-128", "columns": COLUMNS}
        sensors.append({**one, **place, "effects": job.effects})
    spec: dict = {"rate_hz": RATE_HZ, "sensors": sensors}
    if job.rides:
        spec["ride"] = {"track": 1}
    return place_rig(RigSpec.model_validate(spec), mesh)


def sensor_poses(job: Job, rig: Rig, actors: list[PosedActor]) -> list[Pose]:
    if job.rides:
        return [actors[0].site_SE3_asset @ Pose(np.eye(3), np.array([0.0, 0.0, 2.5]))]
    return [one.site_SE3_sensor for one in rig.sensors]


def rays_that_can_touch(job: Job, rig: Rig, actors: list[PosedActor]) -> int:
    """Rays within the angles of the corners of each actor's box, all actors and sensors."""
    corners = np.array(list(itertools.product((-0.5, 0.5), (-0.5, 0.5), (0.0, 1.0))))
    total = 0
    for mounted, pose in zip(rig.sensors, sensor_poses(job, rig, actors), strict=True):
        rings = mounted.sensor.elevation_deg
        for actor in actors[1:] if job.rides else actors:
            one = asset(actor.asset)
            box = actor.site_SE3_asset.apply(corners * [one.length, one.width, one.height])
            x, y, z = pose.inverse().apply(box).T
            up = np.degrees(np.arctan2(z, np.hypot(x, y)))
            middle = np.arctan2(y.mean(), x.mean())
            across = np.angle(np.exp(1j * (np.arctan2(y, x) - middle)))
            columns = min(1.0, np.ptp(across) / (2 * np.pi)) * mounted.columns
            if np.hypot(x.mean(), y.mean()) < mounted.sensor.assumed_range_max_m:
                total += int(((rings > up.min()) & (rings < up.max())).sum() * columns)
    return total


def own_memory_mb() -> int:
    """This process's part of what it has in memory: pages of several count in equal shares."""
    for line in Path("/proc/self/smaps_rollup").read_text(encoding="utf-8").splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) // 1024
    return 0


def ours(job: Job) -> dict:
    """Frames per second of `Scanner`, all workers together: forks of a process that is ready."""
    mesh = static_world()
    rig = rig_of(job, mesh)
    began = time.perf_counter()
    scanner = Scanner(mesh, rig, seed=0)
    ready_s = time.perf_counter() - began
    turns = moments(job.actors)
    touching = float(np.mean([rays_that_can_touch(job, rig, turn) for turn in turns[::8]]))
    points = [len(scanner.scan(k, turn).points) for k, turn in enumerate(turns)]  # and warm up
    fork = get_context("fork")
    results = fork.SimpleQueue()
    gate = fork.Barrier(job.workers + 1)

    def work(number: int) -> None:
        gate.wait()
        used = time.process_time()
        until, done = time.perf_counter() + job.seconds, 0
        while time.perf_counter() < until:
            index = number + job.workers * done
            scanner.scan(index, turns[index % MOMENTS])
            done += 1
        used = time.process_time() - used
        gate.wait()  # all are there while each says what part of the shared pages is its own
        results.put((done, own_memory_mb(), used))
        gate.wait()

    workers = [fork.Process(target=work, args=(n,)) for n in range(job.workers)]
    for one in workers:
        one.start()
    gate.wait()
    began = time.perf_counter()
    gate.wait()
    took = time.perf_counter() - began
    parts = [results.get() for _ in workers]
    done = sum(part[0] for part in parts)
    memory_mb = own_memory_mb() + sum(part[1] for part in parts)
    gate.wait()
    for one in workers:
        one.join()
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return {
        **asdict(job),
        "frames": done,
        "frames_per_s": round(done / took, 2),
        "cpu_ms_per_frame": round(1000 * sum(part[2] for part in parts) / done, 2),
        "points_per_frame": int(np.mean(points)),
        "rays_that_can_touch": int(touching),
        "ready_s": round(ready_s, 2),
        "peak_memory_mb": max(peak_mb, memory_mb),
    }


def open3d(job: Job) -> dict:
    """Frames per second when everything is rebuilt and recast."""
    import open3d as o3d

    mesh = static_world()
    rig = rig_of(job, mesh)
    turns = moments(job.actors)
    vertices = o3d.core.Tensor(mesh.vertices.astype(np.float32))
    faces = o3d.core.Tensor(mesh.faces.astype(np.uint32))
    beams = [beam_directions(one.sensor, one.columns).reshape(-1, 3) for one in rig.sensors]
    meshes = {
        (one.asset, one.phase): (mesh_of.vertices, mesh_of.faces.astype(np.uint32))
        for turn in turns
        for one in turn
        for mesh_of in [asset_mesh(one.asset, one.phase)]
    }

    def rays_of(turn: list[PosedActor]) -> object:
        poses = sensor_poses(job, rig, turn)
        rays = [
            np.hstack([np.broadcast_to(pose.translation, aim.shape), aim @ pose.rotation.T])
            for pose, aim in zip(poses, beams, strict=True)
        ]
        return o3d.core.Tensor(np.vstack(rays).astype(np.float32))

    rays = rays_of(turns[0])

    def frame(number: int) -> None:
        turn = turns[number % MOMENTS]
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(vertices, faces)
        for actor in turn[1:] if job.rides else turn:
            own, own_faces = meshes[actor.asset, actor.phase]
            placed = actor.site_SE3_asset.apply(own).astype(np.float32)
            scene.add_triangles(o3d.core.Tensor(placed), o3d.core.Tensor(own_faces))
        scene.cast_rays(rays_of(turn) if job.rides else rays)

    frame(0)
    began, used, done = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() < began + job.seconds:
        frame(done)
        done += 1
    took = time.perf_counter() - began
    return {
        **asdict(job),
        "frames": done,
        "frames_per_s": round(done / took, 3),
        "cpu_ms_per_frame": round(1000 * (time.process_time() - used) / done, 1),
    }


def alone(function: Callable[[Job], dict], job: Job) -> dict:
    """Run in a process that nothing else runs in."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(function, job).result()


def table(job: Job) -> dict:
    """Fixed rig with effects off and on, a rig that rides, and Open3D before and after."""
    # Of what else the machine does, which slows every line: below 0.2 it is idle.
    load = round(os.getloadavg()[0], 2)
    off = replace(job, effects=False)
    rides = replace(job, rides=True)
    before = alone(open3d, job)
    found = {
        "effects_off": alone(ours, off),
        "effects_on": alone(ours, job),
        "riding_effects_off": alone(ours, replace(rides, effects=False)),
        "riding_effects_on": alone(ours, rides),
    }
    after, riding = alone(open3d, job), alone(open3d, rides)
    recast = max(before["frames_per_s"], after["frames_per_s"])
    recast_ms = min(before["cpu_ms_per_frame"], after["cpu_ms_per_frame"])
    moving = riding["frames_per_s"]
    return {
        "load_before": load,
        **found,
        "open3d_frames_per_s": recast,
        "open3d_riding_frames_per_s": moving,
        "open3d_cpu_ms_per_frame": recast_ms,
        "open3d_riding_cpu_ms_per_frame": riding["cpu_ms_per_frame"],
        "cpu_ratio_effects_off": round(recast_ms / found["effects_off"]["cpu_ms_per_frame"], 1),
        "cpu_ratio_effects_on": round(recast_ms / found["effects_on"]["cpu_ms_per_frame"], 1),
        "ratio_effects_off": round(found["effects_off"]["frames_per_s"] / recast, 1),
        "ratio_effects_on": round(found["effects_on"]["frames_per_s"] / recast, 1),
        "ratio_riding_effects_off": round(found["riding_effects_off"]["frames_per_s"] / moving, 2),
        "ratio_riding_effects_on": round(found["riding_effects_on"]["frames_per_s"] / moving, 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--actors", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2, help="processes that scan")
    parser.add_argument("--seconds", type=float, default=6.0, help="how long each line is timed")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    job = Job(actors=given.actors, workers=given.workers, seconds=given.seconds)
    result = table(job)
    if given.json:
        print(json.dumps(result, indent=2))
        return
    for key, value in result.items():
        if isinstance(value, dict):
            print(
                f"{key}: {value['frames_per_s']} frames/s, {value['cpu_ms_per_frame']} ms of "
                f"processor time each, {value['points_per_frame']} points, "
                f"{value['rays_that_can_touch']} rays that can touch an actor, "
                f"{value['peak_memory_mb']} MB"
            )
        else:
            print(f"{key}: {value}")


if __name__ == "__main__":
    main()
