"""Conversion of datasets' labels to ours: classes, boxes, tracks, rotations."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Boxes

__all__ = [
    "Box",
    "LabelledBox",
    "actor_class",
    "box_of_document",
    "boxes_of",
    "letters",
    "track_of",
]

#: Centre x, y, z, length, width, height (metres) and yaw (radians).
Box = tuple[float, float, float, float, float, float, float]

#: Names of our classes in datasets, as returned by `letters`. In datasets without vans (nuScenes,
#: Argoverse 2), they are among the cars.
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
_CLASS_OF = {name: ours for ours, names in _CALLED.items() for name in names.split()}


def actor_class(source_name: str) -> str:
    """Return our class for a dataset's class name, ``other`` if there is none."""
    return _CLASS_OF.get(letters(source_name), "other")


def letters(source_name: str) -> str:
    """Return a class name in lower case, reduced to letters."""
    return re.sub(r"[^a-z]", "", source_name.lower())


def track_of(identity: str) -> int:
    """Return a 62-bit number for an object's identity: the same in every frame and run."""
    return int.from_bytes(hashlib.sha256(identity.encode()).digest()[:8], "little") >> 2


@dataclass(frozen=True)
class LabelledBox:
    """A labelled object: a row of `Boxes`; -1, NaN, None and "" represent missing values."""

    box: Box
    source_name: str
    track: int = -1
    velocity: tuple[float, float, float] | None = None
    occlusion: float = math.nan
    num_points: int = -1
    ignored: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError for a number beyond 64 bits, which readers report with the line."""
        for what, number in (("a track", self.track), ("a number of points", self.num_points)):
            if not -(2**63) <= number < 2**63:
                raise ValueError(f"{str(number)[:40]} is not {what}")


def boxes_of(labelled: Sequence[LabelledBox]) -> Boxes:
    """Return labelled objects as one table, without those with an infinite position or size."""
    kept = [label for label in labelled if np.isfinite(label.box).all() and min(label.box[3:6]) > 0]
    return Boxes(
        box=np.array([label.box for label in kept], np.float64).reshape(-1, 7),
        class_names=tuple(actor_class(label.source_name) for label in kept),
        track=np.array([label.track for label in kept], np.int64),
        source_names=tuple(label.source_name for label in kept),
        velocity=_velocities(kept),
        occlusion=_occlusions(kept),
        num_points=_counts(kept),
        ignored=tuple(label.ignored for label in kept)
        if any(label.ignored for label in kept)
        else None,
    )


def box_of_document(
    centre: Mapping[str, Any],
    size: Mapping[str, Any],
    yaw: Any,  # noqa: ANN401 - any JSON
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
    found = np.array([label.num_points for label in labelled], np.int64)
    return None if (found < 0).all() else found


def _occlusions(labelled: Sequence[LabelledBox]) -> NDArray[np.float64] | None:
    found = np.array([label.occlusion for label in labelled], np.float64)
    return None if np.isnan(found).all() else found


def _velocities(labelled: Sequence[LabelledBox]) -> NDArray[np.float64] | None:
    if all(label.velocity is None for label in labelled):
        return None
    return np.array([label.velocity or (np.nan,) * 3 for label in labelled], np.float64)
