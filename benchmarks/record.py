"""Frames per second of `record` against a full recast of the same frames by Open3D.

An OS1-128 at 2048 columns over a static world of about 480,000 triangles with 50 actors in range.
`record` is timed whole: starting its workers, casting, returns, labels, files and tables. Open3D
is timed for what people write without us: all triangles, static and moving, put into a new
`RaycastingScene` and all rays cast, each frame, with every processor; no labels, no files.
Both by the clock and by processor time, which other work on the machine moves less.

    python benchmarks/record.py --frames 600 --workers 2
    python benchmarks/record.py --frames 600 --efficiency
    python benchmarks/record.py --frames 10000 --memory

With ``--efficiency`` the same frames are recorded by one worker, too, which writes a frame beside
the next scan and so is busy on more than one processor, and by one worker that is held to one; what
is lost is what the workers do anew, and what one process does for all. With ``--memory`` a VLP-16
records instead, and what all processes hold together (their proportional set sizes) is told as
frames go by.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

import urbantwin
from urbantwin.artefact import sha256_of, write_json
from urbantwin.dataset import record
from urbantwin.dataset.motion_interpolation import posed_actors, rows_at
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Rig, beam_directions, place_rig
from urbantwin.site.rig import RigSpec, SensorSpec
from urbantwin.taxonomy import ACTOR_CLASSES, material_id, semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset, asset_mesh, asset_names
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA
from urbantwin.twin import Twin, load_twin

#: As far as an OS1 sees a car, and two thirds of the way to the border of the world below.
REACH_M = 100.0
HALF_M = 150.0
RATE_HZ = 10.0
GRID = 480


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The ground: a gentle slope with a hump."""
    return 0.02 * x + 0.5 * np.sin(y / 40)


def static_world() -> LabelledMesh:
    """A finely triangulated ground of 300 x 300 m with blocks of houses and poles along it."""
    axis = np.linspace(-HALF_M, HALF_M, GRID + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
    corner = (np.arange(GRID)[:, None] * (GRID + 1) + np.arange(GRID)).ravel()
    right, up = corner + GRID + 1, corner + 1
    faces = np.vstack(
        [np.column_stack([corner, right, up]), np.column_stack([right, right + 1, up])]
    )
    street = (np.abs(x) < 12) | (np.abs(y) < 12)
    semantic = np.where(street[faces].all(axis=1), semantic_id("road"), semantic_id("terrain"))
    material = np.where(
        semantic == semantic_id("road"), material_id("asphalt"), material_id("grass")
    )
    ground = LabelledMesh.build(np.column_stack([x, y, height(x, y)]), faces, semantic, material)

    solids = [ground]
    places = [-130, -105, -80, -55, -30, 30, 55, 80, 105, 130]
    for part, (east, north) in enumerate(((e, n) for e in places for n in places), start=1):
        tall = 8.0 + (part * 7) % 23
        solids.append(block(east, north, 9.0, tall, "building", "plaster", part, rings=10))
    for part, along in enumerate(np.arange(-140, 141, 10.0), start=200):
        for east, north in ((along, 13.0), (13.0, along)):
            solids.append(block(east, north, 0.1, 8.0, "pole", "metal-painted", part, rings=6))
    return LabelledMesh.concatenate(solids)


def block(
    east: float,
    north: float,
    half: float,
    tall: float,
    kind: str,
    made_of: str,
    part: int,
    rings: int,
) -> LabelledMesh:
    """A prism of 16 sides, its walls in rings of triangles."""
    turn = 2 * np.pi * np.arange(16) / 16
    base = float(height(np.array(east), np.array(north))) - 1.0
    levels = np.linspace(base, base + tall, rings + 1)
    walls = np.array(
        [[east + half * np.cos(a), north + half * np.sin(a), z] for z in levels for a in turn]
    )
    side = np.arange(16)
    faces = []
    for ring in range(rings):
        low, nxt = ring * 16 + side, ring * 16 + (side + 1) % 16
        faces += [np.column_stack([low, nxt, low + 16]), np.column_stack([nxt, nxt + 16, low + 16])]
    top = rings * 16
    roof = np.column_stack([np.full(14, top), top + side[1:-1], top + side[2:]])
    return LabelledMesh.build(
        walls, np.vstack([*faces, roof]), semantic_id(kind), material_id(made_of), part
    )


def twin_of(mesh: LabelledMesh, folder: Path) -> Twin:
    """A twin folder with what recording reads."""
    folder.mkdir()
    mesh.save(folder / "scene.npz")
    manifest = {
        "kind": "twin",
        "version": urbantwin.__version__,
        "name": "benchmark",
        "driving_side": "right",
        "notes": {},
        "anchor": {"latitude": 0.0, "longitude": 0.0},
        "region_m": [[-HALF_M, -HALF_M], [HALF_M, -HALF_M], [HALF_M, HALF_M], [-HALF_M, HALF_M]],
        "inputs": [],
        "files": {"scene.npz": sha256_of(folder / "scene.npz")},
    }
    write_json(folder / "twin.json", manifest)
    return load_twin(folder)


def circling_motion(twin: Twin, count: int, frames: int) -> Motion:
    """Actors of every class that drive round the sensor in rings, all of them in range."""
    number = np.arange(count)
    classes = [name for name in ACTOR_CLASSES if asset_names(name)]
    # Three fifths are cars, as on a street.
    kinds = [classes[0] if n % 5 < 3 else classes[n // 5 % len(classes)] for n in range(count)]
    actors = [asset(asset_names(kind)[n % len(asset_names(kind))]) for n, kind in enumerate(kinds)]
    # As many on every square metre of the ring from 8 m to the reach.
    radius = np.sqrt(8.0**2 + (REACH_M**2 - 8.0**2) * number / count)
    speed = 8.0
    steps = []
    for frame in range(frames):
        angle = 2.4 * number + speed * frame / RATE_HZ / radius
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        level = np.zeros(count)
        columns = {
            "time_s": np.full(count, round(frame / RATE_HZ, 9)),
            "track": number + 1,
            "class": kinds,
            "asset": [one.name for one in actors],
            "phase": [frame % one.phases for one in actors],
            "x": x,
            "y": y,
            "z": height(x, y),
            "yaw": angle + np.pi / 2,
            "pitch": level,
            "roll": level,
            "length": [one.length for one in actors],
            "width": [one.width for one in actors],
            "height": [one.height for one in actors],
            "speed": np.full(count, speed),
            "lane": [""] * count,
        }
        steps.append(pa.Table.from_pydict(columns, schema=ACTOR_SCHEMA))
    manifest = {
        "seed": 0,
        "steps": frames,
        "step_s": 1 / RATE_HZ,
        "twin_sha256": twin.sha256,
    }
    actors = pa.concat_tables(steps).combine_chunks()
    return Motion(manifest, actors, SIGNAL_SCHEMA.empty_table()).with_meshes()


def touch_memory(folder: Path, size: int) -> None:
    """Write and delete as much as will be recorded.

    A virtual machine gets its memory from its host page by page when it first touches it, ten
    times as slowly as it is used from then on. Neither side should pay for that.
    """
    path = folder / "ballast"
    with path.open("wb") as stream:
        for _ in range(max(1, size >> 24)):
            stream.write(bytes(1 << 24))
    path.unlink()


class Cost:
    """What something takes: seconds by the clock, and of processors."""

    clock_s = 0.0
    processor_s = 0.0


@contextmanager
def costing() -> Iterator[Cost]:
    """Yield what the block takes, here and in processes that have ended by its end."""
    cost, began, before = Cost(), time.perf_counter(), _processor_s()
    yield cost
    cost.clock_s, cost.processor_s = time.perf_counter() - began, _processor_s() - before


def _processor_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


class Memory:
    """What this process and its workers hold as frames go by; a `Progress`.

    Args:
        frames: that will be recorded.
    """

    def __init__(self, frames: int) -> None:
        self._frames, self._next = frames, 0.0
        #: MB by what has been done.
        self.held: dict[str, int] = {}

    def __call__(self, share: float, doing: str) -> None:
        """Look, ten times while frames are recorded and once at every other step."""
        number = doing.split()[1] if doing.startswith("frame ") else ""
        if number:
            if int(number) < self._next:
                return
            self._next = int(number) + self._frames / 10
        pids = [os.getpid(), *(one.pid for one in active_children())]
        sizes = [_proportional_kb(Path(f"/proc/{pid}/smaps_rollup")) for pid in pids]
        self.held[f"after frame {number}" if number else doing] = sum(sizes) // 1000


def _proportional_kb(file: Path) -> int:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError:  # it has ended
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


def time_open3d(twin: Twin, motion: Motion, rig: Rig, frames: list[int]) -> Cost:
    """Return what frames cost when everything is rebuilt and recast."""
    import open3d as o3d

    mounted = rig.sensors[0]
    pose: Pose = mounted.site_SE3_sensor
    beams = beam_directions(mounted.sensor, mounted.columns).reshape(-1, 3) @ pose.rotation.T
    origins = np.broadcast_to(pose.translation, beams.shape)
    rays = o3d.core.Tensor(np.hstack([origins, beams]).astype(np.float32))
    static_vertices = o3d.core.Tensor(twin.mesh.vertices.astype(np.float32))
    static_faces = o3d.core.Tensor(twin.mesh.faces.astype(np.uint32))
    for index in frames:  # made before the clock starts
        for actor in posed_actors(rows_at(motion, index / RATE_HZ)):
            asset_mesh(actor.asset, actor.phase)

    with costing() as cost:
        for index in frames:
            scene = o3d.t.geometry.RaycastingScene()
            scene.add_triangles(static_vertices, static_faces)
            for actor in posed_actors(rows_at(motion, index / RATE_HZ)):
                mesh = asset_mesh(actor.asset, actor.phase)
                vertices = actor.site_SE3_asset.apply(mesh.vertices).astype(np.float32)
                scene.add_triangles(
                    o3d.core.Tensor(vertices), o3d.core.Tensor(mesh.faces.astype(np.uint32))
                )
            scene.cast_rays(rays)
    return cost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--frames", type=int, default=600, help="frames that are recorded: a minute"
    )
    parser.add_argument("--recast", type=int, default=20, help="of them, how many Open3D recasts")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--actors", type=int, default=50)
    parser.add_argument("--efficiency", action="store_true", help="record with one worker, too")
    parser.add_argument("--memory", action="store_true", help="of a long recording by a VLP-16")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        twin = twin_of(static_world(), folder / "twin")
        motion = circling_motion(twin, given.actors, given.frames)
        result = (memory if given.memory else speed)(twin, motion, folder, given)
    if given.json:
        print(json.dumps(result, indent=2))
    else:
        print("\n".join(f"{key}: {value}" for key, value in result.items()))


@contextmanager
def on_one_processor() -> Iterator[None]:
    """Hold every thread of this process to one of the processors that it may use."""
    before = os.sched_getaffinity(0)
    _hold(set(sorted(before)[:1]))
    try:
        yield
    finally:
        _hold(before)


def _hold(processors: set[int]) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with suppress(ProcessLookupError):  # it has ended
            os.sched_setaffinity(int(thread.name), processors)


def rig_of(twin: Twin, **options: Any) -> Rig:
    """Return a sensor in the middle of the world."""
    spec = SensorSpec(name="eye", east_m=0.0, north_m=0.0, height_m=5.0, **options)
    return place_rig(RigSpec(rate_hz=RATE_HZ, sensors=[spec]), twin.mesh)


def speed(twin: Twin, motion: Motion, folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Return what frames cost, and Open3D's."""
    rig, frames = rig_of(twin, model="OS1-128", columns=2048), given.frames
    touch_memory(folder, frames * 5_000_000)
    with costing() as ours:
        record(twin, motion, rig, folder / "dataset", workers=given.workers, seed=1)
    counts = json.loads((folder / "dataset" / "dataset.json").read_text())["counts"]
    few = np.linspace(0, frames - 1, min(given.recast, frames)).astype(int).tolist()
    theirs = time_open3d(twin, motion, rig, few)
    result = {
        "static_triangles": len(twin.mesh.faces),
        "actors": given.actors,
        "rays": 128 * 2048,
        "frames": frames,
        "workers": given.workers,
        "points_per_frame": counts["points"] // counts["frames"],
        "boxes_with_points_per_frame": sum(counts["boxes_with_points"].values()) / counts["frames"],
        "record_frames_per_s": round(frames / ours.clock_s, 2),
        "open3d_frames_per_s": round(len(few) / theirs.clock_s, 2),
        "ratio": round(theirs.clock_s / len(few) / ours.clock_s * frames, 1),
        "record_processor_ms_per_frame": round(1e3 * ours.processor_s / frames, 1),
        "open3d_processor_ms_per_frame": round(1e3 * theirs.processor_s / len(few), 1),
    }
    if given.efficiency:
        shutil.rmtree(folder / "dataset")
        with costing() as alone:
            record(twin, motion, rig, folder / "dataset", workers=1, seed=1)
        shutil.rmtree(folder / "dataset")
        with on_one_processor(), costing() as held:
            record(twin, motion, rig, folder / "dataset", workers=1, seed=1)
        result |= {
            "one_worker_frames_per_s": round(frames / alone.clock_s, 2),
            "one_worker_processor_ms_per_frame": round(1e3 * alone.processor_s / frames, 1),
            "one_processor_frames_per_s": round(frames / held.clock_s, 2),
            "efficiency": round(alone.clock_s / ours.clock_s / given.workers, 3),
            "efficiency_of_one_processor_each": round(
                held.clock_s / ours.clock_s / given.workers, 3
            ),
            "efficiency_by_processor_time": round(alone.processor_s / ours.processor_s, 3),
        }
    return result


def memory(twin: Twin, motion: Motion, folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Return what all processes hold together, MB, in the course of a recording."""
    looks = Memory(given.frames)
    rig = rig_of(twin, model="VLP-16")
    record(twin, motion, rig, folder / "dataset", workers=given.workers, seed=1, progress=looks)
    return {"frames": given.frames, "actors": given.actors, **looks.held}


if __name__ == "__main__":
    main()
