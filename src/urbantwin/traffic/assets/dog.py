"""Dogs, and where one walks beside its owner.

A medium dog in a lateral-sequence walk: each hind foot sets off a quarter of a stride before the
fore foot of its side, each foot stands for two thirds of the stride (Hildebrand, Symmetrical gaits
of dogs in relation to body build, Journal of Morphology 124, 1968). Its measures are those of a
Labrador (FCI standard 122: 0.56 m at the withers); fur has the material of cloth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.traffic.assets.loft import loft, superellipse
from urbantwin.traffic.assets.person import bent
from urbantwin.traffic.assets.primitive import capsule, ellipsoid
from urbantwin.traffic.assets.solid import Solid

__all__ = ["BESIDE_M", "DOG_PHASES", "dog", "dog_stride"]

#: Postures of a stride; how far ahead of and beside its owner it walks, metres (a short lead).
DOG_PHASES, BESIDE_M = 12, (0.15, 0.60)
#: Part of the stride that a foot stands, and the stride's length in heights at the withers.
_DUTY, _STRIDE = 0.66, 1.55
#: When each foot comes down, parts of the stride: hind left, fore left, hind right, fore right.
_FEET = ((-1, 1, 0.0), (1, 1, 0.25), (-1, -1, 0.5), (1, -1, 0.75))
_HEIGHT_M = 0.56  # of the measures below


def dog_stride(entry: Mapping[str, Any]) -> float:
    """Return the length of a dog's stride, metres."""
    return float(_STRIDE * entry["withers"])


def dog(entry: Mapping[str, Any], phase: int | None) -> list[Solid]:
    """Return the solids of a dog in a phase of its stride; ``None``: it stands."""
    solids = [*_body(), *_head()]
    stride = _STRIDE * _HEIGHT_M
    for fore, side, begins in _FEET:
        place, lift = 0.0, 0.0
        if phase is not None:
            place, lift = _foot(phase / DOG_PHASES - begins, stride)
        solids += _leg(fore, side, place, lift)
    factor = entry["withers"] / _HEIGHT_M
    solids = [solid.scaled([factor] * 3) for solid in solids]
    low = min(float(solid.vertices[:, 2].min()) for solid in solids)
    return [solid.moved([0.0, 0.0, -low]) for solid in solids]


def _foot(part: float, stride: float) -> tuple[float, float]:
    """Return how far ahead of its shoulder a foot is, and how high, at a part of its stride."""
    now = part % 1.0
    if now < _DUTY:
        return stride * (_DUTY / 2 - now), 0.0
    swing = (now - _DUTY) / (1 - _DUTY)
    ahead = -_DUTY / 2 + _DUTY * (1 - np.cos(np.pi * swing)) / 2
    return float(stride * ahead), float(0.07 * np.sin(np.pi * swing))


def _leg(fore: int, side: int, place: float, lift: float) -> list[Solid]:
    """Return a leg, its foot so far ahead of where it hangs, and so high."""
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


def _body() -> list[Solid]:
    """Return the trunk from the rump to the chest, and the tail."""
    # Ahead, height of the middle, half height, half width.
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


def _head() -> list[Solid]:
    """Return neck, skull, muzzle and ears, and a collar with a tag."""
    solids = [
        capsule([0.25, 0, 0.50], [0.40, 0, 0.64], 0.085, 0.065, "cloth", sides=10),
        ellipsoid([0.10, 0.075, 0.075], [0.45, 0, 0.675], "cloth", sides=12, rings=6),
        capsule([0.50, 0, 0.66], [0.60, 0, 0.64], 0.048, 0.036, "cloth", sides=10),
        capsule([0.325, 0, 0.575], [0.345, 0, 0.595], 0.088, 0.086, "rubber", sides=10),
    ]
    ear = ellipsoid([0.035, 0.012, 0.055], [0.42, 0.082, 0.665], "cloth", sides=8, rings=4)
    return [*solids, ear, ear.mirrored()]
