"""Plausibility checks of a placed mesh: size and up direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.io.model import TriangleMesh
from urbantwin.site import GeometrySource

__all__ = ["implausible_size", "refuse_upside_down"]

#: Maximum and minimum width of a model, metres.
_WIDEST_M, _NARROWEST_M = 20_000.0, 0.5
#: Share of the level surface that faces down, and tolerance of the ground height (metres), from
#: which a model is upside down.
_FACES_DOWN, _AT_GROUND_M = 0.8, 1.0
_LEVEL = 0.97  # cosine of 14 degrees


def implausible_size(mesh: TriangleMesh, source: GeometrySource) -> str | None:
    """Return a warning about an unlikely size of a mesh, or ``None``.

    Args:
        mesh: site frame, metres.
        source: source of the mesh, for the error.

    Raises:
        InputError: the mesh is too small to be a place.
    """
    finite = mesh.vertices[np.isfinite(mesh.vertices).all(axis=1)]
    width = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if 0.0 < width < _NARROWEST_M:
        raise InputError(
            f"{source.name} is {width * 1000:.3g} mm wide as it is placed",
            file=source.document.file,
            place=source.place(),
            expected="another unit (or scale)",
        )
    if width > _WIDEST_M:
        return f"is {width / 1000:,.0f} km wide as it is placed: is its unit right?"
    return None


def refuse_upside_down(mesh: TriangleMesh, source: GeometrySource) -> None:
    """Raise an error if a model is upside down.

    Its level surface then faces down, most of it at one height, with the rest below. A model whose
    triangles merely have the wrong orientation has everything above its ground.

    Args:
        mesh: site frame, metres.
        source: source of the mesh, for the error.

    Raises:
        InputError: the mesh is upside down.
    """
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(cross, axis=1)
    level = np.abs(cross[:, 2]) > _LEVEL * twice
    area, height = twice[level], corners[level, :, 2].mean(axis=1)
    total = float(area.sum())
    if not total > 0.0 or float(area[cross[level, 2] < 0].sum()) < _FACES_DOWN * total:
        return
    ground = _weighted_median(height, area)
    near = np.abs(height - ground) < _AT_GROUND_M
    above = float(corners[:, :, 2].max()) - ground
    below = ground - float(corners[:, :, 2].min())
    if float(area[near].sum()) > total / 2 and below > 2.0 and below > 3.0 * max(above, 0.0):
        share = float(area[cross[level, 2] < 0].sum()) / total
        raise InputError(
            f"{source.name} is upside down: {share:.0%} of its level surface faces down, and it "
            f"reaches {below:.1f} m below its ground and {above:.1f} m above",
            file=source.document.file,
            place=source.place(),
            expected="a model whose up axis points up, or similarity: {roll_deg: 180}",
        )


def _weighted_median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])
