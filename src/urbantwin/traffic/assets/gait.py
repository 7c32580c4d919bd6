"""Gait: the posture of a walking figure at a fraction of its gait cycle."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.assets.person import Figure, Posture, bent, figure_solids
from urbantwin.traffic.assets.solid import Solid, capsule, ellipsoid, loft, superellipse

__all__ = [
    "BESIDE_M",
    "DOG_PHASES",
    "GAIT_PHASES",
    "dog",
    "dog_stride",
    "joint_angles",
    "phase_part",
    "standing",
    "stride_length",
    "walker",
    "walking",
]

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


#: Number of postures of a gait cycle.
GAIT_PHASES = 12

#: The arm swings opposite to the leg of its side; shoulder about -25..+10 degrees and elbow about
#: 15..45 degrees at natural speed (Murray, Sepic and Barnard 1967, Phys. Ther. 47(4)).
SHOULDER_MEAN, SHOULDER_SWING = np.radians(-6.0), np.radians(21.0)
ELBOW_MEAN, ELBOW_SWING = np.radians(30.0), np.radians(13.0)
ABDUCTION = np.radians(7.0)
#: Shoulder and elbow angles of a person pushing an object at waist height (assumed).
PUSHING = np.radians(28.0), np.radians(50.0)


@cache
def _curves() -> CubicSpline:
    from scipy.interpolate import CubicSpline

    lines = files(__package__).joinpath("gait.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    part = [float(row["percent"]) / 100 for row in rows]
    angle = [[float(row[joint]) for joint in ("thigh", "knee", "ankle")] for row in rows]
    return CubicSpline([*part, 1.0], np.radians([*angle, angle[0]]), bc_type="periodic")


def joint_angles(part: float) -> NDArray[np.float64]:
    """Return thigh angle, knee flexion and dorsiflexion (3,), rad, at 0..1 of the cycle."""
    return np.asarray(_curves()(part % 1.0))


def walking(figure: Figure, part: float) -> Posture:
    """Return the posture at a fraction 0..1 of the gait cycle: 0 is the left heel's contact.

    The pelvis is at x = y = 0; the lower foot's sole is near z = 0.
    """
    legs = np.array([_leg(figure, part, 1.0), _leg(figure, part + 0.5, -1.0)])
    arms = np.array([_arm(figure, part, 1.0), _arm(figure, part + 0.5, -1.0)])
    return _upright(figure, legs, arms)


def _upright(figure: Figure, legs: NDArray[np.float64], arms: NDArray[np.float64]) -> Posture:
    neck = np.array([0.01 * figure.stature, 0.0, figure.length("trunk")])
    posture = Posture(np.zeros(3), neck, 0.05, legs, arms)
    return posture.moved([0.0, 0.0, -legs[:, 3, 2].min()])


def standing(figure: Figure) -> Posture:
    """Return the posture of a standing figure: legs and arms down, feet side by side."""
    upright = np.array([0.02, 0.03, 0.01])
    legs = np.array([_limb(figure, upright, side) for side in (1.0, -1.0)])
    shoulder, elbow = PUSHING if figure.pushes else (0.02, 0.15)
    arms = np.array([_hanging(figure, shoulder, elbow, side) for side in (1.0, -1.0)])
    return _upright(figure, legs, arms)


def walker(figure: Figure, phase: int | None) -> list[Solid]:
    """Return the solids of a figure in a phase of its gait; ``None``: standing.

    The pelvis keeps its position in all of them, the lowest point is at z = 0, and the bounds of
    phase 0 are centred on the origin.
    """
    posture = standing(figure) if phase is None else walking(figure, phase_part(figure, phase))
    centred = [-_middle(figure), 0.0, 0.0]
    return [solid.moved(centred) for solid in _grounded(figure, posture)]


@cache
def _middle(figure: Figure) -> float:
    """Return x of the middle of the bounds in phase 0."""
    first = _grounded(figure, walking(figure, 0.0))
    x = np.concatenate([solid.vertices[:, 0] for solid in first])
    return float((x.min() + x.max()) / 2)


def _grounded(figure: Figure, posture: Posture) -> list[Solid]:
    solids = figure_solids(figure, posture)
    lowest = min(solid.vertices[:, 2].min() for solid in solids)
    return [solid.moved([0.0, 0.0, -lowest]) for solid in solids]


def stride_length(figure: Figure) -> float:
    """Return the distance walked in a gait cycle without slipping, metres."""
    return float(2 * _advance(figure)[1][-1])


def phase_part(figure: Figure, phase: int) -> float:
    """Return the fraction of the gait cycle of a phase.

    Phases are evenly spaced in distance, not in time, so that a figure moved at constant speed
    keeps its supporting foot in place, although real pedestrians vary their speed within a step.
    """
    parts, advance = _advance(figure)
    half = GAIT_PHASES // 2
    part = np.interp(phase % half / half * advance[-1], advance, parts)
    return float(part) + (0.5 if phase % GAIT_PHASES >= half else 0.0)


@cache
def _advance(figure: Figure) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return fractions of the first half of the cycle, and the pelvis' advance at each, metres.

    The pelvis advances by as much as the supporting sole (the lowest of heels and balls) moves back
    under it.
    """
    parts = np.linspace(0.0, 0.5, 121)
    soles = np.array([np.vstack([_sole(figure, p), _sole(figure, p + 0.5)]) for p in parts])
    lowest = soles[:-1, :, 1].argmin(axis=1)
    steps = np.arange(len(lowest))
    back = soles[steps, lowest, 0] - soles[steps + 1, lowest, 0]
    return parts, np.concatenate([[0.0], np.cumsum(back)])


def _sole(figure: Figure, part: float) -> NDArray[np.float64]:
    """Return x and z (2, 2) of the left heel and ball, from the hip."""
    tip = _leg(figure, part, 1.0)[3]
    thigh, knee, ankle = joint_angles(part)
    ahead = _ahead(thigh - knee + ankle)
    heel = tip - (0.72 * figure.length("foot") + 0.043 * figure.stature) * ahead
    ball = tip - 0.02 * figure.stature * ahead
    return np.array([heel[[0, 2]], ball[[0, 2]]])


def _leg(figure: Figure, part: float, side: float) -> NDArray[np.float64]:
    return _limb(figure, joint_angles(part), side)


def _limb(figure: Figure, angles: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    """Return hip, knee, ankle and toes (4, 3) of a leg with the given joint angles."""
    hip_flexion, knee_flexion, dorsiflexion = angles
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
    if figure.pushes:
        return _hanging(figure, *PUSHING, side)
    swing = -np.cos(2 * np.pi * part)
    flexion = SHOULDER_MEAN + SHOULDER_SWING * swing
    return _hanging(figure, flexion, ELBOW_MEAN + ELBOW_SWING * swing, side)


def _hanging(
    figure: Figure, flexion: float, elbow_flexion: float, side: float
) -> NDArray[np.float64]:
    """Return shoulder, elbow, wrist and fingertips (4, 3) of an arm that hangs down."""
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


#: Number of postures of a stride; offset ahead of and beside its owner, metres (a short lead).
DOG_PHASES, BESIDE_M = 12, (0.15, 0.60)
#: Share of the stride in which a foot is on the ground, and stride length in heights at the
#: withers.
_DUTY, _STRIDE = 0.66, 1.55
#: Ground contact of each foot, fractions of the stride: hind left, fore left, hind right, fore
#: right.
_FEET = ((-1, 1, 0.0), (1, 1, 0.25), (-1, -1, 0.5), (1, -1, 0.75))
_HEIGHT_M = 0.56  # height of the dimensions below


def dog_stride(entry: Mapping[str, Any]) -> float:
    """Return the length of a dog's stride, metres."""
    return float(_STRIDE * entry["withers"])


def dog(entry: Mapping[str, Any], phase: int | None) -> list[Solid]:
    """Return the solids of a dog in a phase of its stride; ``None``: standing."""
    solids = [*_dog_body(), *_dog_head()]
    stride = _STRIDE * _HEIGHT_M
    for fore, side, begins in _FEET:
        place, lift = 0.0, 0.0
        if phase is not None:
            place, lift = _foot(phase / DOG_PHASES - begins, stride)
        solids += _dog_leg(fore, side, place, lift)
    factor = entry["withers"] / _HEIGHT_M
    solids = [solid.scaled([factor] * 3) for solid in solids]
    low = min(float(solid.vertices[:, 2].min()) for solid in solids)
    return [solid.moved([0.0, 0.0, -low]) for solid in solids]


def _foot(part: float, stride: float) -> tuple[float, float]:
    """Return a foot's offset ahead of its shoulder, and its height, at a fraction of its stride."""
    now = part % 1.0
    if now < _DUTY:
        return stride * (_DUTY / 2 - now), 0.0
    swing = (now - _DUTY) / (1 - _DUTY)
    ahead = -_DUTY / 2 + _DUTY * (1 - np.cos(np.pi * swing)) / 2
    return float(stride * ahead), float(0.07 * np.sin(np.pi * swing))


def _dog_leg(fore: int, side: int, place: float, lift: float) -> list[Solid]:
    """Return a leg with its foot at an offset and height."""
    x, y = (0.20, 0.075) if fore > 0 else (-0.26, 0.08)
    upper, lower = (0.24, 0.27) if fore > 0 else (0.25, 0.29)
    top = np.array([x, side * y, 0.40 if fore > 0 else 0.42])
    foot = np.array([x + place + 0.02, side * (y - 0.01), 0.03 + lift])
    reach = foot - top
    far = float(np.linalg.norm(reach))
    if far > upper + lower - 0.005:
        foot = top + reach * ((upper + lower - 0.005) / far)
    # The elbow points back, the stifle forward.
    joint = bent(top, foot, upper, lower, [-float(fore), 0.0, 0.0])
    thick = (0.045, 0.028) if fore > 0 else (0.065, 0.030)
    paw = foot + [0.02, 0.0, 0.0]
    return [
        capsule(top, joint, thick[0], thick[1], "cloth", sides=8),
        capsule(joint, foot, thick[1], 0.020, "cloth", sides=8),
        ellipsoid([0.042, 0.028, 0.026], paw, "cloth", sides=8, rings=4),
    ]


def _dog_body() -> list[Solid]:
    """Return the trunk from the rump to the chest, and the tail."""
    # Position ahead, height of the middle, half height, half width.
    stations = (
        (-0.37, 0.47, 0.03, 0.03),
        (-0.34, 0.46, 0.09, 0.085),
        (-0.22, 0.455, 0.115, 0.11),
        (-0.05, 0.455, 0.105, 0.105),
        (0.12, 0.43, 0.135, 0.12),
        (0.24, 0.43, 0.135, 0.11),
        (0.31, 0.46, 0.09, 0.075),
        (0.33, 0.47, 0.03, 0.03),
    )
    sections: list[NDArray[np.float64]] = []
    for x, z, high, wide in stations:
        oval = superellipse(wide, high, sides=14, power=2.2)
        sections.append(np.column_stack([np.full(len(oval), x), oval[:, 0], z + oval[:, 1]]))
    tail = capsule([-0.36, 0, 0.50], [-0.56, 0, 0.42], 0.028, 0.014, "cloth", sides=8)
    return [loft(sections, "cloth"), tail]


def _dog_head() -> list[Solid]:
    """Return neck, skull, muzzle and ears, and a collar with a tag."""
    solids = [
        capsule([0.25, 0, 0.50], [0.40, 0, 0.64], 0.085, 0.065, "cloth", sides=10),
        ellipsoid([0.10, 0.075, 0.075], [0.45, 0, 0.675], "cloth", sides=12, rings=6),
        capsule([0.50, 0, 0.66], [0.60, 0, 0.64], 0.048, 0.036, "cloth", sides=10),
        capsule([0.325, 0, 0.575], [0.345, 0, 0.595], 0.088, 0.086, "rubber", sides=10),
    ]
    ear = ellipsoid([0.035, 0.012, 0.055], [0.42, 0.082, 0.665], "cloth", sides=8, rings=4)
    return [*solids, ear, ear.mirrored()]
