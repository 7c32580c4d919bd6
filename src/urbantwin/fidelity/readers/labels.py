"""Labels of datasets as ours: classes, boxes, tracks, rotations."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.frame import Boxes
from urbantwin.geometry import Pose

__all__ = [
    "Box",
    "LabelledBox",
    "actor_class",
    "box_of_document",
    "boxes_of",
    "checked_pose",
    "heading",
    "letters",
    "pose_of_quaternion",
    "track_of",
]

#: Centre x, y, z, length, width, height (metres) and yaw (radians).
Box = tuple[float, float, float, float, float, float, float]

#: Names of our classes in data sets, as `letters` gives them. Where a data set has no class for
#: vans (nuScenes, Argoverse 2), they are among its cars.
_CALLED = {
    "car": "car vehicle regularvehicle policecar vehiclecar vehicleemergencypolice pickuptruck",
    "van": "van minivan cargovan vehiclevan",
    "truck": """truck boxtruck truckcab largevehicle concretetruck longvehicle vehicletruck
        vehicleconstruction vehicleemergencyambulance constructionvehicle trucktrailer othervehicle
        mediumsizedtruck semitruck
        """,
    "bus": "bus schoolbus articulatedbus vehiclebusrigid vehiclebusbendy",
    "motorcycle": """motorcycle motorcyclist motorcylerider motorcyclerider vehiclemotorcycle
        motor scooter scooterrider motorizedscooter""",
    "bicycle": "bicycle bicyclist cyclist bicyclerider bike vehiclebicycle",
    "pedestrian": """pedestrian person personsitting child roadworker officialsignaler
        humanpedestrianadult humanpedestrianchild humanpedestrianconstructionworker
        humanpedestrianpoliceofficer pedestrianwithobject""",
    "tram": "tram railedvehicle onrails streetcar tramsubway",
    "trailer": "trailer vehiculartrailer vehicletrailer",
    "animal": "animal dog",
}
#: How far a matrix that is written with few digits may be from a rotation; places on Earth, metres.
_ROUND, _FURTHEST_M = 0.01, 1e8
_CLASS_OF = {name: ours for ours, names in _CALLED.items() for name in names.split()}


def actor_class(source_name: str) -> str:
    """Return our class for a dataset's name of one, ``other`` where we have no such class."""
    return _CLASS_OF.get(letters(source_name), "other")


def letters(source_name: str) -> str:
    """Return a class name in lower case without anything but letters."""
    return re.sub(r"[^a-z]", "", source_name.lower())


def track_of(identity: str) -> int:
    """Return a number of 62 bits for an object's identity: the same in every frame and run."""
    return int.from_bytes(hashlib.sha256(identity.encode()).digest()[:8], "little") >> 2


@dataclass(frozen=True)
class LabelledBox:
    """A labelled object: a row of `Boxes`; -1, NaN, None and "" stand for values not given."""

    box: Box
    source_name: str
    track: int = -1
    velocity: tuple[float, float, float] | None = None
    occlusion: float = math.nan
    num_points: int = -1
    ignored: str = ""

    def __post_init__(self) -> None:
        """Refuse a track that is not a number of 64 bits: a reader turns ValueError into a line."""
        for what, number in (("a track", self.track), ("a number of points", self.num_points)):
            if not -(2**63) <= number < 2**63:
                raise ValueError(f"{str(number)[:40]} is not {what}")


def boxes_of(labelled: Sequence[LabelledBox]) -> Boxes:
    """Return labelled objects as one table, without those that have no finite place or size."""
    kept = [one for one in labelled if np.isfinite(one.box).all() and min(one.box[3:6]) > 0]
    return Boxes(
        box=np.array([one.box for one in kept], np.float64).reshape(-1, 7),
        class_names=tuple(actor_class(one.source_name) for one in kept),
        track=np.array([one.track for one in kept], np.int64),
        source_names=tuple(one.source_name for one in kept),
        velocity=_velocities(kept),
        occlusion=_occlusions(kept),
        num_points=_counts(kept),
        ignored=tuple(one.ignored for one in kept) if any(one.ignored for one in kept) else None,
    )


def box_of_document(
    centre: Mapping[str, Any],
    size: Mapping[str, Any],
    yaw: Any,  # noqa: ANN401 - whatever JSON holds
    sides: Sequence[str] = ("length", "width", "height"),
) -> Box:
    """Return a box of a document: centre by x, y, z, size by the names of its sides, and yaw.

    Raises:
        ValueError, KeyError, TypeError: a value is missing or not a number.
    """
    x, y, z = (float(centre[axis]) for axis in "xyz")
    length, width, height = (float(size[side]) for side in sides)
    return x, y, z, length, width, height, float(yaw)


def _counts(labelled: Sequence[LabelledBox]) -> NDArray[np.int64] | None:
    found = np.array([one.num_points for one in labelled], np.int64)
    return None if (found < 0).all() else found


def _occlusions(labelled: Sequence[LabelledBox]) -> NDArray[np.float64] | None:
    found = np.array([one.occlusion for one in labelled], np.float64)
    return None if np.isnan(found).all() else found


def _velocities(labelled: Sequence[LabelledBox]) -> NDArray[np.float64] | None:
    if all(one.velocity is None for one in labelled):
        return None
    return np.array([one.velocity or (np.nan,) * 3 for one in labelled], np.float64)


def pose_of_quaternion(w: float, x: float, y: float, z: float, place: ArrayLike) -> Pose:
    """Return the pose of a quaternion (any length but 0) and a place (3,) in metres.

    Raises:
        ValueError: the quaternion is zero or not finite.
    """
    quaternion = np.array([w, x, y, z], np.float64)
    length = np.linalg.norm(quaternion)
    if not np.isfinite(length) or length < 1e-9:
        raise ValueError(f"({w:g}, {x:g}, {y:g}, {z:g}) is not a rotation")
    w, x, y, z = quaternion / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return checked_pose(rotation, place)


def checked_pose(rotation: ArrayLike, place: ArrayLike) -> Pose:
    """Return the pose of a rotation (3, 3) and a place (3,) in metres.

    Raises:
        ValueError: the first is not a rotation, or a number is not finite.
    """
    turn, at = np.asarray(rotation, np.float64), np.asarray(place, np.float64)
    if turn.size != 9 or at.size != 3:
        raise ValueError(f"{turn.size} and {at.size} numbers are not a pose")
    turn, at = turn.reshape(3, 3), at.reshape(3)
    if not np.isfinite(at).all() or np.abs(at).max() > _FURTHEST_M:
        raise ValueError("a place that is not finite, or too far away")
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(turn @ turn.T - np.eye(3)).max()
    if not off < _ROUND or np.linalg.det(turn) < 0:
        raise ValueError("a matrix that is not a rotation")
    return Pose(turn, at)


def heading(rotation: NDArray[np.float64]) -> float:
    """Return the yaw in radians of what a rotation (3, 3) turns the x axis to, seen from above."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))
