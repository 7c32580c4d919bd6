"""Solids: closed triangle meshes with a material per triangle, before they become an asset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id

__all__ = [
    "Solid",
    "box",
    "capsule",
    "cylinder",
    "ellipsoid",
    "fitted",
    "labelled",
    "loft",
    "parts",
    "place",
    "ring",
    "rotation_to",
    "superellipse",
    "turned",
]


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface around a volume.

    Every edge belongs to exactly two triangles that run through it in opposite directions, and
    normals point out of the volume.

    Attributes:
        vertices: (V, 3) float64, metres, asset frame (x forward, y left, z up).
        faces: (F, 3) int32, counter-clockwise seen from outside.
        material: (F,) uint8, numbers of ``urbantwin.taxonomy.materials``.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    material: NDArray[np.uint8]

    @classmethod
    def build(cls, vertices: ArrayLike, faces: ArrayLike, material: str | list[str]) -> Solid:
        """Build from anything array-like; ``material`` is one name or one name per triangle."""
        triangles = np.asarray(faces, np.int32).reshape(-1, 3)
        if isinstance(material, str):
            numbers = np.full(len(triangles), material_id(material), np.uint8)
        else:
            ids = {name: material_id(name) for name in set(material)}
            numbers = np.array([ids[name] for name in material], np.uint8)
        return cls(np.asarray(vertices, np.float64).reshape(-1, 3), triangles, numbers)

    def moved(self, offset: ArrayLike) -> Solid:
        """Return the solid shifted by (3,) metres."""
        return Solid(self.vertices + np.asarray(offset, np.float64), self.faces, self.material)

    def scaled(self, factors: ArrayLike) -> Solid:
        """Return the solid stretched along x, y and z by positive factors about the origin."""
        return Solid(self.vertices * np.asarray(factors, np.float64), self.faces, self.material)

    def rotated(self, rotation: NDArray[np.float64]) -> Solid:
        """Return the solid turned about the origin by a (3, 3) rotation matrix."""
        return Solid(self.vertices @ rotation.T, self.faces, self.material)

    def mirrored(self) -> Solid:
        """Return the solid's reflection at the plane y = 0, normals still outward."""
        return Solid(self.vertices * [1.0, -1.0, 1.0], self.faces[:, ::-1].copy(), self.material)

    def volume(self) -> float:
        """Return the enclosed volume (divergence theorem), cubic metres; negative if inside out."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def labelled(solids: Iterable[Solid], semantic: int) -> LabelledMesh:
    """Join solids into a mesh of one semantic class; ``part`` counts the solids from 1."""
    return LabelledMesh.concatenate(
        LabelledMesh.build(solid.vertices, solid.faces, semantic, solid.material, part)
        for part, solid in enumerate(solids, 1)
    )


def fitted(
    solids: Sequence[Solid], size: ArrayLike, *, like: Sequence[Solid] | None = None
) -> list[Solid]:
    """Scale solids to exact bounds: x and y centred on the origin, z from 0 up.

    Args:
        solids: solids of one asset.
        size: (3,) length, width and height, metres.
        like: the solids whose bounds are used (another phase of the asset); ``None``: ``solids``.
    """
    corners = np.concatenate([solid.vertices for solid in like or solids])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    factors = np.asarray(size) / (high - low)
    return [solid.moved(-middle).scaled(factors) for solid in solids]


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
        material: material of the whole, or of each of the P - 1 bands.
        sides: corners of the polygon that approximates the circle. A corner lies on +x.
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
    """Return the common data of solids of revolution: unit circle (S, 2), faces, band of each face.

    Vertices are the rings from the lowest up, then the lower and the upper pole.
    """
    angle = np.arange(sides) * (2 * np.pi / sides)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    corner, after = np.arange(sides), np.roll(np.arange(sides), -1)
    low = sides * rings
    faces = [np.column_stack([np.full(sides, low), after, corner])]
    band = [0] * sides
    for number in range(rings - 1):
        below, above = number * sides, (number + 1) * sides
        faces.append(np.column_stack([below + corner, below + after, above + after]))
        faces.append(np.column_stack([below + corner, above + after, above + corner]))
        band += [number + 1] * (2 * sides)
    last = low - sides
    faces.append(np.column_stack([last + corner, last + after, np.full(sides, low + 1)]))
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
    """Return the (3, 3) rotation that takes z to ``axis`` and keeps y nearly horizontal."""
    up = np.asarray(axis, np.float64)
    up = up / np.linalg.norm(up)
    side = np.array([0.0, 1.0, 0.0])
    if abs(up[1]) > 0.99:
        side = np.array([1.0, 0.0, 0.0]) if up[1] < 0 else np.array([-1.0, 0.0, 0.0])
    ahead = _cross(side, up)
    ahead /= np.linalg.norm(ahead)
    return np.column_stack([ahead, _cross(up, ahead), up])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cross product of two vectors, ten times as fast as ``np.cross``."""
    x, y, z = a.tolist()
    u, v, w = b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def superellipse(
    half_width: float, half_depth: float, *, sides: int, power: float = 2.0
) -> NDArray[np.float64]:
    """Return (sides, 2) corners of |u/a|^p + |v/b|^p = 1, counter-clockwise from +u.

    Power 2 is the ellipse, 4 a rounded rectangle.
    """
    angle = np.arange(sides) * (2 * np.pi / sides)
    cos, sin = np.cos(angle), np.sin(angle)
    radius = (np.abs(cos) ** power + np.abs(sin) ** power) ** (-1 / power)
    return np.column_stack([half_width * radius * cos, half_depth * radius * sin])


def loft(sections: Sequence[ArrayLike], material: str | Sequence[str]) -> Solid:
    """Return the solid through cross-sections with equal numbers of corners, its ends closed.

    Args:
        sections: each (S, 3), metres, counter-clockwise seen from the last section's side.
        material: material of the whole, or of each of the bands between sections; the ends have
            that of the first and the last band.
    """
    rings = np.array([np.asarray(section, np.float64) for section in sections])
    count, sides, _ = rings.shape
    names = [material] * (count - 1) if isinstance(material, str) else list(material)
    corner, after = np.arange(sides), np.roll(np.arange(sides), -1)
    centre_low, centre_high = count * sides, count * sides + 1
    faces = [np.column_stack([np.full(sides, centre_low), after, corner])]
    labels = [names[0]] * sides
    for band, name in enumerate(names):
        below, above = band * sides, (band + 1) * sides
        faces.append(np.column_stack([below + corner, below + after, above + after]))
        faces.append(np.column_stack([below + corner, above + after, above + corner]))
        labels += [name] * (2 * sides)
    last = (count - 1) * sides
    faces.append(np.column_stack([last + corner, last + after, np.full(sides, centre_high)]))
    labels += [names[-1]] * sides
    middles = [rings[0].mean(axis=0), rings[-1].mean(axis=0)]
    return Solid.build(
        np.concatenate([rings.reshape(-1, 3), middles]), np.concatenate(faces), labels
    )


#: Corners of a hull's sections.
HULL_SIDES = 16


def parts(entry: Mapping[str, Any]) -> list[Solid]:
    """Return the parts of an entry.

    Its keys, each a list:

    - ``blocks``: [x from, to], [y from, to], [z from, to], material;
    - ``tubes``: point, point, radius, material: a cylinder between two points;
    - ``hulls``: material, power of the section's superellipse (2 an ellipse, 4 a rounded
      rectangle), then the stations from the nose backwards: metres behind the nose, height of the
      middle, half-height, half-width;
    - ``balls``: point, half axes [x, y, z], material.
    """
    length = entry["size"][0]
    solids = []
    for (start, end), (right, left), (low, high), material in entry.get("blocks", ()):
        size = [end - start, left - right, high - low]
        middle = [(start + end) / 2, (left + right) / 2, (low + high) / 2]
        solids += _both(box(size, place(middle, length), material), right)
    for start, end, radius, material in entry.get("tubes", ()):
        sides = 6 if radius < 0.03 else 12
        ends = place(start, length), place(end, length)
        solids += _both(cylinder(*ends, radius, material, sides=sides), start[1])
    for material, power, *stations in entry.get("hulls", ()):
        solids.append(_hull(stations, power, material, length))
    for middle, radii, material in entry.get("balls", ()):
        ball = ellipsoid(radii, place(middle, length), material, sides=10, rings=5)
        solids += _both(ball, middle[1])
    return solids


def place(behind_left_up: Sequence[float], length: float) -> NDArray[np.float64]:
    """Return a point (3,) of the catalogue in the asset frame."""
    from_nose, left, up = behind_left_up
    return np.array([length / 2 - from_nose, left, up])


def _both(solid: Solid, y: float) -> list[Solid]:
    return [solid, solid.mirrored()] if y > 0 else [solid]


def _hull(stations: Sequence[Sequence[float]], power: float, material: str, length: float) -> Solid:
    sections = []
    for from_nose, z, half_height, half_width in stations[::-1]:
        oval = superellipse(half_width, half_height, sides=HULL_SIDES, power=power)
        x = np.full(len(oval), length / 2 - from_nose)
        sections.append(np.column_stack([x, oval[:, 0], z + oval[:, 1]]))
    return loft(sections, material)
