"""Measures of layouts, ours and published ones, with their sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["LEVELS", "MEASURES", "SURROGATES", "Measure", "least_expected"]

#: Minimum numbers of points in a frame for an object to count as seen, at three levels.
LEVELS = (5, 20, 50)


def least_expected(level: int) -> float:
    """Return the expected number of points at which the most likely number reaches a level.

    Most beams return with a probability near 0 or 1, so the number is close to the expected one.
    """
    return level - 0.5


@dataclass(frozen=True)
class Measure:
    """A measure of a layout.

    Attributes:
        more: whether a higher value is better.
        unit: unit of its values; empty for shares and numbers.
        meaning: meaning in words.
        source: publication; empty for ours.
        sampled: whether it is a mean over actors, which has an interval.
    """

    more: bool
    unit: str
    meaning: str
    source: str = ""
    sampled: bool = False

    @property
    def direction(self) -> Literal["maximize", "minimize"]:
        """Direction as named by optuna."""
        return "maximize" if self.more else "minimize"


_HU = (
    "Hu et al. 2022, Investigating the Impact of Multi-LiDAR Placement on Object Detection for "
    "Autonomous Driving, CVPR (S-MIG)"
)
_CAI = (
    "Cai et al. 2023, Analyzing Infrastructure LiDAR Placement with Realistic LiDAR Simulation "
    "Library, ICRA"
)
_YU = "Yu et al. 2018, PU-Net, CVPR (the coefficient)"

MEASURES: dict[str, Measure] = {
    "cost": Measure(False, "", "price of sensors, brackets and new poles"),
    "points": Measure(True, "points", "mean points on an actor in a frame", sampled=True),
    **{
        f"seen_{level}": Measure(
            True,
            "",
            f"share of actor-seconds with at least {level} points in a frame",
            sampled=True,
        )
        for level in LEVELS
    },
    "seen_5_one_failed": Measure(
        True, "", "seen_5 when the sensor fails that is missed most", sampled=True
    ),
    "seen_5_by_two": Measure(
        True, "", "share of actor-seconds with at least 5 points from each of two", sampled=True
    ),
    "unseen_mean_s": Measure(
        False, "s", "mean over actors of the longest time with fewer than 5 points", sampled=True
    ),
    "unseen_longest_s": Measure(False, "s", "longest time of any actor with fewer than 5 points"),
    "blind_m2": Measure(False, "m2", "lanes and crossings that no sensor has in sight"),
    "blind_crossings_m2": Measure(False, "m2", "crossings that no sensor has in sight"),
    "entropy_nats": Measure(
        True, "nats", "entropy of the occupancy of the voxels that beams pass", _HU
    ),
    "density_per_m2": Measure(True, "points/m2", "points on the junction's ground per area", _CAI),
    "nuc": Measure(
        False, "", "normalised uniformity coefficient of these points", f"{_CAI}; {_YU}"
    ),
}
#: Measures that represent the precision of a detector: published, then ours.
SURROGATES = (
    "entropy_nats",
    "density_per_m2",
    "nuc",
    "points",
    *(f"seen_{level}" for level in LEVELS),
    "seen_5_by_two",
    "unseen_mean_s",
    "blind_m2",
)
