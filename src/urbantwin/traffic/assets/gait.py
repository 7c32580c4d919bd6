"""Walking: the posture of a figure at a part of its gait cycle."""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from urbantwin.traffic.assets.person import Figure, Posture

__all__ = ["joint_angles", "stride_length", "walking"]

#: The arm swings against the leg of its side; shoulder about -25..+10 degrees and elbow about
#: 15..45 degrees at natural speed (Murray, Sepic and Barnard 1967, Phys. Ther. 47(4)).
SHOULDER_MEAN, SHOULDER_SWING = np.radians(-6.0), np.radians(21.0)
ELBOW_MEAN, ELBOW_SWING = np.radians(30.0), np.radians(13.0)
ABDUCTION = np.radians(7.0)


@cache
def _curves() -> CubicSpline:
    lines = files(__package__).joinpath("gait.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    part = [float(row["percent"]) / 100 for row in rows]
    angle = [[float(row[joint]) for joint in ("thigh", "knee", "ankle")] for row in rows]
    return CubicSpline([*part, 1.0], np.radians([*angle, angle[0]]), bc_type="periodic")


def joint_angles(part: float) -> NDArray[np.float64]:
    """Return thigh angle, knee flexion and dorsiflexion (3,), rad, at a part 0..1 of the cycle."""
    return np.asarray(_curves()(part % 1.0))


def walking(figure: Figure, part: float) -> Posture:
    """Return the posture at a part 0..1 of the gait cycle: 0 is the left heel's contact.

    The pelvis stands over x = y = 0; the lower foot's sole is near z = 0.
    """
    legs = np.array([_leg(figure, part, 1.0), _leg(figure, part + 0.5, -1.0)])
    arms = np.array([_arm(figure, part, 1.0), _arm(figure, part + 0.5, -1.0)])
    neck = np.array([0.01 * figure.stature, 0.0, figure.length("trunk")])
    posture = Posture(np.zeros(3), neck, 0.05, legs, arms)
    return posture.moved([0.0, 0.0, -legs[:, 3, 2].min()])


def stride_length(figure: Figure) -> float:
    """Return the distance walked in a gait cycle, metres.

    The pelvis advances by as much as the sole that carries the figure (the lowest place of heels
    and balls) falls back under it, so over a cycle the feet do not slip.
    """
    parts = np.linspace(0.0, 1.0, 241)
    soles = np.array([np.vstack([_sole(figure, p), _sole(figure, p + 0.5)]) for p in parts])
    lowest = soles[:-1, :, 1].argmin(axis=1)
    steps = np.arange(len(lowest))
    return float((soles[steps, lowest, 0] - soles[steps + 1, lowest, 0]).sum())


def _sole(figure: Figure, part: float) -> NDArray[np.float64]:
    """Return x and z (2, 2) of the left heel and ball, from the hip."""
    tip = _leg(figure, part, 1.0)[3]
    thigh, knee, ankle = joint_angles(part)
    ahead = _ahead(thigh - knee + ankle)
    heel = tip - (0.72 * figure.length("foot") + 0.043 * figure.stature) * ahead
    ball = tip - 0.02 * figure.stature * ahead
    return np.array([heel[[0, 2]], ball[[0, 2]]])


def _leg(figure: Figure, part: float, side: float) -> NDArray[np.float64]:
    hip_flexion, knee_flexion, dorsiflexion = joint_angles(part)
    hip = np.array([0.0, side * figure.length("hip"), 0.0])
    knee = hip + figure.length("thigh") * _down(hip_flexion)
    shank = hip_flexion - knee_flexion
    ankle = knee + figure.length("shank") * _down(shank)
    foot = shank + dorsiflexion
    ahead = _ahead(foot)
    up = np.array([-np.sin(foot), 0.0, np.cos(foot)])
    tip = ankle + 0.72 * figure.length("foot") * ahead - figure.length("ankle") * up
    return np.array([hip, knee, ankle, tip])


def _arm(figure: Figure, part: float, side: float) -> NDArray[np.float64]:
    swing = -np.cos(2 * np.pi * part)
    flexion = SHOULDER_MEAN + SHOULDER_SWING * swing
    elbow_flexion = ELBOW_MEAN + ELBOW_SWING * swing
    shoulder = np.array(
        [0.01 * figure.stature, side * figure.length("shoulder"), 0.97 * figure.length("trunk")]
    )
    out = np.array([0.0, side * np.sin(ABDUCTION), 0.0])
    elbow = shoulder + figure.length("upper-arm") * _unit(_down(flexion) + out)
    forearm = _unit(_down(flexion + elbow_flexion) + 0.3 * out)
    wrist = elbow + figure.length("forearm") * forearm
    return np.array([shoulder, elbow, wrist, wrist + figure.length("hand") * forearm])


def _down(angle: float) -> NDArray[np.float64]:
    """Return the direction of a segment that hangs down, swung forward by an angle."""
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def _ahead(angle: float) -> NDArray[np.float64]:
    """Return the direction of a foot whose toes point up by an angle."""
    return np.array([np.cos(angle), 0.0, np.sin(angle)])


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / np.linalg.norm(vector))
