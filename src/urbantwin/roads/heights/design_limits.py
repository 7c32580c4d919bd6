"""Geometric design limits by class and speed: grades, vertical curves, superelevation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urbantwin.roads.model import ModelRoad

__all__ = ["Limits", "limits_of"]

#: Steepest grade by class (AASHTO, A Policy on Geometric Design of Highways and Streets, 2018:
#: freeways table 8-1, arterials table 7-4, collectors table 6-8, local streets 5.3.2.3).
GRADE = {
    "motorway": 0.06,
    "motorway_link": 0.07,
    "trunk": 0.07,
    "trunk_link": 0.08,
    "primary": 0.09,
    "primary_link": 0.09,
    "secondary": 0.10,
    "secondary_link": 0.10,
    "tertiary": 0.12,
    "tertiary_link": 0.12,
}
GRADE_OF_LOCAL_STREETS = 0.15
#: Largest superelevation by class (the same, 3.3.3.2: 4 to 6 % in towns, 8 % on freeways).
BANK = {"motorway": 0.08, "motorway_link": 0.08, "trunk": 0.06, "trunk_link": 0.06}
BANK_OF_STREETS = 0.06
#: Design speeds, km/h, and the rates of vertical curvature K there: metres of curve per percent of
#: change in grade, on crests (the same, table 3-35) and in sags (table 3-37).
SPEEDS = (20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130)
CREST_K = (1, 2, 4, 7, 11, 17, 26, 39, 52, 74, 95, 124)
SAG_K = (3, 6, 9, 13, 18, 23, 30, 38, 45, 55, 63, 73)


@dataclass(frozen=True)
class Limits:
    """Limits of a street's geometric design.

    Attributes:
        grade: steepest grade.
        crest: strongest curvature of a crest in the profile, 1/m.
        sag: strongest curvature of a sag, 1/m.
        bank: steepest superelevation.
    """

    grade: float
    crest: float
    sag: float
    bank: float


def limits_of(road: ModelRoad) -> Limits:
    """Return the limits for a road's class and for the highest speed on it."""
    limit = max((lane.speed_limit for x in road.sections for lane in x.lanes), default=0.0)
    speed = (limit or 50.0 / 3.6) * 3.6
    return Limits(
        grade=GRADE.get(road.kind, GRADE_OF_LOCAL_STREETS),
        crest=0.01 / float(np.interp(speed, SPEEDS, CREST_K)),
        sag=0.01 / float(np.interp(speed, SPEEDS, SAG_K)),
        bank=BANK.get(road.kind, BANK_OF_STREETS),
    )
