"""OPV2V as read by OpenCOOD: a folder per agent, with a yaml file beside each cloud.

Every static sensor is an agent, and so is a vehicle with its sensors; of a fleet, every node.

Source: Xu et al. 2022, OpenCDA's data dumper, and OpenCOOD's ``basedataset``, ``x_to_world``,
``project_world_objects`` and ``pcd_to_np``. Frames are CARLA's: left-handed, y inverted, poses x,
y, z, roll, yaw, pitch in metres and degrees. Roadside units have negative numbers. An agent lists
the vehicles that its own LiDAR sees, since OpenCOOD has no other mark for objects that cannot be
learned. Its intensity is the red channel of a colour.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.dataset.reading import Fleet, Frame
from urbantwin.errors import InputError
from urbantwin.exports.frames.box_poses import site_boxes
from urbantwin.exports.frames.opencood_config import CONFIG_FILE, ReachOfBoxes, opencood_config
from urbantwin.exports.frames.point_files import record_of, write_pcd_file
from urbantwin.exports.frames.scenes import LONGEST_GAP_S, scenes_of
from urbantwin.exports.frames.source import FrameSource
from urbantwin.geometry import Pose
from urbantwin.lidar.rig import dataset_frame
from urbantwin.progress import Progress, each
from urbantwin.taxonomy import classes_in

__all__ = ["losses_opv2v", "write_opv2v", "write_opv2v_fleet", "write_opv2v_parts"]

#: Folders of the parts of the split; OpenCOOD ignores the folder of frames without a part.
_PARTS = {"train": "train", "val": "validate", "test": "test", None: "unused"}
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
#: Classes of which OpenCOOD makes no vehicles: under a name of ours, which it does not read.
_ON_FOOT = ("pedestrian",)
_PEOPLE = "pedestrians"
_MIRROR = np.array([1.0, -1.0, 1.0])
_KMH = 3.6


@dataclass(frozen=True)
class _Agent:
    """A roadside unit with one sensor, or a vehicle with all its sensors.

    Attributes:
        number: number of its folder; negative for roadside units.
        source: dataset with its points.
        sensors: indices of its sensors in that dataset's rig.
        moving: whether it is a vehicle.
        node: name of its node in a fleet; empty without one.
        fleet: its fleet.
    """

    number: int
    source: FrameSource
    sensors: tuple[int, ...]
    moving: bool = False
    node: str = ""
    fleet: Fleet | None = None

    @property
    def name(self) -> str:
        """Name of the agent or of its sensors."""
        if self.node:
            return self.node
        return " + ".join(str(self.source.sensors[one]["name"]) for one in self.sensors)


@dataclass(frozen=True)
class _Scene:
    """A scenario: consecutive frames, and the agents present in all of them.

    Attributes:
        part: part of the split; ``None`` without one.
        times_s: times of its frames by name, seconds.
        agents: its agents.
    """

    part: str | None
    times_s: dict[str, float]
    agents: Sequence[_Agent]


def _agents(sources: Sequence[FrameSource]) -> list[_Agent]:
    """Return the agents of a dataset, or of one dataset per sensor."""
    first = sources[0]
    rig = first.manifest["rig"]
    if rig.get("ride") is not None:
        if len(sources) > 1:
            raise InputError(
                "has several clouds of one vehicle, which has one in OPV2V",
                file=first.folder.parent,
                expected=f"sensors that are fused, or one of them: {first.folder}",
            )
        sensors = tuple(range(len(first.sensors)))
        return [_Agent(int(rig.get("carrier") or 0), first, sensors, moving=True)]
    for other in sources[1:]:
        if other.names != first.names:
            raise InputError(
                "has other frames than the first sensor",
                file=other.folder / "dataset.json",
                expected=f"the frames of {first.folder.name}",
            )
    mounted = [(source, one) for source in sources for one in range(len(source.sensors))]
    return [_Agent(-1 - k, source, (one,)) for k, (source, one) in enumerate(mounted)]


def losses_opv2v(source: FrameSource) -> list[str]:
    """Return notes on omitted boxes without points, and on classes that OpenCOOD does not read."""
    theirs = classes_in("opv2v")
    unseen = people = 0
    for name in source.names:
        boxes = source.objects.of_frame(name)
        held = np.array([theirs[kind] is not None for kind in boxes.class_name], bool)
        unseen += int(np.count_nonzero(held & (boxes.num_points == 0)))
        people += int(np.count_nonzero(np.isin(boxes.class_name, _ON_FOOT)))
    told = []
    if unseen:
        told.append(
            f"of boxes: {unseen} on which no sensor has a point are left out, as in OPV2V, which "
            "has no mark for them"
        )
    if people:
        told.append(
            f"people are under {_PEOPLE!r}, which OpenCOOD does not read: to it all else is a "
            "vehicle"
        )
    if source.labelled_classes:
        told.append("of boxes: of velocity only the speed")
    return told


def write_opv2v(source: FrameSource, folder: Path, tell: Progress) -> list[str]:
    """Write ``PART/SCENARIO/AGENT/NAME.pcd`` and ``.yaml``, ``data_protocol.yaml`` and a config.

    Args:
        source: the dataset; each of its sensors is an agent.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Returns:
        Notes for the user.
    """
    return write_opv2v_parts([source], folder, tell)


def write_opv2v_parts(sources: Sequence[FrameSource], folder: Path, tell: Progress) -> list[str]:
    """Write the same for one dataset per sensor.

    Args:
        sources: the datasets, of the same frames.
        folder: folder to write into.
        tell: called with the fraction done and a description.

    Raises:
        InputError: the frames differ, or the datasets are of one vehicle.
    """
    agents = _agents(sources)
    first = sources[0]
    scenes = [
        _Scene(scene.part, {first.names[n]: float(first.times_s[n]) for n in scene.numbers}, agents)
        for scene in scenes_of(first)
    ]
    return _write_scenes(folder, scenes, first.rate_hz, tell)


def write_opv2v_fleet(fleet: Fleet, folder: Path, tell: Progress) -> list[str]:
    """Write the same for a fleet: each node is an agent, even with several sensors.

    A scenario has the agents that are present in all of its frames: it ends when the set of present
    nodes changes. Frames are written even if they were lost in transmission, at their true times.
    The reported pose of a node is ``predicted_ego_pos``; points are placed by the true pose, as in
    OPV2V.

    Args:
        fleet: the fleet.
        folder: folder to write into.
        tell: called with the fraction done and a description.
    """
    agents: dict[str, _Agent] = {}
    for told in fleet.manifest["nodes"]:
        source = FrameSource(fleet.folder_of(told["name"]))
        rides = told["carrier"] is not None
        standing = sum(not one.moving for one in agents.values())
        agents[told["name"]] = _Agent(
            int(told["carrier"]) if rides else -1 - standing,
            source,
            tuple(range(len(source.sensors))),
            moving=rides,
            node=told["name"],
            fleet=fleet,
        )
    return _write_scenes(folder, _scenes_of_fleet(fleet, agents), fleet.manifest["rate_hz"], tell)


def _scenes_of_fleet(fleet: Fleet, agents: Mapping[str, _Agent]) -> list[_Scene]:
    """Return groups of consecutive frames with the same part of the split and the same agents."""
    scenes: list[_Scene] = []
    before_s = -np.inf
    for name, time_s in zip(fleet.names, fleet.times_s.tolist(), strict=True):
        there = [one for node, one in agents.items() if fleet.state(name, node).present]
        part = there[0].source.part_of(name) if there else None
        same = scenes and (scenes[-1].part, list(scenes[-1].agents)) == (part, there)
        if not same or time_s - before_s > LONGEST_GAP_S:
            scenes.append(_Scene(part, {}, there))
        scenes[-1].times_s[name] = time_s
        before_s = time_s
    return [one for one in scenes if one.agents]


def _write_scenes(
    folder: Path, scenes: Sequence[_Scene], rate_hz: float, tell: Progress
) -> list[str]:
    """Write scenarios with each agent's frames in its folder; return notes on the agents."""
    every: dict[int, str] = {}
    frames: list[tuple[Path, _Scene, str]] = []
    for k, scene in enumerate(scenes):
        scenario = folder / _PARTS.get(scene.part, str(scene.part)) / f"scenario_{k:04d}"
        for agent in scene.agents:
            (scenario / str(agent.number)).mkdir(parents=True)
        own = {agent.number: agent.name for agent in scene.agents}
        every |= own
        _write_yaml(
            scenario / "data_protocol.yaml",
            {
                "world": {"fixed_delta_seconds": 1 / rate_hz},
                "agents": own,
                "times_s": dict(scene.times_s),
            },
        )
        frames += [(scenario, scene, name) for name in scene.times_s]
    reach = ReachOfBoxes()
    for number in each(range(len(frames)), tell, "frames"):
        scenario, scene, name = frames[number]
        read: dict[Path, Frame] = {}
        seen: set[int] = set()
        for agent in scene.agents:
            source = agent.source
            if source.folder not in read:
                read[source.folder] = source[source.names.index(name)]
            seen |= _write_agent(scenario, agent, read[source.folder])
        for agent in scene.agents:
            # Objects seen by any agent are training targets.
            _add_reach(reach, read[agent.source.folder], agent, seen)
    notes = [f"agents: {', '.join(f'{number} {name}' for number, name in every.items())}"]
    if np.isfinite(reach.low).all():
        (folder / CONFIG_FILE).write_text(opencood_config(reach), encoding="utf-8")
        notes.append(reach.note)
    else:
        notes.append("no config: no sensor sees a vehicle")
    return notes


def _add_reach(reach: ReachOfBoxes, frame: Frame, agent: _Agent, seen: set[int]) -> None:
    """Add the vehicles among the objects that are seen, in the frame of an agent."""
    boxes = frame.objects
    theirs = classes_in("opv2v")
    mine = np.array(
        [
            track in seen and theirs[kind] is not None and kind not in _ON_FOOT
            for track, kind in zip(boxes.track.tolist(), boxes.class_name.tolist(), strict=True)
        ],
        bool,
    )
    agent_SE3_site = _pose_of(frame, agent).inverse()
    middles, rotations = site_boxes(frame)
    reach.add(
        agent_SE3_site.apply(middles[mine]),
        agent_SE3_site.rotation @ rotations[mine],
        boxes.box[mine, 3:6],
    )


def _write_agent(scenario: Path, agent: _Agent, frame: Frame) -> set[int]:
    """Write an agent's cloud and yaml of a frame; return the tracks that it sees."""
    stem = scenario / str(agent.number) / frame.name
    site_SE3_agent = _pose_of(frame, agent)
    mine = _points_of(frame, agent)
    _write_cloud(stem.with_suffix(".pcd"), frame, mine, site_SE3_agent)
    told = _told(frame, mine, site_SE3_agent, _speed(frame, agent))
    if agent.fleet is not None:
        state = agent.fleet.state(frame.name, agent.node)
        assert state.reported is not None
        assert state.true is not None
        believed = state.reported @ state.true.inverse() @ site_SE3_agent
        told["predicted_ego_pos"] = _carla_pose(believed)
    _write_yaml(stem.with_suffix(".yaml"), told)
    return set(told["vehicles"])


def _pose_of(frame: Frame, agent: _Agent) -> Pose:
    """Return the pose of an agent's cloud: upright, at its first sensor, with its heading."""
    name = agent.source.sensors[agent.sensors[0]]["name"]
    return dataset_frame("level", frame.site_SE3_sensors[name])


def _points_of(frame: Frame, agent: _Agent) -> NDArray[np.bool_]:
    if len(agent.source.sensors) == 1 or "sensor" not in (frame.rays.dtype.names or ()):
        return np.ones(len(frame.points), bool)
    return np.isin(frame.rays["sensor"], agent.sensors)


def _speed(frame: Frame, agent: _Agent) -> float:
    """Return an agent's speed, km/h, from its positions in the adjacent frames."""
    source = agent.source
    if not agent.moving or len(source) < 2:
        return 0.0
    first, last = max(frame.number - 1, 0), min(frame.number + 1, len(source) - 1)
    way = source[last].site_SE3_dataset.translation - source[first].site_SE3_dataset.translation
    time_s = float(source.times_s[last] - source.times_s[first])
    return float(np.linalg.norm(way)) / time_s * _KMH if time_s > 0 else 0.0


def _write_cloud(path: Path, frame: Frame, mine: NDArray[np.bool_], site_SE3_agent: Pose) -> None:
    """Write points with a grey value of the intensity, and the intensity itself."""
    agent_SE3_frame = site_SE3_agent.inverse() @ frame.site_SE3_dataset
    points = (agent_SE3_frame.apply(frame.xyz[mine]) * _MIRROR).astype(np.float32)
    intensity = frame.intensity[mine].astype(np.float32)
    grey = np.round(np.clip(intensity, 0, 1) * 255).astype(np.uint32)
    columns = {axis: points[:, k] for k, axis in enumerate("xyz")}
    columns |= {"rgb": (grey * 0x010101).view(np.float32), "intensity": intensity}
    write_pcd_file(path, record_of(columns))


def _told(
    frame: Frame, mine: NDArray[np.bool_], site_SE3_agent: Pose, speed: float
) -> dict[str, Any]:
    """Return the yaml of a frame."""
    pose = _carla_pose(site_SE3_agent)
    objects: dict[str, dict[int, dict[str, Any]]] = {"vehicles": {}, _PEOPLE: {}}
    seen = set(np.unique(frame.instance[mine]).tolist())
    for track, kind, one in _objects(frame):
        if track in seen:
            objects[_PEOPLE if kind in _ON_FOOT else "vehicles"][track] = one
    return {
        "ego_speed": speed,
        "lidar_pose": pose,
        "predicted_ego_pos": list(pose),
        "true_ego_pos": list(pose),
        "plan_trajectory": [],
        **objects,
    }


def _objects(frame: Frame) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Yield track, class and description of every box with a class in OPV2V."""
    boxes = frame.objects
    theirs = classes_in("opv2v")
    middles, rotations = site_boxes(frame)
    speeds = np.linalg.norm(boxes.velocity, axis=1) * _KMH
    for row, kind in enumerate(boxes.class_name.tolist()):
        name = theirs[kind]
        if name is None:
            continue
        x, y, z, roll, yaw, pitch = _carla_pose(Pose(rotations[row], middles[row]))
        half = (boxes.box[row, 3:6] / 2).tolist()
        yield (
            int(boxes.track[row]),
            kind,
            {
                "angle": [roll, yaw, pitch],
                "center": [0.0, 0.0, half[2]],
                "class": name,
                "extent": half,
                "location": [x, y, z - half[2]],
                "speed": float(speeds[row]),
            },
        )


def _carla_pose(pose: Pose) -> list[float]:
    """Return x, y, z, roll, yaw, pitch in CARLA's frame, metres and degrees.

    With F the mirror of y, a pose's rotation R (x forward, y left) is F R F in CARLA; OpenCOOD's
    ``x_to_world`` computes the same from the angles.
    """
    turned = pose.rotation * _MIRROR * _MIRROR[:, None]
    yaw = np.arctan2(turned[1, 0], turned[0, 0])
    pitch = np.arcsin(np.clip(turned[2, 0], -1, 1))
    roll = np.arctan2(-turned[2, 1], turned[2, 2])
    place = pose.translation * _MIRROR
    return [float(value) + 0.0 for value in (*place, *np.degrees([roll, yaw, pitch]))]


def _write_yaml(path: Path, value: object) -> None:
    path.write_text(yaml.dump(value, Dumper=_DUMPER, sort_keys=True), encoding="utf-8")
