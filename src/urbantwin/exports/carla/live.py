"""Drive this package's traffic on a running CARLA 0.9.16 server, and record it with its rig.

    python run_in_carla.py FRAMES [--host localhost] [--port 2000] [--seconds 10]

FRAMES gets ``points/NNNNNN_<sensor>.npy`` (the sensor's points, x, y, z in the site frame, metres)
and ``actors/NNNNNN.json`` (boxes in the site frame) for each step of the rig. It needs numpy and
CARLA's Python package (``pip install carla==0.9.16``), but not UrbanTwin. This file is included in
exported CARLA packages.

Transforms, attributes and points were checked against CARLA's own classes. **Nothing here was run
on a live server**; the sequence of calls follows CARLA's documentation and examples.
"""

from __future__ import annotations

import argparse
import fnmatch
import importlib
import json
import queue
import random
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["SEMANTIC_POINT", "LiveError", "chosen_blueprints", "drive", "site_points"]

SEMANTIC = "sensor.lidar.ray_cast_semantic"
#: Point formats of ``sensor.lidar.ray_cast_semantic`` and of ``sensor.lidar.ray_cast``.
SEMANTIC_POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("cos", "<f4"), ("actor", "<u4"), ("tag", "<u4")]
)
PLAIN_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
#: Longest wait for a server to load a map or to answer a step, seconds.
SLOW_S = 120.0
#: From CARLA's left-handed frame (y south) to the site frame (y north), and back.
MIRROR = np.array([1.0, -1.0, 1.0])


class LiveError(Exception):
    """The package, CARLA's Python package or the server cannot be used; one line."""


def drive(
    package: Path,
    out: Path,
    *,
    host: str = "localhost",
    port: int = 2000,
    seconds: float = 10.0,
) -> dict[str, Any]:
    """Spawn traffic and sensors on a server, run it step by step, and write frames.

    Args:
        package: folder of the package.
        out: folder to write, which must not exist.
        host: name of the server.
        port: port of the server.
        seconds: simulated time, seconds.

    Returns:
        Counts of spawned actors and written files.

    Raises:
        LiveError: not a package, CARLA's Python package is missing, ``out`` exists, no server
            answers, or the server failed.
    """
    plan = _read_plan(package)
    try:
        carla = importlib.import_module("carla")
    except ImportError as error:
        raise LiveError("CARLA's Python package is missing: pip install carla==0.9.16") from error
    if out.exists():
        raise LiveError(f"{out} exists; expected a new folder")
    client = carla.Client(host, port)
    client.set_timeout(10.0)
    try:
        version = client.get_server_version()
    except RuntimeError as error:
        said = str(error).splitlines()[0] if str(error) else "no answer"
        raise LiveError(f"no CARLA server at {host}:{port} ({said})") from None
    try:
        with ExitStack() as stack:
            client.set_timeout(SLOW_S)
            imported = _load_map(client, package, plan)
            world = client.get_world()
            stack.enter_context(_in_steps(carla, client, world, plan))
            actors = _Actors(carla, client, world)
            stack.callback(actors.destroy)
            counts = actors.set_down(plan)
            queues = actors.listen(plan["rig"])
            step_s = float(plan["rig"]["fixed_delta_seconds"])
            steps = max(1, round(seconds / step_s))
            (out / "points").mkdir(parents=True)
            (out / "actors").mkdir()
            for step in range(steps):
                _write_frame(out, step, world, queues)
            record = {
                "kind": "carla_frames",
                "server": version,
                "map": plan["traffic"]["map"],
                "map_imported": imported,
                "frames": steps,
                "step_s": step_s,
                "actors": counts,
            }
            _write_json(out / "carla_frames.json", record)
            return record
    except RuntimeError as error:  # raised by CARLA's client
        raise LiveError(f"the CARLA server failed ({str(error).splitlines()[0]})") from error


def _read_plan(package: Path) -> dict[str, Any]:
    """Return the package's traffic, spawn points, rig and names."""
    plan = {}
    for name in ("traffic", "spawn_points", "rig", "carla"):
        file = package / f"{name}.json"
        try:
            plan[name] = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise LiveError(f"{file} cannot be read ({error}); expected a package") from error
    return plan


def _write_json(file: Path, value: object) -> None:
    file.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


def _load_map(client: Any, package: Path, plan: Mapping[str, Any]) -> bool:  # noqa: ANN401
    """Load the imported map, or else CARLA's map generated from OpenDRIVE; return which."""
    name, folder = plan["carla"]["map"], plan["carla"]["package"]
    if any(one.rsplit("/", 1)[-1] == name for one in client.get_available_maps()):
        client.load_world(name)
        return True
    roads = package / folder / name / f"{name}.xodr"
    client.generate_opendrive_world(roads.read_text(encoding="utf-8"))
    return False


@contextmanager
def _in_steps(
    carla: Any,  # noqa: ANN401
    client: Any,  # noqa: ANN401
    world: Any,  # noqa: ANN401
    plan: Mapping[str, Any],
) -> Iterator[None]:
    """Run the server in synchronous mode during the block, and restore its settings."""
    before, manager = world.get_settings(), client.get_trafficmanager()
    settings = world.get_settings()
    settings.synchronous_mode = True
    settings.fixed_delta_seconds = float(plan["rig"]["fixed_delta_seconds"])
    world.apply_settings(settings)
    manager.set_synchronous_mode(True)
    manager.set_random_device_seed(int(plan["traffic"]["seed"]))
    world.set_pedestrians_seed(int(plan["traffic"]["seed"]))
    try:
        yield
    finally:
        manager.set_synchronous_mode(False)
        world.apply_settings(before)


class _Actors:
    """Spawned actors and sensors, which are destroyed at the end."""

    def __init__(self, carla: Any, client: Any, world: Any) -> None:  # noqa: ANN401
        self.carla, self.client, self.world = carla, client, world
        self.made: list[Any] = []

    def set_down(self, plan: Mapping[str, Any]) -> dict[str, int]:
        """Spawn traffic; return the number of spawned actors of each class."""
        traffic, points = plan["traffic"], list(plan["spawn_points"]["spawn_points"])
        chance = random.Random(int(traffic["seed"]))
        chance.shuffle(points)
        library = self.world.get_blueprint_library()
        counts: dict[str, int] = {}
        for name, asked in traffic["classes"].items():
            blueprints = [library.find(one) for one in chosen_blueprints(library, asked)]
            for _ in range(int(asked["population"]) if blueprints else 0):
                blueprint = chance.choice(blueprints)
                if name == "pedestrian":
                    done = self._walker(blueprint, float(asked["speed_ms"]))
                else:
                    done = self._vehicle(blueprint, name, points, asked)
                counts[name] = counts.get(name, 0) + int(done)
        self.world.tick()
        return counts

    def _vehicle(
        self,
        blueprint: Any,  # noqa: ANN401
        name: str,
        points: list[dict[str, Any]],
        asked: Mapping[str, Any],
    ) -> bool:
        """Spawn a vehicle at the next free point allowed for its class."""
        for number, point in enumerate(points):
            if name not in point["allowed"]:
                continue
            actor = self.world.try_spawn_actor(blueprint, self._transform(point))
            if actor is None:
                continue
            points.pop(number)
            self.made.append(actor)
            manager = self.client.get_trafficmanager()
            actor.set_autopilot(True, manager.get_port())
            if "speed_ms" in asked:
                manager.set_desired_speed(actor, 3.6 * float(asked["speed_ms"]))
            else:
                slower = float(asked["tm_speed_difference_percent"])
                manager.vehicle_percentage_speed_difference(actor, slower)
            return True
        return False

    def _walker(self, blueprint: Any, speed_ms: float) -> bool:  # noqa: ANN401
        place = self.world.get_random_location_from_navigation()
        if place is None:  # the map has no navigation for pedestrians
            return False
        walker = self.world.try_spawn_actor(blueprint, self.carla.Transform(place))
        if walker is None:
            return False
        self.made.append(walker)
        kind = self.world.get_blueprint_library().find("controller.ai.walker")
        control = self.world.spawn_actor(kind, self.carla.Transform(), walker)
        self.made.append(control)
        self.world.tick()
        control.start()
        control.go_to_location(self.world.get_random_location_from_navigation())
        control.set_max_speed(speed_ms)
        return True

    def listen(self, rig: Mapping[str, Any]) -> dict[str, tuple[queue.Queue[Any], str]]:
        """Set up the sensors; return their data queues and blueprints, by name."""
        found = {}
        for one in rig["sensors"]:
            blueprint = self.world.get_blueprint_library().find(one["blueprint"])
            for name, value in one["attributes"].items():
                blueprint.set_attribute(name, value)
            sensor = self.world.spawn_actor(blueprint, self._transform(one["transform"]))
            self.made.append(sensor)
            arrived: queue.Queue[Any] = queue.Queue()
            sensor.listen(arrived.put)
            found[one["name"]] = (arrived, one["blueprint"])
        return found

    def destroy(self) -> None:
        """Destroy everything, in reverse order."""
        for actor in reversed(self.made):
            if hasattr(actor, "stop"):
                actor.stop()
            actor.destroy()

    def _transform(self, entry: Mapping[str, Any]) -> Any:  # noqa: ANN401
        return self.carla.Transform(
            self.carla.Location(**entry["location"]), self.carla.Rotation(**entry["rotation"])
        )


def chosen_blueprints(
    library: Any,  # noqa: ANN401
    asked: Mapping[str, Any],
) -> list[str]:
    """Return the sorted ids of the blueprints requested in ``traffic.json``."""
    wanted = asked["blueprints"]
    found = []
    for one in library.filter(wanted["filter"]):
        kind = one.get_attribute("base_type").as_str() if one.has_attribute("base_type") else ""
        if wanted["base_type"] and kind not in wanted["base_type"]:
            continue
        if not any(fnmatch.fnmatch(one.id, pattern) for pattern in wanted["except"]):
            found.append(one.id)
    return sorted(found)


def _write_frame(
    folder: Path,
    step: int,
    world: Any,  # noqa: ANN401
    queues: Mapping[str, tuple[queue.Queue[Any], str]],
) -> None:
    """Advance one step, and write the sensors' points and the actors' boxes."""
    frame = world.tick()
    for name, (arrived, blueprint) in queues.items():
        data = arrived.get(timeout=SLOW_S)
        while data.frame < frame:
            data = arrived.get(timeout=SLOW_S)
        kind = SEMANTIC_POINT if blueprint == SEMANTIC else PLAIN_POINT
        points = np.frombuffer(bytes(data.raw_data), kind).copy()
        place, turn = data.transform.location, data.transform.rotation
        points = site_points(points, (place.x, place.y, place.z), (turn.pitch, turn.yaw, turn.roll))
        np.save(folder / "points" / f"{step:06d}_{name}.npy", points)
    rows = []
    for actor in world.get_actors():
        if not actor.type_id.startswith(("vehicle.", "walker.")):
            continue
        transform, box, velocity = actor.get_transform(), actor.bounding_box, actor.get_velocity()
        centre = transform.transform(box.location)
        rows.append(
            {
                "id": actor.id,
                "blueprint": actor.type_id,
                "centre": (np.array([centre.x, centre.y, centre.z]) * MIRROR).round(4).tolist(),
                "size": [2 * box.extent.x, 2 * box.extent.y, 2 * box.extent.z],
                "yaw": -float(np.radians(transform.rotation.yaw)),
                "velocity": (np.array([velocity.x, velocity.y, velocity.z]) * MIRROR).tolist(),
            }
        )
    _write_json(folder / "actors" / f"{step:06d}.json", {"frame": frame, "actors": rows})


def site_points(
    points: NDArray[np.void], location: Sequence[float], rotation: Sequence[float]
) -> NDArray[np.void]:
    """Return a sensor's points with x, y, z in the site frame, metres.

    Args:
        points: (N,) with fields x, y, z in the sensor's left-handed frame (y to the right).
        location: x, y, z of the sensor in CARLA's frame, metres.
        rotation: pitch, yaw, roll of the sensor, degrees.
    """
    xyz = np.column_stack([points["x"], points["y"], points["z"]]).astype(np.float64) * MIRROR
    pitch, yaw, roll = np.radians(np.asarray(rotation, np.float64)) * [-1.0, -1.0, 1.0]
    sines, cosines = np.sin([yaw, pitch, roll]), np.cos([yaw, pitch, roll])
    about_z = np.array([[cosines[0], -sines[0], 0], [sines[0], cosines[0], 0], [0, 0, 1]])
    about_y = np.array([[cosines[1], 0, sines[1]], [0, 1, 0], [-sines[1], 0, cosines[1]]])
    about_x = np.array([[1, 0, 0], [0, cosines[2], -sines[2]], [0, sines[2], cosines[2]]])
    turned = xyz @ (about_z @ about_y @ about_x).T + np.asarray(location) * MIRROR
    moved = points.copy()
    moved["x"], moved["y"], moved["z"] = turned.T
    return moved


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, metavar="FRAMES", help="folder to write")
    parser.add_argument("--host", default="localhost", help="name of the server")
    parser.add_argument("--port", type=int, default=2000, help="port of the server")
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time, seconds")
    given = parser.parse_args()
    try:
        made = drive(Path(__file__).parent, given.out, host=given.host, port=given.port,
                     seconds=given.seconds)  # fmt: skip
    except LiveError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(json.dumps(made, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
