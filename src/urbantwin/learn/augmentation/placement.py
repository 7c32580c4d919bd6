"""Augmentation by reflection, rotation and scaling about a place, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.angle import wrapped

__all__ = ["Placement", "drawn_placement"]

#: Largest relative scaling: differences of streets and vehicles between countries.
_SCALE = 0.05


@dataclass(frozen=True)
class Placement:
    """A similarity transformation that moves a place to the origin.

    Attributes:
        x: x of the place in the frame, metres.
        y: y of the place in the frame, metres.
        yaw: counter-clockwise rotation after the reflection, radians.
        mirrored: whether y is mirrored first.
        scale: scale factor, of heights too.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    mirrored: bool = False
    scale: float = 1.0

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Matrix (2, 2) of reflection, rotation and scaling in plan."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[c, -s], [s, c]])
        return np.asarray(turn @ np.diag([1.0, -1.0 if self.mirrored else 1.0]) * self.scale)

    def points(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Transform points (N, 3+); columns after z are unchanged."""
        found = points.astype(np.float32)
        found[:, :2] = (points[:, :2] - (self.x, self.y)) @ self.matrix.T
        found[:, 2] *= self.scale
        return found

    def boxes(self, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform boxes (B, 7)."""
        found = box.copy()
        found[:, :2] = (box[:, :2] - (self.x, self.y)) @ self.matrix.T
        found[:, 2:6] *= self.scale
        yaw = (-box[:, 6] if self.mirrored else box[:, 6]) + self.yaw
        found[:, 6] = wrapped(yaw)
        return found

    def back(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform places (N, 2) back to the frame."""
        return np.asarray(places @ np.linalg.inv(self.matrix).T + (self.x, self.y))


def drawn_placement(
    draw: np.random.Generator, x: float, y: float, *, varied: bool = True
) -> Placement:
    """Draw a placement about a place; a translation only if not ``varied``."""
    if not varied:
        return Placement(x, y)
    yaw = draw.uniform(-np.pi, np.pi)
    mirrored = bool(draw.random() < 0.5)
    return Placement(x, y, yaw, mirrored, 1 + draw.uniform(-_SCALE, _SCALE))
