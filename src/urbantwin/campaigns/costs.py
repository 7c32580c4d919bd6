"""What steps cost: measured by those that a campaign has made, else reckoned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from urbantwin.campaigns.course import Course
from urbantwin.campaigns.steps import KINDS

__all__ = ["Cost", "Plan", "costs_of", "planned", "share_done"]

#: Seconds of one processor for a twin, for a second of traffic, and for a ray of a frame; bytes of
#: a ray, points as ``npy``. Where nothing was measured: docs/scale.md has what they are from.
_RECKONED = {"twin": (60.0, 0.0), "motion": (0.5, 0.0), "dataset": (4e-7, 17.0)}
#: What of the bytes is left by other storages.
_LEFT = {"npy": 1.0, "zstd": 0.36, "laz": 0.2}


@dataclass(frozen=True)
class Cost:
    """What a unit of the work of a kind of step costs, see `Step.work`.

    Attributes:
        seconds: of one processor.
        size: bytes.
    """

    seconds: float
    size: float


@dataclass(frozen=True)
class Plan:
    """What is left of a campaign, and what it takes.

    Attributes:
        steps: how many of a kind are left.
        frames: that are left.
        seconds: of one processor.
        size: bytes.
        measured: so many steps of a kind were measured.
    """

    steps: dict[str, int]
    frames: int
    seconds: float
    size: float
    measured: dict[str, int]


def costs_of(course: Course) -> dict[str, Cost]:
    """Return what each kind of step costs: as measured, or else as reckoned."""
    found = {}
    for kind, measured in course.measured.items():
        seconds, size = _RECKONED[kind]
        found[kind] = Cost(seconds, size * _LEFT[course.steps.asked.storage])
        if measured.work and measured.seconds:
            found[kind] = Cost(measured.seconds / measured.work, measured.size / measured.work)
    return found


def planned(course: Course) -> Plan:
    """Return what steps take that are to be made."""
    costs = costs_of(course)
    frames = sum(one.size for one in course.to_make if one.kind == "dataset")
    return Plan(
        {kind: sum(one.kind == kind for one in course.to_make) for kind in KINDS},
        int(frames),
        sum(course.work[kind] * costs[kind].seconds for kind in KINDS),
        sum(course.work[kind] * costs[kind].size for kind in KINDS),
        {kind: course.measured[kind].steps for kind in KINDS},
    )


def share_done(course: Course, under_way: Mapping[str, float]) -> float:
    """Return the share of a run's work that is done, by what it costs.

    Args:
        course: of the run.
        under_way: of steps that are being made the share of each that is done, by place.
    """
    costs = costs_of(course)
    total = sum(course.work[kind] * costs[kind].seconds for kind in KINDS)
    done = sum(course.gone[kind] * costs[kind].seconds for kind in KINDS)
    for place, share in under_way.items():
        step = course.steps.all[place]
        done += share * step.work * costs[step.kind].seconds
    return min(done / total, 1.0) if total else 1.0
