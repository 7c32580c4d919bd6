"""Documents of glTF 1.0, which tiles of before 2018 hold, rewritten as glTF 2.0.

Only what carries geometry and colour is: shaders and techniques are left out, and a material's
colour is taken from ``values.diffuse`` or from ``KHR_materials_common``.

Source: glTF 1.0 (Khronos, 2015), ``KHR_binary_glTF``, ``KHR_materials_common``, ``CESIUM_RTC``;
glTF 2.0, Appendix "Migration".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from urbantwin.reconstruct.gltf.untrusted_values import MalformedError, items, table

__all__ = ["upgraded"]

_Find = Callable[[str, object], int]
_KINDS = (
    "accessors",
    "buffers",
    "bufferViews",
    "images",
    "materials",
    "meshes",
    "nodes",
    "samplers",
    "scenes",
    "textures",
)


def upgraded(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a glTF 1.0 document as one of 2.0: names of things become their numbers."""
    # The binary chunk must be buffer 0, the only one that may lack a uri.
    buffers = sorted(table(document, "buffers"), key=lambda name: name != "binary_glTF")
    names = {kind: list(table(document, kind)) for kind in _KINDS} | {"buffers": buffers}
    number = {kind: {name: k for k, name in enumerate(names[kind])} for kind in _KINDS}

    def find(kind: str, name: object) -> int:
        if not isinstance(name, str) or name not in number[kind]:
            raise MalformedError(f"refers to {kind} {name!r:.40}, which it does not have")
        return number[kind][name]

    def entries(kind: str) -> list[tuple[str, dict[str, Any]]]:
        source = table(document, kind)
        return [(name, table(source, name)) for name in names[kind]]

    result: dict[str, Any] = {
        "asset": {**table(document, "asset"), "version": "2.0"},
        "extensions": table(document, "extensions"),
        "samplers": [value for _, value in entries("samplers")],
        "buffers": [
            {k: v for k, v in value.items() if k != "uri" or name != "binary_glTF"}
            for name, value in entries("buffers")
        ],
        "bufferViews": [
            # A length of 0 meant "to the end", which no writer used; lengths are checked later.
            {**value, "buffer": find("buffers", value.get("buffer"))}
            for _, value in entries("bufferViews")
        ],
        "accessors": [_accessor(value, find) for _, value in entries("accessors")],
        "images": [_image(value, find) for _, value in entries("images")],
        "textures": [
            {
                "source": find("images", value.get("source")),
                **(
                    {"sampler": find("samplers", value["sampler"])}
                    if value.get("sampler") is not None
                    else {}
                ),
            }
            for _, value in entries("textures")
        ],
        "materials": [_material(name, value, find) for name, value in entries("materials")],
        "meshes": [
            {
                "name": value.get("name", name),
                "primitives": [
                    _primitive(primitive, find) for primitive in items(value, "primitives")
                ],
            }
            for name, value in entries("meshes")
        ],
        "scenes": [
            {"nodes": [find("nodes", node) for node in items(value, "nodes")]}
            for _, value in entries("scenes")
        ],
    }
    result["nodes"] = _nodes(entries("nodes"), find)
    if document.get("scene") is not None:
        result["scene"] = find("scenes", document["scene"])
    return result


def _accessor(value: dict[str, Any], find: _Find) -> dict[str, Any]:
    return {**value, "bufferView": find("bufferViews", value.get("bufferView"))}


def _image(value: dict[str, Any], find: _Find) -> dict[str, Any]:
    binary = table(table(value, "extensions"), "KHR_binary_glTF")
    if binary:
        return {"bufferView": find("bufferViews", binary.get("bufferView"))}
    return {"uri": value.get("uri")}


def _primitive(value: object, find: _Find) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MalformedError("a primitive is not an object")
    result: dict[str, Any] = {
        "mode": value.get("mode", value.get("primitive", 4)),
        "attributes": {
            {"BATCHID": "_BATCHID", "COLOR": "COLOR_0"}.get(key, key): find("accessors", name)
            for key, name in table(value, "attributes").items()
        },
    }
    if value.get("indices") is not None:
        result["indices"] = find("accessors", value["indices"])
    if value.get("material") is not None:
        result["material"] = find("materials", value["material"])
    return result


def _material(name: str, value: dict[str, Any], find: _Find) -> dict[str, Any]:
    common = table(table(value, "extensions"), "KHR_materials_common")
    values = {**table(value, "values"), **table(common, "values")}
    result: dict[str, Any] = {"name": value.get("name", name)}
    diffuse = values.get("diffuse", values.get("tex"))
    if isinstance(diffuse, list):
        result["pbrMetallicRoughness"] = {"baseColorFactor": (diffuse + [1.0])[:4]}
    elif isinstance(diffuse, str):
        texture = {"index": find("textures", diffuse)}
        result["pbrMetallicRoughness"] = {"baseColorTexture": texture}
    return result


def _nodes(entries: list[tuple[str, dict[str, Any]]], find: _Find) -> list[dict[str, Any]]:
    """Return the nodes; one with several meshes gets a child for each."""
    nodes: list[dict[str, Any]] = []
    further: list[dict[str, Any]] = []
    for name, value in entries:
        placing = ("matrix", "translation", "rotation", "scale")
        node: dict[str, Any] = {key: value[key] for key in placing if key in value}
        node["name"] = value.get("name", name)
        children = [find("nodes", child) for child in items(value, "children")]
        meshes = [find("meshes", mesh) for mesh in items(value, "meshes")]
        if len(meshes) == 1:
            node["mesh"] = meshes[0]
        else:
            for mesh in meshes:
                children.append(len(entries) + len(further))
                further.append({"mesh": mesh, "name": node["name"]})
        node["children"] = children
        nodes.append(node)
    return nodes + further
