"""OPV2V, V2X-Real, V2V4Real: a folder for each vehicle or roadside unit, a yaml beside each cloud.

Source: Xu et al. 2022 (OPV2V), 2023 (V2V4Real), Xiang et al. 2024 (V2X-Real), and OpenCOOD's
``transformation_utils.x_to_world`` and ``box_utils.project_world_objects``: poses are x, y, z in
metres, roll, yaw, pitch in degrees, with CARLA's signs; objects stand in the world, with half
their sizes. OPV2V was made in CARLA, whose frames are left-handed: its y is turned round here.
V2X-Real is real, and is not; objects in it have a class, ``obj_type``. What ``urbantwin export
--to opv2v`` writes is as OPV2V's, with a ``class``, and people under ``pedestrians``. V2V4Real's
poses are matrices of 4 by 4, and its objects stand in the frame of the points
(``project_world_objects`` and ``x1_to_x2`` of its own code); what both vehicles label has a common
number (``ass_id``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.documents import laid_out, read_yaml_document
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, checked_pose, heading
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose

__all__ = ["is_opencood", "open_opencood"]

_EXPECTED = "a frame's description of OPV2V, V2X-Real or V2V4Real"
_ENDINGS = (".pcd", ".bin")
#: What OpenCDA, the simulation behind OPV2V, writes and nothing real has.
_SIMULATED = ("true_ego_pos", "predicted_ego_pos", "plan_trajectory")
_HERE = Pose(np.eye(3), np.zeros(3))


def _clouds(folder: Path) -> list[Path]:
    """Return the clouds with a description beside them."""
    return [one for one in clouds_in(folder, *_ENDINGS) if one.with_suffix(".yaml").is_file()]


def _agents(path: Path) -> list[Path]:
    """Return the folders of vehicles and roadside units, which are called by whole numbers."""
    named = (one for one in path.iterdir() if one.is_dir() and one.name.lstrip("-").isdigit())
    return sorted((one for one in named if _clouds(one)), key=lambda one: int(one.name))


def is_opencood(path: Path) -> bool:
    """Return whether a folder is an agent's, or a scenario of them."""
    return path.is_dir() and (bool(_clouds(path)) or bool(_agents(path)))


def open_opencood(path: Path) -> Recording:
    """Open the frames of one agent.

    Raises:
        InputError: there are several: one of their folders must be named.
    """
    files = _clouds(path)
    if not files:
        agents = _agents(path)
        if len(agents) != 1:
            raise InputError(
                f"holds {len(agents)} agents",
                file=path,
                expected=f"one of its folders: {', '.join(one.name for one in agents)}",
            )
        files = _clouds(agents[0])

    def read(index: int) -> Frame:
        file = files[index]
        described = file.with_suffix(".yaml")
        values = read_yaml_document(described, _EXPECTED)
        with laid_out(described, _EXPECTED):
            mirrored = _is_simulated(values)
            matrix = len(values["lidar_pose"]) in (4, 16)
            objects = {**(values.get("vehicles") or {}), **(values.get("pedestrians") or {})}
            if matrix:
                mirrored, world_SE3_lidar = False, _pose_of_matrix(values["lidar_pose"])
                boxes = _boxes(objects, _HERE, described.parent.name)
            else:
                world_SE3_lidar = _pose(values["lidar_pose"])
                boxes = _boxes(objects, world_SE3_lidar)
        fields = read_fields(file, 4)
        given: dict[str, NDArray[Any]] = {}
        if "rgb" in fields and "intensity" not in fields:
            given["intensity"] = _red(fields["rgb"])
        frame = frame_of(file, fields, name=file.stem, given=given, boxes=boxes)
        return _placed(frame, world_SE3_lidar, mirrored)

    return Recording(path, "opencood", tuple(file.stem for file in files), read)


def _is_simulated(values: Mapping[str, Any]) -> bool:
    objects = list((values.get("vehicles") or {}).values())
    if any("obj_type" in one for one in objects):
        return False
    return bool(objects) or any(name in values for name in _SIMULATED)


def _pose(values: list[float]) -> Pose:
    """Return a pose; CARLA's pitch and roll turn the other way than ours, its yaw as ours."""
    x, y, z, roll, yaw, pitch = (float(value) for value in values)
    if not np.isfinite([x, y, z, roll, yaw, pitch]).all():
        raise ValueError("a pose that is not finite")
    return Pose.from_ypr([x, y, z], np.radians(yaw), -np.radians(pitch), -np.radians(roll))


def _pose_of_matrix(values: Sequence[Any]) -> Pose:
    """Return the pose of 4 by 4 numbers, row by row or all in one."""
    rows = [[float(x) for x in row] for row in values] if len(values) == 4 else values
    numbers = np.array(rows, np.float64).reshape(4, 4)
    return checked_pose(numbers[:3, :3], numbers[:3, 3])


def _three(values: Sequence[Any]) -> list[float]:
    x, y, z = (float(value) for value in values)
    return [x, y, z]


def _boxes(objects: Mapping[Any, Any], world_SE3_lidar: Pose, agent: str | None = None) -> Boxes:
    """Return objects in the frame of the points.

    Args:
        objects: by number.
        world_SE3_lidar: where that frame is in the one that they stand in.
        agent: of V2V4Real: whose numbers they are.
    """
    lidar_SE3_world = world_SE3_lidar.inverse()
    labelled = []
    for number, one in objects.items():
        # Number by number: a list of lists that YAML's aliases make is larger than any memory.
        begin, middle = (_three(one[name]) for name in ("location", "center"))
        place = [a + b for a, b in zip(begin, middle, strict=True)]
        pose = lidar_SE3_world @ _pose([*place, *_three(one["angle"])])
        size = (2 * abs(float(value)) for value in one["extent"])
        labelled.append(
            LabelledBox(
                (*pose.translation.tolist(), *size, heading(pose.rotation)),
                str(one.get("obj_type") or one.get("class", "vehicle")),
                int(number) if agent is None else _track(one, int(number), agent),
            )
        )
    return boxes_of(labelled)


def _track(one: Mapping[str, Any], number: int, agent: str) -> int:
    """Return an object's number of V2V4Real: that of both vehicles, else as its code makes it."""
    common = int(one.get("ass_id", -1))
    return common if common != -1 else number + 100 * int(agent)


def _red(colours: NDArray[np.generic]) -> NDArray[np.float64]:
    """Return the red of packed colours as 0..1: where OPV2V keeps intensity.

    A colour is 32 bits, which writers call a whole number or a float (of the same bits: never
    between 1 and 2^32, as its upper eight are the opacity, all or none).
    """
    values = colours.astype(np.float64)
    whole = (values >= 1) & (values < 2**32)
    packed = values.astype(np.float32).view(np.uint32)
    packed[whole] = values[whole].astype(np.uint32)
    return ((packed >> 16) & 0xFF) / 255.0


def _placed(frame: Frame, world_SE3_lidar: Pose, mirrored: bool) -> Frame:
    if not mirrored:
        return replace(frame, world_SE3_frame=world_SE3_lidar)
    turn = np.array([1.0, -1.0, 1.0])
    boxes = frame.boxes
    assert boxes is not None
    box = boxes.box * [1, -1, 1, 1, 1, 1, -1]
    world = Pose(
        world_SE3_lidar.rotation * turn * turn[:, None], world_SE3_lidar.translation * turn
    )
    return replace(
        frame,
        points=frame.points * turn,
        boxes=replace(boxes, box=box),
        world_SE3_frame=world,
        notes=(*frame.notes, "From CARLA's left-handed frame: y is turned round."),
    )
