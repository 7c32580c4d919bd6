"""Primitives of meshes: triangles or points with their colours and feature ids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.decoders import unpack_draco
from urbantwin.io.gltf.data import Accessors, Buffers, fractions
from urbantwin.io.gltf.features import FeatureSet, feature_set, property_names
from urbantwin.io.gltf.material import Material, Materials
from urbantwin.io.texture import srgb_from_linear
from urbantwin.io.values import MalformedError, flag, table, whole

__all__ = ["FARTHEST", "Primitive", "PrimitiveReader"]

#: Maximum plausible coordinate or transform element.
FARTHEST = 1e12
POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6


@dataclass(frozen=True, eq=False)
class Primitive:
    """Triangles or points of a primitive, in the frame of its mesh.

    Attributes:
        vertices: (V, 3) float64.
        faces: (F, 3) int32, or ``None`` for points.
        colour: (F, 3), or (V, 3) for points, uint8 sRGB, or ``None``.
        feature: (F,) int64, -1 for none, or ``None``.
        feature_names: names of the features by index, as far as known.
        material: name of the material.
        problem: what was left out, or "".
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32] | None
    colour: NDArray[np.uint8] | None
    feature: NDArray[np.int64] | None
    feature_names: Sequence[str]
    material: str
    problem: str = ""


class PrimitiveReader:
    """Reads primitives of one document.

    Source: glTF 2.0, sections 3.7.2 "Meshes" and 5.24 "Mesh Primitive";
    ``KHR_draco_mesh_compression``.
    """

    def __init__(self, document: dict[str, Any], buffers: Buffers) -> None:
        self._document = document
        self._buffers = buffers
        self._accessors = Accessors(document, buffers)
        self.materials = Materials(document, buffers)
        self._names: dict[int, list[str]] = {}

    @property
    def accessors(self) -> Accessors:
        """The document's accessors."""
        return self._accessors

    def read(self, spec: dict[str, Any]) -> Primitive | None:
        """Return a primitive, or ``None`` for lines.

        Raises:
            MalformedError: it cannot be read.
        """
        mode = whole(spec, "mode", TRIANGLES)
        if mode not in (POINTS, TRIANGLES, STRIP, FAN):
            return None
        attributes = _Attributes(spec, self._accessors, self._buffers)
        material = Material()
        if spec.get("material") is not None:
            material = self.materials.material(whole(spec, "material"))
        if mode == POINTS:
            return self._points(attributes, material)
        used, faces = _compact(self._corners(spec, mode, attributes), attributes.count)
        vertices = attributes.values("POSITION", used)
        finite = _bounded(vertices)
        problem = ""
        if not finite.all():
            problem = f"{int((~finite).sum())} of {len(finite)} vertices are not finite numbers"
            faces = faces[finite[faces].all(axis=1)]
            vertices = np.where(finite[:, None], vertices, 0.0)
        feature: NDArray[np.int64] | None = None
        names: Sequence[str] = []
        colour: NDArray[np.uint8] | None = None
        # the surface is kept without either
        try:
            features = feature_set(spec)
            if features is not None:
                feature = self._feature(features, attributes, used, faces)
                names = self._feature_names(features)
        except MalformedError as error:
            problem = problem or f"its features are left out ({error})"
        try:
            colour = self._colour(material, attributes, used, faces)
        except MalformedError as error:
            problem = problem or f"its colours are left out ({error})"
        return Primitive(vertices, faces, colour, feature, names, material.name, problem)

    def _corners(
        self, spec: dict[str, Any], mode: int, attributes: _Attributes
    ) -> NDArray[np.int64]:
        """Return (F, 3) vertices of the triangles, without those that repeat a vertex."""
        corners = attributes.faces
        if corners is None:
            index = np.arange(attributes.count)
            if spec.get("indices") is not None:
                stored = self._accessors.raw(whole(spec, "indices"))
                if stored.shape[1] != 1 or stored.dtype.kind != "u":
                    raise MalformedError("has indices that are not whole numbers")
                index = stored[:, 0].astype(np.int64)
            corners = _triangles(index, mode)
        if len(corners) and (corners.max() >= attributes.count or corners.min() < 0):
            raise MalformedError(
                f"has an index {int(corners.max())} beyond its {attributes.count} vertices"
            )
        a, b, c = corners.T
        return np.asarray(corners[(a != b) & (b != c) & (c != a)])

    def _points(self, attributes: _Attributes, material: Material) -> Primitive:
        points = attributes.values("POSITION")
        finite = _bounded(points)
        light = attributes.colour(None)
        if light is None and material.factor is not None:
            light = np.broadcast_to(material.factor, points.shape)
        colour = None if light is None else srgb_from_linear(light)[finite]
        problem = ""
        if not finite.all():
            problem = f"{int((~finite).sum())} of {len(finite)} points are not finite numbers"
        return Primitive(points[finite], None, colour, None, [], material.name, problem)

    def _colour(
        self,
        material: Material,
        attributes: _Attributes,
        used: NDArray[np.int64],
        faces: NDArray[np.int32],
    ) -> NDArray[np.uint8] | None:
        """Return each triangle's mean colour: texture x factor x vertex colour (section 3.9.2)."""
        light: NDArray[np.float64] | None = None
        name = f"TEXCOORD_{material.coordinates}"
        if material.texture is not None and attributes.has(name, 2):
            uv = attributes.values(name, used)
            light = material.texture.means(uv[faces], use_alpha=material.use_alpha)
        corners = attributes.colour(used)
        if corners is not None:
            mean = corners[faces].mean(axis=1)
            light = mean if light is None else light * mean
        if material.factor is not None:
            if light is None:
                light = np.ones((1, 3))
            light = light * material.factor
        if light is None:
            return None
        colour = srgb_from_linear(np.nan_to_num(light))
        return np.broadcast_to(colour, (len(faces), 3)).copy()

    def _feature(
        self,
        features: FeatureSet,
        attributes: _Attributes,
        used: NDArray[np.int64],
        faces: NDArray[np.int32],
    ) -> NDArray[np.int64] | None:
        """Return each triangle's feature: that of its first corner, or of its centre's texel."""
        if features.texture is not None:
            texture, coordinates = self.materials.texture(features.texture)
            name = f"TEXCOORD_{coordinates}"
            if texture is None or not attributes.has(name, 2):
                return None
            uv = np.nan_to_num(attributes.values(name, used))
            rgba = texture.texels(texture.transformed(uv[faces].mean(axis=1))).astype(np.int64)
            result = sum(rgba[:, c] << 8 * k for k, c in enumerate(features.channels))
            result = np.asarray(result)
        elif features.attribute:
            if not attributes.has(features.attribute, 1):
                return None
            value = np.nan_to_num(attributes.values(features.attribute, used)[:, 0], nan=-1)
            result = np.rint(np.clip(value, -1, 2**40)).astype(np.int64)[faces[:, 0]]
        else:
            result = used[faces[:, 0]]
        return np.where(result == features.null, -1, result)

    def _feature_names(self, features: FeatureSet) -> Sequence[str]:
        if features.table is None:
            return []
        if features.table not in self._names:
            try:
                names = property_names(self._document, self._buffers, features.table)
            except MalformedError:
                names = []
            self._names[features.table] = names
        return self._names[features.table]


class _Attributes:
    """The vertex attributes of one primitive, from accessors or from Draco."""

    def __init__(self, spec: dict[str, Any], accessors: Accessors, buffers: Buffers) -> None:
        self._accessors = accessors
        self._numbers = table(spec, "attributes")
        self._draco: dict[str, NDArray[Any]] = {}
        self.faces: NDArray[np.int64] | None = None
        packed = table(table(spec, "extensions"), "KHR_draco_mesh_compression")
        if "POSITION" not in self._numbers:
            raise MalformedError("has no POSITION")
        self.count = accessors.count(whole(self._numbers, "POSITION"))
        if packed:
            data = bytes(buffers.view(whole(packed, "bufferView"))[0])
            by_id, self.faces = unpack_draco(data)
            ids = table(packed, "attributes")
            self._draco = {key: by_id[whole(ids, key)] for key in ids if whole(ids, key) in by_id}
            if "POSITION" not in self._draco:
                raise MalformedError("its Draco data has no POSITION")
            self.count = len(self._draco["POSITION"])
        if not self.has("POSITION", 3):
            raise MalformedError("has a POSITION that is not of 3 numbers")

    def has(self, name: str, columns: int) -> bool:
        """Return whether an attribute has at least ``columns`` columns, for every vertex."""
        if name in self._draco:
            rows = self._draco[name]
            return rows.ndim == 2 and rows.shape == (self.count, max(columns, rows.shape[1]))
        if self._numbers.get(name) is None:
            return False
        number = whole(self._numbers, name)
        kind = self._accessors.spec(number).get("type")
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}.get(str(kind), 0)
        return width >= columns and self._accessors.count(number) == self.count

    def values(self, name: str, rows: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return (V, C) float64 of an attribute, or of some of its rows."""
        whole_array: NDArray[Any]
        number = whole(self._numbers, name, 0)
        normalised = name in self._numbers and flag(self._accessors.spec(number), "normalized")
        whole_array = self._draco[name] if name in self._draco else self._accessors.raw(number)
        some = whole_array if rows is None else whole_array[rows]
        if normalised and some.dtype.kind in "iu":
            return fractions(some)
        return some.astype(np.float64)

    def colour(self, rows: NDArray[np.int64] | None) -> NDArray[np.float64] | None:
        """Return vertex colours (V, 3), linear light, or ``None``."""
        if not self.has("COLOR_0", 3):
            return None
        value = self.values("COLOR_0", rows)[:, :3]
        # the standard requires normalised integers, also if the flag is missing
        top = float(value.max(initial=0.0))
        if top > 1.0:
            value = value / (255.0 if top <= 255.0 else 65535.0)
        return np.clip(np.nan_to_num(value), 0.0, 1.0)


def _bounded(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of points that are finite and plausible."""
    return np.asarray((np.abs(points) < FARTHEST).all(axis=1))


def _triangles(index: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return (F, 3) corners of triangles, a strip or a fan (section 3.7.2.1)."""
    if mode == TRIANGLES:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    k = np.arange(max(0, len(index) - 2))
    if mode == STRIP:
        return index[np.stack([k, k + 1 + k % 2, k + 2 - k % 2], axis=1)]
    return index[np.stack([k + 1, k + 2, np.zeros_like(k)], axis=1)]


def _compact(faces: NDArray[np.int64], count: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the vertices used by faces, and the renumbered faces.

    Many primitives may share one long buffer: each uses only its own part.
    """
    if faces.size * 4 < count:
        used, renumbered = np.unique(faces, return_inverse=True)
        return used, renumbered.reshape(-1, 3).astype(np.int32)
    mask = np.zeros(count, bool)
    mask[faces] = True
    if mask.all():
        return np.arange(count), faces.astype(np.int32)
    number = np.cumsum(mask, dtype=np.int64) - 1
    return np.flatnonzero(mask), number[faces].astype(np.int32)
