"""Elementary solids, all from one construction: a profile turned about an axis (or a box)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.traffic.assets.solid import Solid

__all__ = ["box", "capsule", "cylinder", "ellipsoid", "ring", "rotation_to", "turned"]


def box(size: ArrayLike, centre: ArrayLike, material: str) -> Solid:
    """Return an axis-aligned box of (3,) metres about a centre."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]  # fmt: skip
    return Solid.build(corners * np.asarray(size) + np.asarray(centre), faces, material)


def turned(profile: ArrayLike, material: str | Sequence[str], *, sides: int) -> Solid:
    """Return the solid of revolution of a profile about the z axis.

    Args:
        profile: (P, 2) radius and height in metres, from the lowest point of the axis to the
            highest, so with radius 0 first and last.
        material: of the whole, or of each of the P - 1 bands.
        sides: corners of the polygon that stands for the circle. A corner lies on +x.
    """
    points = np.asarray(profile, np.float64)
    inner = points[1:-1]
    circle, faces, band = _revolution(len(inner), sides)
    vertices = np.zeros((sides * len(inner) + 2, 3))
    rings = vertices[:-2].reshape(len(inner), sides, 3)
    rings[:, :, :2] = circle * inner[:, None, :1]
    rings[:, :, 2] = inner[:, 1:]
    vertices[-2:, 2] = points[[0, -1], 1]
    if isinstance(material, str):
        return Solid.build(vertices, faces, material)
    return Solid.build(vertices, faces, [material[number] for number in band])


@cache
def _revolution(
    rings: int, sides: int
) -> tuple[NDArray[np.float64], NDArray[np.int32], tuple[int, ...]]:
    """Return what all solids of revolution share: unit circle (S, 2), faces, band of each face.

    Vertices are the rings from the lowest up, then the lower and the upper pole.
    """
    angle = np.arange(sides) * (2 * np.pi / sides)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    here, after = np.arange(sides), np.roll(np.arange(sides), -1)
    low = sides * rings
    faces = [np.column_stack([np.full(sides, low), after, here])]
    band = [0] * sides
    for number in range(rings - 1):
        below, above = number * sides, (number + 1) * sides
        faces.append(np.column_stack([below + here, below + after, above + after]))
        faces.append(np.column_stack([below + here, above + after, above + here]))
        band += [number + 1] * (2 * sides)
    last = low - sides
    faces.append(np.column_stack([last + here, last + after, np.full(sides, low + 1)]))
    band += [rings] * sides
    return circle, np.concatenate(faces).astype(np.int32), tuple(band)


def cylinder(
    start: ArrayLike, end: ArrayLike, radius: float, material: str, sides: int = 8
) -> Solid:
    """Return a cylinder between two points."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    height = float(np.linalg.norm(b - a))
    profile = np.array([[0.0, 0.0], [radius, 0.0], [radius, height], [0.0, height]])
    solid = turned(profile, material, sides=sides)
    return solid.rotated(rotation_to(b - a)).moved(a)


def capsule(
    start: ArrayLike,
    end: ArrayLike,
    start_radius: float,
    end_radius: float,
    material: str,
    *,
    sides: int = 10,
    cap_rings: int = 2,
    flatten: float = 1.0,
) -> Solid:
    """Return a tapered capsule: two half balls and the cone between them.

    Args:
        start: centre (3,) of the first ball, metres.
        end: centre (3,) of the second.
        start_radius: metres.
        end_radius: metres.
        material: name.
        sides: corners of the circle.
        cap_rings: circles of latitude of each half ball, its equator included.
        flatten: factor on the section's second axis (across the plane of the axis and the
            vertical, or y where the axis is vertical).
    """
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    height = float(np.linalg.norm(b - a))
    latitude = np.linspace(np.pi / 2, 0, cap_rings + 1)[1:]
    low = np.column_stack([start_radius * np.cos(latitude), -start_radius * np.sin(latitude)])
    high = np.column_stack([end_radius * np.cos(latitude), height + end_radius * np.sin(latitude)])
    first, last = [[0.0, -start_radius]], [[0.0, height + end_radius]]
    profile = np.concatenate([first, low, high[::-1], last])
    solid = turned(profile, material, sides=sides).scaled([1.0, flatten, 1.0])
    return solid.rotated(rotation_to(b - a)).moved(a)


def ellipsoid(
    radii: ArrayLike, centre: ArrayLike, material: str, *, sides: int = 12, rings: int = 7
) -> Solid:
    """Return an ellipsoid with half axes (3,) along x, y and z."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 2)
    profile = np.column_stack([np.cos(latitude), np.sin(latitude)])
    profile[[0, -1], 0] = 0.0
    return turned(profile, material, sides=sides).scaled(radii).moved(centre)


def ring(
    centre: ArrayLike,
    radius: float,
    thickness: float,
    material: str,
    *,
    sides: int = 24,
    section_sides: int = 6,
) -> Solid:
    """Return a torus in the plane y = const: a bicycle's tyre.

    Args:
        centre: (3,) metres.
        radius: outer radius, metres: a corner of the outer circle lies on -z if ``sides`` is a
            multiple of 4.
        thickness: diameter of the tube, metres.
        material: name.
        sides: corners of the large circle.
        section_sides: corners of the tube's section.
    """
    around = np.arange(sides) * (2 * np.pi / sides)
    about = np.arange(section_sides) * (2 * np.pi / section_sides)
    reach = radius - thickness / 2 + thickness / 2 * np.cos(about)
    vertices = np.stack(
        [
            np.outer(np.cos(around), reach),
            np.broadcast_to(thickness / 2 * np.sin(about), (sides, section_sides)),
            np.outer(np.sin(around), reach),
        ],
        axis=-1,
    ).reshape(-1, 3)
    i, j = (grid.ravel() for grid in np.mgrid[:sides, :section_sides])
    i2, j2 = (i + 1) % sides, (j + 1) % section_sides
    a, b, c, d = (p * section_sides + q for p, q in ((i, j), (i2, j), (i2, j2), (i, j2)))
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([a, d, c])])
    return Solid.build(vertices, faces, material).moved(centre)


def rotation_to(axis: ArrayLike) -> NDArray[np.float64]:
    """Return the (3, 3) rotation that takes z to ``axis`` and keeps y as horizontal as it can."""
    up = np.asarray(axis, np.float64)
    up = up / np.linalg.norm(up)
    side = np.array([0.0, 1.0, 0.0])
    if abs(up[1]) > 0.99:
        side = np.array([1.0, 0.0, 0.0]) if up[1] < 0 else np.array([-1.0, 0.0, 0.0])
    ahead = _cross(side, up)
    ahead /= np.linalg.norm(ahead)
    return np.column_stack([ahead, _cross(up, ahead), up])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cross product of two vectors; ``np.cross`` takes ten times as long for one."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
