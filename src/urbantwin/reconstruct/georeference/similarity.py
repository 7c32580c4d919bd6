"""Similarity transforms: application to models, and fits to pairs of points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.errors import InputError
from urbantwin.io.model import ImportedModel

__all__ = ["Similarity", "fitted", "level_fitted", "moved"]

#: y-up to z-up: x is unchanged, y becomes z, z becomes -y (glTF 2.0, 3.4: y up, z forward).
_Z_UP = {"y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "z": np.eye(3)}


@dataclass(frozen=True, eq=False)
class Similarity:
    """``b = scale rotation a + translation``.

    Attributes:
        scale: metres per unit of a.
        rotation: (3, 3), proper.
        translation: (3,), metres.
    """

    scale: float
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    @classmethod
    def of_axes(cls, up: str, unit_m: float) -> Similarity:
        """Return the transform to z-up and metres."""
        return cls(unit_m, _Z_UP[up], np.zeros(3))

    @classmethod
    def in_plan(cls, yaw: float, translation: ArrayLike, scale: float = 1.0) -> Similarity:
        """Return a rotation about the vertical (radians, counter-clockwise) followed by a shift."""
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        return cls(scale, turn, np.asarray(translation, np.float64))

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of a in b."""
        out: NDArray[np.float64] = points @ (self.scale * self.rotation).T
        out += self.translation
        return out

    def after(self, first: Similarity) -> Similarity:
        """Return the transform that applies ``first`` and then this one."""
        return Similarity(
            self.scale * first.scale,
            self.rotation @ first.rotation,
            self.apply(first.translation[None])[0],
        )

    def as_report(self) -> dict[str, object]:
        """Return the scale, the rotation's rows and the translation as plain numbers."""
        return {
            "scale": float(f"{self.scale:.9g}"),
            "rotation": np.round(self.rotation, 9).tolist(),
            "translation_m": np.round(self.translation, 4).tolist(),
        }


def moved(model: ImportedModel, transform: Similarity) -> ImportedModel:
    """Return a model with all its points transformed."""
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None:
        mesh = replace(mesh, vertices=transform.apply(mesh.vertices))
    if cloud is not None:
        cloud = replace(cloud, points=transform.apply(cloud.points))
    return replace(model, mesh=mesh, cloud=cloud)


def fitted(a: ArrayLike, b: ArrayLike) -> Similarity:
    """Return the least squares similarity from points a to points b.

    Closed form: S. Umeyama, "Least-squares estimation of transformation parameters between two
    point patterns", IEEE PAMI 13(4), 1991.

    Args:
        a: (N, 3), N >= 3 and not collinear.
        b: (N, 3).

    Raises:
        InputError: distances exceed the numeric range.
    """
    source, target = np.asarray(a, np.float64), np.asarray(b, np.float64)
    from_middle, to_middle = source.mean(axis=0), target.mean(axis=0)
    p, q = source - from_middle, target - to_middle
    try:
        u, d, vt = np.linalg.svd(q.T @ p / len(p))
    except np.linalg.LinAlgError:
        raise InputError(
            "the points lie too far apart to be fitted", expected="places in metres"
        ) from None
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * sign) @ vt
    scale = float((d * sign).sum() / (p**2).sum(axis=1).mean())
    return Similarity(scale, rotation, to_middle - scale * rotation @ from_middle)


def level_fitted(a: ArrayLike, b: ArrayLike) -> Similarity:
    """Return the similarity from z-up points a to points b that preserves the vertical.

    The plan is fitted by least squares; heights are only shifted.

    Args:
        a: (N, 3), N >= 2 and not all at one position in plan.
        b: (N, 3).
    """
    source, target = np.asarray(a, np.float64), np.asarray(b, np.float64)
    from_middle, to_middle = source.mean(axis=0), target.mean(axis=0)
    p = (source - from_middle)[:, :2] @ np.array([1, 1j])
    q = (target - to_middle)[:, :2] @ np.array([1, 1j])
    turn = complex(np.vdot(p, q) / np.vdot(p, p))
    out = Similarity.in_plan(float(np.angle(turn)), np.zeros(3), abs(turn))
    return replace(out, translation=to_middle - out.apply(from_middle[None])[0])
