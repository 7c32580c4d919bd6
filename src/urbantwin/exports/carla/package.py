"""CARLA package: map mesh, OpenDRIVE, spawn points, traffic, rig, and import instructions."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.drawing.markings import markings
from urbantwin.exports.carla import live
from urbantwin.exports.carla.frame import carla_transform
from urbantwin.exports.carla.meshes import named_objects, navigation_objects
from urbantwin.exports.carla.names import OBJECTS, folder_of, map_name
from urbantwin.exports.carla.rig import carla_rig
from urbantwin.exports.mesh import Look, write_fbx, write_obj
from urbantwin.geometry import Pose, stations_of_points
from urbantwin.lidar.placement import place_rig
from urbantwin.pages import text_file
from urbantwin.roads import RoadNetwork
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.site_demand import demand_of
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS
from urbantwin.twin import Twin

__all__ = ["spawn_points", "write_carla"]


#: Blueprints of CARLA 0.9.16 by class of actors: a pattern of ``BlueprintLibrary.filter``, the
#: value of the attribute ``base_type``, and exceptions that belong to another class or are rare in
#: streets (https://carla.readthedocs.io/en/0.9.16/catalogue_vehicles/).
BLUEPRINTS: dict[str, dict[str, Any]] = {
    "car": {
        "filter": "vehicle.*",
        "base_type": ["car"],
        "except": ["vehicle.*police*", "vehicle.ford.ambulance", "vehicle.micro.microlino"],
    },
    "van": {
        "filter": "vehicle.*",
        "base_type": ["van"],
        "except": ["vehicle.ford.ambulance"],
    },
    "truck": {
        "filter": "vehicle.*",
        "base_type": ["truck"],
        "except": ["vehicle.carlamotors.firetruck", "vehicle.tesla.cybertruck"],
    },
    "bus": {"filter": "vehicle.*", "base_type": ["bus"], "except": []},
    "motorcycle": {"filter": "vehicle.*", "base_type": ["motorcycle"], "except": []},
    "bicycle": {"filter": "vehicle.*", "base_type": ["bicycle"], "except": []},
    "pedestrian": {"filter": "walker.pedestrian.*", "base_type": [], "except": []},
    "tram": {"filter": "", "base_type": [], "except": []},  # CARLA has none
    "trailer": {"filter": "", "base_type": [], "except": []},
    "animal": {"filter": "", "base_type": [], "except": []},
}
_NORMC = re.compile(r"normc\(([-\d.,\s]+)\)")


def carla_traffic(twin: Twin, scratch: Path | None = None) -> dict[str, Any]:
    """Return a traffic mix equivalent to the twin's, for a CARLA client.

    ``per_hour`` is the site's requested flow. ``population`` is the number of actors of a class
    present at a time: in a closed loop the circulating ones, elsewhere flow times the mean
    free-flow travel time of the planned routes (Little's law; ``mean_travel_s`` is that time, in a
    loop the time of a lap). ``speed_factor`` is that of SUMO's vehicle types: mean, deviation,
    least and greatest fraction of the speed limit, from which CARLA's Traffic Manager takes the
    difference in percent. Pedestrians and cyclists have the desired speed ``speed_ms`` instead,
    m/s.

    Args:
        twin: the twin.
        scratch: folder for SUMO's files; the system's temporary folder if not given.
    """
    asked = twin.site["traffic"]
    per_hour: Mapping[str, float] = asked["per_hour"]
    seed = int(asked["seed"])
    demand = demand_of(twin, duration_s=float(asked["duration_s"]), seed=seed, metered=False)
    if demand.circulates:
        present = Counter(trip.actor_class for trip in demand.trips)
        seconds = {
            name: 3600.0 * count / max(float(per_hour[name]), 1e-9)
            for name, count in present.items()
        }
    else:
        seconds = _mean_seconds(demand, _edge_seconds(twin))
        present = Counter(
            {name: max(1, round(per_hour[name] * t / 3600.0)) for name, t in seconds.items()}
        )
    classes = {}
    for name in ACTOR_CLASSES:
        flow = float(per_hour.get(name, 0.0))
        if flow <= 0.0 or name not in seconds:
            continue
        classes[name] = {
            "per_hour": flow,
            "population": present[name],
            "mean_travel_s": round(seconds[name], 1),
            "blueprints": BLUEPRINTS[name],
            **_speed(name),
        }
    return {
        "kind": "carla traffic",
        "map": "",
        "driving_side": twin.roads.driving_side,
        "seed": seed,
        "step_s": float(asked["step_s"]),
        "warmup_s": float(asked["warmup_s"]),
        "duration_s": float(asked["duration_s"]),
        "classes": classes,
        "left_out": [{"class": one.actor_class, "why": one.why} for one in demand.left_out],
    }


def _speed(name: str) -> dict[str, Any]:
    """Return the desired speed of a class."""
    parameters = ACTOR_KINDS[name].parameters
    found = _NORMC.match(parameters.get("speedFactor", ""))
    keys = ("mean", "deviation", "least", "greatest")
    factor = {"mean": 1.0, "deviation": 0.1, "least": 0.2, "greatest": 2.0}  # SUMO's defaults
    if found:
        factor = dict(zip(keys, map(float, found[1].split(",")), strict=True))
    wanted = parameters.get("desiredMaxSpeed")
    if wanted:
        return {"speed_ms": float(wanted), "speed_factor": factor}
    limit = {"tm_speed_difference_percent": round(100.0 * (1.0 - factor["mean"]), 1)}
    return {"speed_factor": factor, **limit}


def _edge_seconds(twin: Twin) -> dict[str, tuple[float, float]]:
    """Return length, metres, and speed limit, m/s, of each edge of the SUMO network."""
    found = {}
    for edge in etree.parse(twin.net_path).getroot().iterfind("edge"):
        lanes = edge.findall("lane")
        if lanes:
            limit = max(float(lane.get("speed")) for lane in lanes)
            found[edge.get("id")] = (float(lanes[0].get("length")), limit)
    return found


def _mean_seconds(demand: Demand, edges: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Return the mean time of each class's trips at free speed."""
    times: dict[str, list[float]] = {}
    for trip in demand.trips:
        wanted = ACTOR_KINDS[trip.actor_class].parameters.get("desiredMaxSpeed")
        most = float(wanted) if wanted else np.inf
        total = sum(
            edges[name][0] / min(edges[name][1], most) for name in trip.edges if name in edges
        )
        times.setdefault(trip.actor_class, []).append(total)
    return {name: float(np.mean(values)) for name, values in times.items()}


#: Spacing of spawn points on a lane, and distance from its ends, metres: a bus fits between.
EVERY_M, FROM_END_M = 15.0, 7.5
#: Above the road, so that no wheel starts inside it (CARLA's documentation: 0.5 to 1 m).
ABOVE_M = 0.5
#: Length over which a lane's direction is computed, metres.
REACH_M = 1.0


def spawn_points(network: RoadNetwork) -> list[dict[str, Any]]:
    """Return spawn points of vehicles in CARLA's frame, in the order of the lanes.

    Each has ``location`` (x, y, z, metres) and ``rotation`` (pitch, yaw, roll, degrees) as for
    ``carla.Transform``, its ``lane`` with the ``allowed`` classes and ``speed_limit_kmh``, and
    ``at_m``, the distance from the lane's start, metres.
    """
    found = []
    for lane in network.lanes:
        if lane.junction or lane.kind not in ("driving", "bus") or len(lane.centre) < 2:
            continue
        along = stations_of_points(lane.centre[:, :2])
        room = float(along[-1]) - 2 * FROM_END_M
        if room < 0:
            continue
        count = int(room // EVERY_M) + 1
        first = (float(along[-1]) - (count - 1) * EVERY_M) / 2
        for at in first + EVERY_M * np.arange(count):
            behind, here, ahead = (
                np.array([np.interp(s, along, lane.centre[:, k]) for k in range(3)])
                for s in (at - REACH_M, at, at + REACH_M)
            )
            way = ahead - behind
            yaw = np.arctan2(way[1], way[0])
            pitch = -np.arctan2(way[2], np.hypot(way[0], way[1]))
            pose = Pose.from_ypr(here + [0, 0, ABOVE_M], float(yaw), float(pitch))
            found.append(
                {
                    **carla_transform(pose),
                    "lane": lane.id,
                    "at_m": round(float(at), 2),
                    "allowed": list(lane.allowed),
                    "speed_limit_kmh": round(lane.speed_limit * 3.6, 1),
                }
            )
    return found


def write_carla(twin: Twin, folder: Path) -> None:
    """Write a map package for CARLA 0.9.16, and the files for traffic and sensors in it.

    ::

        README.txt                    how to import it
        carla.json                    manifest of the package and its twin
        traffic.json                  composition of the traffic
        spawn_points.json             spawn points of vehicles
        rig.json                      the sensors as CARLA's blueprints
        navigation/<map>.obj          areas for pedestrians, for RecastBuilder
        UrbanTwin_<map>/              folder to copy to carla/Import/
            UrbanTwin_<map>.json      package description for make import
            <map>/<map>.fbx           the mesh
            <map>/<map>.xodr          OpenDRIVE 1.4

    ``make import`` treats **every** ``.json`` under ``carla/Import`` as a package
    (``Util/BuildTools/Import.py``), so the package's folder contains only one.

    Raises:
        InputError: the folder has other contents, or Assimp is not installed.
        StageError: Assimp failed.
    """
    title = str(twin.manifest["name"])
    name = map_name(title, twin.frame.latitude, twin.frame.longitude)
    package = f"UrbanTwin_{name}"
    paint = markings(twin.roads, twin.ground_mesh, twin.lane_model)
    objects, looks = named_objects(twin.mesh, paint)
    with replaced_folder(folder, kind="carla", inputs=[twin.folder]) as scratch:
        here = scratch / package / name
        here.mkdir(parents=True)
        write_fbx(objects, here / f"{name}.fbx", looks)
        walked = navigation_objects(objects)
        areas = {area: Look((0.5, 0.5, 0.5)) for one in walked for area in one.materials}
        (scratch / "navigation").mkdir()
        write_obj(walked, scratch / "navigation" / f"{name}.obj", areas)
        write_opendrive(
            twin.lane_model, twin.frame, here / f"{name}.xodr", version="1.4", name=name
        )
        entry = {
            "name": name,
            "source": f"./{name}/{name}.fbx",
            "use_carla_materials": True,
            "xodr": f"./{name}/{name}.xodr",
        }
        write_json(scratch / package / f"{package}.json", {"maps": [entry], "props": []})
        points = spawn_points(twin.roads)
        write_json(scratch / "spawn_points.json", {"map": name, "spawn_points": points})
        write_json(scratch / "traffic.json", {**carla_traffic(twin, scratch), "map": name})
        rig = carla_rig(
            place_rig(
                twin.rig_spec(),
                twin.mesh,
                file=twin.rig_path,
                anchor_height_m=twin.anchor_height_m,
            )
        )
        write_json(scratch / "rig.json", {"map": name, **rig})
        shutil.copyfile(live.__file__, scratch / "run_in_carla.py")
        folders = {kind: folder_of(f"{name}_{kind}_0") for kind in OBJECTS}
        readme = text_file(
            "exports/carla/README.txt.j2",
            title=title,
            package=package,
            name=name,
            by_hand=[kind for kind, own in OBJECTS.items() if folders[kind] not in (own, None)],
        )
        (scratch / "README.txt").write_text(readme, encoding="utf-8")
        kinds = [one.name.rsplit("_", 1)[0] for one in objects]
        write_json(
            scratch / "carla.json",
            {
                "kind": "carla",
                "carla": "0.9.16",
                "twin": title,
                "twin_sha256": twin.sha256,
                "package": package,
                "map": name,
                "mesh": "fbx",
                "objects": {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)},
                "spawn_points": len(points),
                "frame": "x east, y south, z up of the anchor, metres (FBX: centimetres, y north)",
                "inputs": twin.manifest["inputs"],
            },
        )
