"""A clothed human figure in a posture: tapered capsules for limbs, lofts for trunk and shoes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.traffic.assets.solid import Solid, capsule, ellipsoid, loft, superellipse

__all__ = ["Figure", "Posture", "bent", "figure_solids"]


@dataclass(frozen=True)
class Figure:
    """A person's build.

    Segment lengths are shares of stature by Drillis and Contini (1966), as printed in Winter,
    Biomechanics and Motor Control of Human Movement, 4th ed. 2009, figure 4.1.

    Attributes:
        stature: standing height in shoes, metres.
        girth: factor on the thickness of trunk and limbs (winter clothes, children).
        head: factor on the head's size (a child's head is larger relative to its stature).
        coat: length of a coat or skirt below the hip, as a share of the thigh; 0 for none.
        backpack: whether the person carries one.
        helmet: whether the person wears one.
        pushes: whether both hands hold an object in front.
    """

    stature: float
    girth: float = 1.0
    head: float = 1.0
    coat: float = 0.0
    backpack: bool = False
    helmet: bool = False
    pushes: bool = False

    def length(self, segment: str) -> float:
        """Return a segment's length in metres."""
        return SEGMENTS[segment] * self.stature


#: Segment lengths and joint offsets as shares of stature.
SEGMENTS = {
    "thigh": 0.245,
    "shank": 0.246,
    "ankle": 0.039,
    "foot": 0.152,
    "trunk": 0.288,
    "upper-arm": 0.186,
    "forearm": 0.146,
    "hand": 0.085,
    "shoulder": 0.115,
    "hip": 0.052,
    "neck": 0.045,
    "head": 0.137,
}


@dataclass(frozen=True, eq=False)
class Posture:
    """Joint positions, metres, asset frame; first index of limbs: left, right.

    Attributes:
        pelvis: (3,) midway between the hip joints.
        neck: (3,) midway between the shoulder joints.
        gaze: pitch of the head, rad, positive down.
        legs: (2, 4, 3) hip, knee, ankle, tip of the toes.
        arms: (2, 4, 3) shoulder, elbow, wrist, tip of the fingers.
    """

    pelvis: NDArray[np.float64]
    neck: NDArray[np.float64]
    gaze: float
    legs: NDArray[np.float64]
    arms: NDArray[np.float64]

    def moved(self, offset: ArrayLike) -> Posture:
        """Return the posture shifted by (3,) metres."""
        by = np.asarray(offset, np.float64)
        return replace(
            self,
            pelvis=self.pelvis + by,
            neck=self.neck + by,
            legs=self.legs + by,
            arms=self.arms + by,
        )


def bent(
    start: ArrayLike, end: ArrayLike, upper: float, lower: float, towards: ArrayLike
) -> NDArray[np.float64]:
    """Return the middle joint (3,) of a two-bone limb between two ends.

    Args:
        start: hip or shoulder (3,).
        end: ankle or wrist (3,).
        upper: length of the first bone, metres.
        lower: length of the second, metres.
        towards: direction (3,) in which the joint points.

    Raises:
        ValueError: the ends are farther apart than the bones reach.
    """
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    span = float(np.linalg.norm(b - a))
    if span > upper + lower:
        raise ValueError(f"a limb of {upper + lower:.3f} m cannot reach {span:.3f} m")
    axis = (b - a) / span
    along = (span**2 + upper**2 - lower**2) / (2 * span)
    out = np.asarray(towards, np.float64)
    out = out - axis * (out @ axis)
    out /= np.linalg.norm(out)
    return np.asarray(a + axis * along + out * np.sqrt(max(upper**2 - along**2, 0.0)))


def figure_solids(figure: Figure, posture: Posture) -> list[Solid]:
    """Return the closed solids of a figure: trunk, neck, head, arms, hands, legs, shoes."""
    solids = [_trunk(figure, posture), *_head(figure, posture)]
    left = [*_leg(figure, posture.legs[0]), *_arm(figure, posture.arms[0])]
    # The right side is built as a mirrored left one, so that both are bit-identical.
    flip = np.array([1.0, -1.0, 1.0])
    right = [*_leg(figure, posture.legs[1] * flip), *_arm(figure, posture.arms[1] * flip)]
    solids += left + [solid.mirrored() for solid in right]
    if figure.coat:
        solids.append(_coat(figure, posture))
    if figure.backpack:
        solids.append(_backpack(figure, posture))
    return solids


def _trunk_frame(posture: Posture) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the trunk's up and forward directions."""
    up = posture.neck - posture.pelvis
    up = up / np.linalg.norm(up)
    ahead = np.cross([0.0, 1.0, 0.0], up)
    return up, ahead / np.linalg.norm(ahead)


def _oval_section(
    centre: NDArray[np.float64], ahead: NDArray[np.float64], depth: float, half_width: float
) -> NDArray[np.float64]:
    """Return a section (14, 3) across the trunk."""
    flat = superellipse(depth, half_width, sides=14, power=2.4)
    return np.asarray(centre + flat[:, :1] * ahead + flat[:, 1:] * np.array([0.0, 1.0, 0.0]))


def _trunk(figure: Figure, posture: Posture) -> Solid:
    up, ahead = _trunk_frame(posture)
    h, g = figure.stature, figure.girth
    length = float(np.linalg.norm(posture.neck - posture.pelvis))
    # Share of the trunk's length, half depth, half width, shift ahead (shares of stature).
    levels = (
        (-0.16, 0.030, 0.055, 0.0),
        (-0.08, 0.060, 0.095, 0.0),
        (0.05, 0.068, 0.102, 0.0),
        (0.40, 0.060, 0.088, 0.004),
        (0.72, 0.070, 0.104, 0.004),
        (0.92, 0.058, 0.120, 0.0),
        (1.03, 0.040, 0.095, -0.004),
        (1.10, 0.026, 0.035, 0.0),
    )
    sections = [
        _oval_section(
            posture.pelvis + up * level * length + ahead * shift * h, ahead, d * h * g, w * h * g
        )
        for level, d, w, shift in levels
    ]
    return loft(sections, "cloth")


def _head(figure: Figure, posture: Posture) -> list[Solid]:
    up, ahead = _trunk_frame(posture)
    h, k = figure.stature, figure.head
    # The head is more upright than the trunk.
    lift = up * 0.5 + np.array([0.0, 0.0, 0.5])
    lift /= np.linalg.norm(lift)
    base = posture.neck + lift * figure.length("neck")
    centre = base + lift * (0.5 * SEGMENTS["head"] * h * k) + ahead * 0.012 * h
    c, s = np.cos(posture.gaze), np.sin(posture.gaze)
    nod = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    radii = np.array([0.056, 0.045, 0.0685]) * h * k
    solids = [
        capsule(posture.neck, base + lift * 0.02 * h, 0.034 * h, 0.030 * h, "skin", sides=8),
        ellipsoid(radii, [0, 0, 0], "skin", sides=12, rings=7).rotated(nod).moved(centre),
    ]
    if figure.helmet:
        shell = ellipsoid(radii * [1.3, 1.35, 1.0], [0, 0, 0], "metal-painted", sides=12, rings=7)
        solids.append(shell.rotated(nod).moved(centre + lift * 0.028 * h))
    return solids


def _arm(figure: Figure, joints: NDArray[np.float64]) -> list[Solid]:
    shoulder, elbow, wrist, tip = joints
    r = figure.stature * figure.girth
    return [
        capsule(shoulder, elbow, 0.034 * r, 0.027 * r, "cloth", sides=10),
        capsule(elbow, wrist, 0.027 * r, 0.019 * r, "cloth", sides=10),
        capsule(wrist, tip, 0.017 * r, 0.014 * r, "skin", sides=8),
    ]


def _leg(figure: Figure, joints: NDArray[np.float64]) -> list[Solid]:
    hip, knee, ankle, tip = joints
    r = figure.stature * figure.girth
    return [
        capsule(hip, knee, 0.052 * r, 0.035 * r, "cloth", sides=12),
        capsule(knee, ankle, 0.035 * r, 0.025 * r, "cloth", sides=12),
        _shoe(figure, ankle, tip),
    ]


def _shoe(figure: Figure, ankle: NDArray[np.float64], tip: NDArray[np.float64]) -> Solid:
    """Return a shoe: sections from heel to toe, with a flat sole.

    ``tip`` lies in the plane of the sole ahead; the ankle is ``ankle`` above the sole.
    """
    h = figure.stature
    rise, reach = figure.length("ankle"), 0.72 * figure.length("foot")
    # The sole's direction: the ankle is `rise` above it and the tip `reach` ahead on it.
    across = np.array([0.0, 1.0, 0.0])
    ray = tip - ankle
    ray = ray / np.linalg.norm(ray)
    angle = np.arctan2(rise, reach)
    ahead = ray * np.cos(angle) - np.cross(across, ray) * np.sin(angle)
    up = np.cross(ahead, across)
    sole = ankle - up * rise
    # Position ahead of the ankle, height, half width (shares of stature).
    levels = (
        (-0.043, 0.030, 0.014),
        (-0.036, 0.052, 0.019),
        (0.010, 0.056, 0.022),
        (0.055, 0.036, 0.027),
        (0.090, 0.025, 0.026),
        (0.109, 0.012, 0.016),
    )
    oval = superellipse(1.0, 1.0, sides=10, power=3.0)
    sections = []
    for level, high, half in levels:
        u, v = oval[:, 0] * half * h, (np.maximum(oval[:, 1], -0.9) / 1.9 + 0.9 / 1.9) * high * h
        sections.append(sole + level * h * ahead + u[:, None] * across + v[:, None] * up)
    return loft(sections, "rubber")


def _coat(figure: Figure, posture: Posture) -> Solid:
    """Return a skirt of cloth that hangs from the hips around both thighs."""
    h, g = figure.stature, figure.girth
    hips, knees = posture.legs[:, 0], posture.legs[:, 1]
    sections = []
    for part in np.linspace(figure.coat, -0.25, 6):
        thighs = hips + (knees - hips) * max(part, 0.0)
        low, high = thighs[:, 0].min(), thighs[:, 0].max()
        z = float(posture.pelvis[2] - part * figure.length("thigh"))
        depth = (high - low) / 2 + (0.066 if part > 0 else 0.070) * h * g
        middle = np.array([(low + high) / 2, posture.pelvis[1], z])
        sections.append(
            _oval_section(
                middle, np.array([1.0, 0, 0]), depth, (0.108 + 0.03 * max(part, 0)) * h * g
            )
        )
    return loft(sections, "cloth")


def _backpack(figure: Figure, posture: Posture) -> Solid:
    _, ahead = _trunk_frame(posture)
    h = figure.stature
    sections = []
    for level, depth, half in (
        (0.30, 0.05, 0.07),
        (0.36, 0.065, 0.085),
        (0.85, 0.06, 0.085),
        (0.97, 0.035, 0.06),
    ):
        centre = posture.pelvis + (posture.neck - posture.pelvis) * level - ahead * 0.105 * h
        sections.append(_oval_section(centre, ahead, depth * h, half * h))
    return loft(sections, "cloth")
