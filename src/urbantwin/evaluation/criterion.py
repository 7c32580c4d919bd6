"""When a detection has found an object: by what they have in common, or by how near they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from urbantwin.detections import DETECTED_CLASSES, LARGE, MEMBERS

__all__ = ["CRITERIA", "ERRORS_WITHIN_M", "JUDGED", "Criterion", "near", "overlapping"]

#: What reports judge: every detector's class, and all large vehicles as one.
JUDGED: dict[str, tuple[str, ...]] = {**MEMBERS, "large": LARGE}


@dataclass(frozen=True)
class Criterion:
    """A condition that a detection and an object meet or do not.

    Attributes:
        measure: intersection over union in plan or in space, or the distance of centres in plan.
        limit: at least this much in common, or at most so far away, metres.
    """

    measure: Literal["bev_iou", "iou_3d", "distance_m"]
    limit: float

    @property
    def name(self) -> str:
        """What it is called in reports: ``bev_iou_0.5``, ``within_1_m``."""
        if self.measure == "distance_m":
            return f"within_{self.limit:g}_m"
        return f"{self.measure}_{self.limit:g}"


#: IoU as KITTI and challenges of roadside data have it, distances as nuScenes and Argoverse 2.
CRITERIA: tuple[Criterion, ...] = (
    *(Criterion("bev_iou", limit) for limit in (0.3, 0.5, 0.7)),
    *(Criterion("iou_3d", limit) for limit in (0.3, 0.5, 0.7)),
    *(Criterion("distance_m", limit) for limit in (0.5, 1.0, 2.0, 4.0)),
)

#: Errors of place, size and heading are those of detections as near as this (as with nuScenes).
ERRORS_WITHIN_M = 2.0

_LARGE_CLASSES = ("truck", "bus", "large")
assert set(_LARGE_CLASSES) <= {*DETECTED_CLASSES, "large"}


def near(class_name: str) -> Criterion:
    """Return the distance that breakdowns, false alarms and misses of a class go by."""
    return Criterion("distance_m", 2.0 if class_name in _LARGE_CLASSES else 1.0)


def overlapping() -> Criterion:
    """Return the overlap that breakdowns go by."""
    return Criterion("bev_iou", 0.5)
