"""Colours of materials of a glTF document."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.io.gltf.data import Buffers
from urbantwin.io.texture import Texture, open_image
from urbantwin.io.values import (
    MalformedError,
    entry,
    numbers,
    table,
    text,
    whole,
)

__all__ = ["Material", "Materials"]


@dataclass(frozen=True, eq=False)
class Material:
    """Colour of a material.

    Attributes:
        name: its name, or "".
        factor: (3,) linear light, or ``None`` without a colour.
        texture: its texture, or ``None``.
        coordinates: index of the texture's set of coordinates.
        use_alpha: whether transparent texels are ignored.
    """

    name: str = ""
    factor: NDArray[np.float64] | None = None
    texture: Texture | None = None
    coordinates: int = 0
    use_alpha: bool = False


class Materials:
    """Materials and images of a document, each read once.

    Source: glTF 2.0, section 3.9 "Materials"; ``KHR_texture_transform``, ``EXT_texture_webp``,
    ``KHR_materials_pbrSpecularGlossiness``. A material with an unreadable image keeps its factor,
    and a line is added to ``problems``.
    """

    def __init__(self, document: dict[str, Any], buffers: Buffers) -> None:
        self._document = document
        self._buffers = buffers
        self._materials: dict[int, Material] = {}
        self._images: dict[int, NDArray[np.uint8] | None] = {}
        self.problems: list[str] = []

    def material(self, number: int) -> Material:
        """Return material ``number``."""
        if number not in self._materials:
            try:
                self._materials[number] = self._read(entry(self._document, "materials", number))
            except MalformedError as error:
                self._tell(f"material {number}: {error}; what is of it has no colour")
                self._materials[number] = Material()
        return self._materials[number]

    def texture(self, info: dict[str, Any]) -> tuple[Texture | None, int]:
        """Return the texture of a ``textureInfo`` and its set of coordinates."""
        coordinates = whole(info, "texCoord", 0)
        spec = entry(self._document, "textures", whole(info, "index"))
        source = spec.get("source")
        webp = table(table(spec, "extensions"), "EXT_texture_webp")
        if webp:
            source = webp.get("source")
        if source is None:
            kind = ", ".join(table(spec, "extensions")) or "no source"
            self._tell(f"a texture ({kind:.60}) cannot be read; its material is of one colour")
            return None, coordinates
        pixels = self._image(whole({"source": source}, "source"))
        if pixels is None:
            return None, coordinates
        wrap = (10497, 10497)
        if spec.get("sampler") is not None:
            sampler = entry(self._document, "samplers", whole(spec, "sampler"))
            wrap = (whole(sampler, "wrapS", 10497), whole(sampler, "wrapT", 10497))
        laid = table(table(info, "extensions"), "KHR_texture_transform")
        offset = numbers(laid, "offset", 2, [0.0, 0.0])
        scale = numbers(laid, "scale", 2, [1.0, 1.0])
        rotation = numbers({"rotation": [laid.get("rotation", 0.0)]}, "rotation", 1)
        return (
            Texture(
                pixels,
                wrap,
                (float(offset[0]), float(offset[1])),
                float(rotation[0]),
                (float(scale[0]), float(scale[1])),
            ),
            whole(laid, "texCoord", coordinates),
        )

    def _read(self, spec: dict[str, Any]) -> Material:
        name, base = text(spec, "name"), table(spec, "pbrMetallicRoughness")
        keys = ("baseColorFactor", "baseColorTexture")
        glossy = table(table(spec, "extensions"), "KHR_materials_pbrSpecularGlossiness")
        if glossy:
            base, keys = glossy, ("diffuseFactor", "diffuseTexture")
        factor = texture = None
        coordinates = 0
        if base.get(keys[0]) is not None:
            factor = numbers(base, keys[0], 4)[:3]
        if base.get(keys[1]) is not None:
            texture, coordinates = self.texture(table(base, keys[1]))
            factor = np.ones(3) if factor is None else factor
        use_alpha = spec.get("alphaMode", "OPAQUE") != "OPAQUE"
        return Material(name, factor, texture, coordinates, use_alpha)

    def _image(self, number: int) -> NDArray[np.uint8] | None:
        if number not in self._images:
            try:
                spec = entry(self._document, "images", number)
                if spec.get("bufferView") is not None:
                    data = bytes(self._buffers.view(whole(spec, "bufferView"))[0])
                else:
                    data = self._buffers.fetch(text(spec, "uri"))
                self._images[number] = open_image(data)
            except MalformedError as error:
                self._images[number] = None
                self._tell(f"image {number}: {error}; its material is of one colour")
        return self._images[number]

    def _tell(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)
