"""Schemas of ``dataset.json`` and ``fleet.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from urbantwin.artefact import read_json
from urbantwin.artefact.manifest import Part, PlainName, validated
from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.taxonomy import BoxKind

__all__ = [
    "FLEET",
    "FramePoses",
    "Matrix",
    "pose_matrix",
    "pose_of_matrix",
    "read_fleet_manifest",
    "read_manifest",
]


FLEET = "fleet"


class _FleetSensor(Part):
    name: str
    model: str


class _Node(Part):
    name: PlainName
    rides: bool
    carrier: _Count | None = None
    seed: _Count
    frames: _Count
    frames_absent: _Count
    frames_lost: _Count
    points: _Count
    sensors: list[_FleetSensor]


class _FleetFrame(Part):
    name: PlainName
    time_s: _Seconds


class _Fleet(Part):
    kind: Literal["fleet"]
    urbantwin: str
    rate_hz: Annotated[float, Field(gt=0, le=10_000)]
    boxes: BoxKind = "track"
    seeds: dict[str, _Count]
    inputs: list[dict[str, Any]]
    nodes: Annotated[list[_Node], Field(min_length=1)]
    frames: Annotated[list[_FleetFrame], Field(min_length=1)]


def read_fleet_manifest(folder: Path) -> dict[str, Any]:
    """Read and validate the manifest of a fleet.

    Raises:
        InputError: missing, or an invalid field, which is named.
    """
    file = folder / f"{FLEET}.json"
    manifest = read_json(file, kind=FLEET)
    validated(manifest, _Fleet, file=file, expected="a fleet's manifest")
    return manifest


_EXPECTED = "a dataset's manifest"
#: Tolerance of rotations, and largest distance from the origin, metres.
_ROUND, _FURTHEST_M = 1e-4, 1e7


def _rigid(rows: list[list[float]]) -> list[list[float]]:
    matrix = np.array(rows)
    rotation = matrix[:3, :3]
    if (
        np.abs(matrix).max() > _FURTHEST_M
        or np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROUND
        or np.linalg.det(rotation) < 0
        or np.abs(matrix[3] - [0, 0, 0, 1]).max() > _ROUND
    ):
        raise ValueError("the rows of a pose: a rotation and a place")
    return rows


_Row = Annotated[list[float], Field(min_length=4, max_length=4)]
#: A pose as the rows of a 4x4 matrix.
Matrix = Annotated[list[_Row], Field(min_length=4, max_length=4), AfterValidator(_rigid)]
_Count = Annotated[int, Field(ge=0, lt=2**53)]
_Seconds = Annotated[float, Field(ge=-1e10, le=1e10)]
_Rate = Annotated[float, Field(gt=0, le=10_000)]


class _FramePose(Part):
    name: PlainName
    dataset_SE3_site: Matrix | None = None  # noqa: N815


class FramePoses(Part):
    """The part of a manifest that gives the pose of each frame's points in the site."""

    dataset_SE3_site: Matrix | None = None  # noqa: N815
    frames: list[_FramePose] = Field(default_factory=list)


class _Frame(_FramePose):
    time_s: _Seconds
    points: _Count = 0
    boxes: _Count = 0


class _Unit(Part):
    elevation_deg: Annotated[list[float], Field(min_length=1, max_length=4096)]
    pattern: dict[str, Any] | None = None


class _Sensor(Part):
    name: PlainName
    model: str
    columns: Annotated[int, Field(ge=1, le=10_000_000)]
    site_SE3_sensor: Matrix  # noqa: N815
    carrier_SE3_sensor: Matrix | None = None  # noqa: N815
    number: Annotated[int, Field(ge=0, le=255)] | None = None
    sensor: _Unit


class _Rig(Part):
    rate_hz: _Rate
    boxes: BoxKind = "track"
    carrier: _Count | None = None
    sensors: Annotated[list[_Sensor], Field(min_length=1)]


class _Counts(Part):
    frames: Annotated[int, Field(ge=1, lt=2**53)]
    train: _Count
    val: _Count
    test: _Count = 0  # datasets of older versions have none
    points: _Count
    boxes: dict[str, _Count]
    boxes_with_points: dict[str, _Count]
    boxes_in_reach: dict[str, _Count] = Field(default_factory=dict)
    boxes_in_reach_with_points: dict[str, _Count] = Field(default_factory=dict)
    points_by_class: dict[str, _Count]


class _Dataset(Part):
    kind: Literal["dataset"]
    urbantwin: str
    seeds: dict[str, _Count]
    frame: str
    dataset_SE3_site: Matrix | None  # noqa: N815
    rig: _Rig
    counts: _Counts
    class_names: list[str] = Field(default_factory=list)
    point_cloud_range: Annotated[list[float], Field(min_length=6, max_length=6)]
    inputs: list[dict[str, Any]]
    frames: Annotated[list[_Frame], Field(min_length=1)]


class _Datasets(Part):
    kind: Literal["datasets"]
    datasets: list[PlainName]


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read and validate the manifest of a dataset, or of a folder with one per sensor.

    Raises:
        InputError: missing, or an invalid field, which is named.
    """
    file = folder / "dataset.json"
    if not file.is_file() and (folder / "fleet.json").is_file():
        nodes = sorted(file_of_node.parent.name for file_of_node in folder.glob("*/dataset.json"))
        raise InputError(
            "is a fleet", file=folder, expected=f"the dataset of one node: {', '.join(nodes)}"
        )
    manifest = read_json(file, kind="dataset")
    kind = manifest.get("kind")
    if kind not in ("dataset", "datasets"):
        raise InputError("is not a dataset's", file=file, expected='"kind": "dataset"')
    model = _Dataset if kind == "dataset" else _Datasets
    validated(manifest, model, file=file, expected=_EXPECTED)
    return manifest


def pose_of_matrix(rows: Any) -> Pose:  # noqa: ANN401
    """Return the pose of the rows of a 4x4 matrix.

    Raises:
        ValueError: not a rigid transformation.
    """
    matrix = np.array(rows, np.float64).reshape(4, 4)
    _rigid(matrix.tolist())
    return Pose(matrix[:3, :3], matrix[:3, 3])


def pose_matrix(pose: Pose) -> list[list[float]]:
    """Return a pose as the rows of a 4x4 matrix, without negative zeros."""
    rows = np.eye(4)
    rows[:3, :3] = pose.rotation
    rows[:3, 3] = pose.translation
    return [[float(value) + 0.0 for value in row] for row in rows]
