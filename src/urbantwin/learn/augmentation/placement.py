"""A frame turned about a place, mirrored and scaled, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry.angle import wrapped

__all__ = ["Placement", "drawn_placement"]

#: The streets of one country are so much larger than those of another, and its cars.
_SCALE = 0.05


@dataclass(frozen=True)
class Placement:
    """Where a frame is put: about a place, mirrored, turned and scaled.

    Attributes:
        x: of the place in the frame, metres; it comes to 0, 0.
        y: of it.
        yaw: turned counter-clockwise by this, radians, after it was mirrored.
        mirrored: whether y changes its sign first.
        scale: metres there for a metre here, heights too.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    mirrored: bool = False
    scale: float = 1.0

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The turn, mirror and scale of plan (2, 2)."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        turn = np.array([[c, -s], [s, c]])
        return np.asarray(turn @ np.diag([1.0, -1.0 if self.mirrored else 1.0]) * self.scale)

    def points(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return (N, 3+) points there: what follows the height stays."""
        found = points.astype(np.float32)
        found[:, :2] = (points[:, :2] - (self.x, self.y)) @ self.matrix.T
        found[:, 2] *= self.scale
        return found

    def boxes(self, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (B, 7) boxes there."""
        found = box.copy()
        found[:, :2] = (box[:, :2] - (self.x, self.y)) @ self.matrix.T
        found[:, 2:6] *= self.scale
        yaw = (-box[:, 6] if self.mirrored else box[:, 6]) + self.yaw
        found[:, 6] = wrapped(yaw)
        return found

    def back(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where (N, 2) places there are in the frame."""
        return np.asarray(places @ np.linalg.inv(self.matrix).T + (self.x, self.y))


def drawn_placement(
    draw: np.random.Generator, x: float, y: float, *, varied: bool = True
) -> Placement:
    """Return a random placement about a place; not turned, mirrored and scaled if not varied."""
    if not varied:
        return Placement(x, y)
    yaw = draw.uniform(-np.pi, np.pi)
    mirrored = bool(draw.random() < 0.5)
    return Placement(x, y, yaw, mirrored, 1 + draw.uniform(-_SCALE, _SCALE))
