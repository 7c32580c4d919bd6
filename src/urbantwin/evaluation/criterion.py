"""Criteria by which a detection matches an object: overlap, or distance of centres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from urbantwin.detections import DETECTED_CLASSES, LARGE, MEMBERS

__all__ = ["CRITERIA", "ERRORS_WITHIN_M", "JUDGED", "Criterion", "near", "overlapping"]

#: Evaluated classes: all detector classes, and all large vehicles as one.
JUDGED: dict[str, tuple[str, ...]] = {**MEMBERS, "large": LARGE}


@dataclass(frozen=True)
class Criterion:
    """A condition for a detection to match an object.

    Attributes:
        measure: intersection over union in plan or in space, or the distance of centres in plan.
        limit: minimum overlap, or maximum distance in metres.
    """

    measure: Literal["bev_iou", "iou_3d", "distance_m"]
    limit: float

    @property
    def name(self) -> str:
        """Name in reports: ``bev_iou_0.5``, ``within_1_m``."""
        if self.measure == "distance_m":
            return f"within_{self.limit:g}_m"
        return f"{self.measure}_{self.limit:g}"


#: IoU as in KITTI and roadside challenges, distances as in nuScenes and Argoverse 2.
CRITERIA: tuple[Criterion, ...] = (
    *(Criterion("bev_iou", limit) for limit in (0.3, 0.5, 0.7)),
    *(Criterion("iou_3d", limit) for limit in (0.3, 0.5, 0.7)),
    *(Criterion("distance_m", limit) for limit in (0.5, 1.0, 2.0, 4.0)),
)

#: Errors of position, size and heading use detections within this distance (as in nuScenes).
ERRORS_WITHIN_M = 2.0

_LARGE_CLASSES = ("truck", "bus", "large")
assert set(_LARGE_CLASSES) <= {*DETECTED_CLASSES, "large"}


def near(class_name: str) -> Criterion:
    """Return the distance criterion for breakdowns, false alarms and misses of a class."""
    return Criterion("distance_m", 2.0 if class_name in _LARGE_CLASSES else 1.0)


def overlapping() -> Criterion:
    """Return the overlap criterion for breakdowns."""
    return Criterion("bev_iou", 0.5)
