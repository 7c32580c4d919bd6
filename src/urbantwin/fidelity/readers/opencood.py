"""OPV2V, V2X-Real, V2V4Real: a folder per vehicle or roadside unit, a yaml beside each cloud.

Sources: Xu et al. 2022 (OPV2V), 2023 (V2V4Real), Xiang et al. 2024 (V2X-Real), and OpenCOOD's
``transformation_utils.x_to_world`` and ``box_utils.project_world_objects``: poses are x, y, z in
metres, roll, yaw, pitch in degrees, with CARLA's signs; objects are in the world, with half their
sizes. OPV2V was made in CARLA, whose frames are left-handed: y is mirrored here. V2X-Real is real
and not mirrored; its objects have a class, ``obj_type``. Exports by ``urbantwin export --to opv2v``
are as OPV2V's, with a ``class``, and people under ``pedestrians``. V2V4Real's poses are matrices of
4 by 4, and its objects are in the frame of the points (``project_world_objects`` and ``x1_to_x2``
of its own code); objects that both vehicles label have a common number (``ass_id``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes
from urbantwin.fidelity.readers.folder import FolderDataset, Labels, clouds_in
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of
from urbantwin.geometry import Pose
from urbantwin.io.points import Fields
from urbantwin.io.poses import checked_pose, heading
from urbantwin.io.trust import laid_out, read_yaml_document

__all__ = ["OPENCOOD"]

_EXPECTED = "a frame's description of OPV2V, V2X-Real or V2V4Real"
#: Keys that OpenCDA, the simulation of OPV2V, writes and no real dataset has.
_SIMULATED = ("true_ego_pos", "predicted_ego_pos", "plan_trajectory")
_IDENTITY = Pose(np.eye(3), np.zeros(3))
_MIRROR = np.array([1.0, -1.0, 1.0])


def _described(folder: Path) -> list[Path]:
    """Return the clouds with a description beside them."""
    clouds = clouds_in(folder, ".pcd", ".bin")
    return [cloud for cloud in clouds if cloud.with_suffix(".yaml").is_file()]


def _agents(path: Path) -> list[Path]:
    """Return the folders of vehicles and roadside units, whose names are whole numbers."""
    named = (sub for sub in path.iterdir() if sub.is_dir() and sub.name.lstrip("-").isdigit())
    return sorted((sub for sub in named if _described(sub)), key=lambda sub: int(sub.name))


def _clouds(path: Path) -> list[Path]:
    files = _described(path)
    if files:
        return files
    agents = _agents(path)
    if len(agents) != 1:
        raise InputError(
            f"holds {len(agents)} agents",
            file=path,
            expected=f"one of its folders: {', '.join(agent.name for agent in agents)}",
        )
    return _described(agents[0])


def _labels(path: Path, files: list[Path]) -> Labels:
    def read(file: Path, index: int, fields: Fields) -> dict[str, Any]:
        described = file.with_suffix(".yaml")
        values = read_yaml_document(described, _EXPECTED)
        with laid_out(described, _EXPECTED):
            mirrored = _is_simulated(values)
            objects = {**(values.get("vehicles") or {}), **(values.get("pedestrians") or {})}
            if len(values["lidar_pose"]) in (4, 16):
                mirrored, world = False, _pose_of_matrix(values["lidar_pose"])
                boxes = _boxes(objects, _IDENTITY, described.parent.name)
            else:
                world = _pose(values["lidar_pose"])
                boxes = _boxes(objects, world)
        given: Fields = {}
        if "rgb" in fields and "intensity" not in fields:
            given["intensity"] = _red(fields["rgb"])
        notes: tuple[str, ...] = ()
        if mirrored:
            if "y" in fields:
                fields["y"] = fields["y"].astype(np.float64) * -1.0
            boxes = replace(boxes, box=boxes.box * [1, -1, 1, 1, 1, 1, -1])
            rotation = world.rotation * _MIRROR * _MIRROR[:, None]
            world = Pose(rotation, world.translation * _MIRROR)
            notes = ("From CARLA's left-handed frame: y is mirrored.",)
        return {"given": given, "boxes": boxes, "world_SE3_frame": world, "notes": notes}

    return Labels(read)


def _is_simulated(values: Mapping[str, Any]) -> bool:
    objects = list((values.get("vehicles") or {}).values())
    if any("obj_type" in item for item in objects):
        return False
    return bool(objects) or any(name in values for name in _SIMULATED)


def _pose(values: Sequence[float]) -> Pose:
    """Return a pose; CARLA's pitch and roll have the opposite sign of ours, its yaw the same."""
    x, y, z, roll, yaw, pitch = (float(value) for value in values)
    if not np.isfinite([x, y, z, roll, yaw, pitch]).all():
        raise ValueError("a pose that is not finite")
    return Pose.from_ypr([x, y, z], np.radians(yaw), -np.radians(pitch), -np.radians(roll))


def _pose_of_matrix(values: Sequence[Any]) -> Pose:
    """Return the pose of 4 by 4 numbers, in rows or in one list."""
    rows = [[float(x) for x in row] for row in values] if len(values) == 4 else values
    numbers = np.array(rows, np.float64).reshape(4, 4)
    return checked_pose(numbers[:3, :3], numbers[:3, 3])


def _three(values: Sequence[Any]) -> list[float]:
    x, y, z = (float(value) for value in values)
    return [x, y, z]


def _boxes(objects: Mapping[Any, Any], world_SE3_lidar: Pose, agent: str | None = None) -> Boxes:
    """Return objects in the frame of the points.

    Args:
        objects: objects by number.
        world_SE3_lidar: transform from the frame of the points to that of the objects.
        agent: for V2V4Real: the vehicle that labelled them.
    """
    lidar_SE3_world = world_SE3_lidar.inverse()
    labelled = []
    for number, item in objects.items():
        # read per number: nested YAML aliases can exceed any memory
        origin, centre = (_three(item[name]) for name in ("location", "center"))
        place = [a + b for a, b in zip(origin, centre, strict=True)]
        pose = lidar_SE3_world @ _pose([*place, *_three(item["angle"])])
        size = (2 * abs(float(value)) for value in item["extent"])
        track = int(number)
        if agent is not None:  # V2V4Real's numbering of objects that only one vehicle labels
            common = int(item.get("ass_id", -1))
            track = common if common != -1 else track + 100 * int(agent)
        labelled.append(
            LabelledBox(
                (*pose.translation.tolist(), *size, heading(pose.rotation)),
                str(item.get("obj_type") or item.get("class", "vehicle")),
                track,
            )
        )
    return boxes_of(labelled)


def _red(colours: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the red channel of packed colours as 0..1, where OPV2V stores intensity.

    A colour is 32 bits, stored as a whole number or as a float with the same bits (never between 1
    and 2^32, as its upper eight bits are the opacity, all or none).
    """
    values = colours.astype(np.float64)
    whole = (values >= 1) & (values < 2**32)
    packed = values.astype(np.float32).view(np.uint32)
    packed[whole] = values[whole].astype(np.uint32)
    return ((packed >> 16) & 0xFF) / 255.0


OPENCOOD = FolderDataset(
    name="opencood",
    title="OPV2V, V2X-Real or V2V4Real",
    detect=lambda path: path.is_dir() and (bool(_described(path)) or bool(_agents(path))),
    clouds=_clouds,
    labels=_labels,
    verified=False,
)
