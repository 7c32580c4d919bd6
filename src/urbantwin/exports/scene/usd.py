"""USD through Pixar's library: z up, metres."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.exports.mesh import Look, MeshObject
from urbantwin.extras import check_extra

__all__ = ["check_usd", "write_usd"]

#: Modules of Pixar's library, an optional extra.
_MODULES = ("Gf", "Sdf", "Usd", "UsdGeom", "UsdShade", "Vt")


def check_usd() -> None:
    """Check that USD is installed, before any work.

    Raises:
        InputError: USD is not installed.
    """
    check_extra("usd", "writing USD", place="--to usd")


def write_usd(
    objects: Sequence[MeshObject],
    path: Path,
    looks: Mapping[str, Look],
    extras: Mapping[str, object],
) -> None:
    """Write a stage: a mesh ``/World/NAME`` per object, with a face subset per material.

    Display names are the objects' names; classes and extras are custom data.

    Args:
        objects: objects to write, site frame.
        path: the file: ``.usda`` is text, ``.usd`` and ``.usdc`` are binary.
        looks: appearance of the objects' materials, by name.
        extras: custom data of the stage.

    Raises:
        InputError: USD is not installed.
    """
    check_usd()
    pixar = [importlib.import_module(f"pxr.{name}") for name in _MODULES]
    Gf, Sdf, Usd, UsdGeom, UsdShade, Vt = pixar
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    for key, value in _plain(extras).items():
        world.GetPrim().SetCustomDataByKey(f"urbantwin:{key}", value)
    shaders: dict[str, Any] = {}
    for name in sorted({label for one in objects for label in one.materials}):
        look = looks[name]
        material = UsdShade.Material.Define(stage, f"/World/Looks/{_token(name)}")
        shader = UsdShade.Shader.Define(stage, f"/World/Looks/{_token(name)}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*look.colour))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
        shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(look.alpha)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        material.GetPrim().SetDisplayName(name)
        for key, value in _plain(look.extras).items():
            material.GetPrim().SetCustomDataByKey(f"urbantwin:{key}", value)
        shaders[name] = material
    for one in objects:
        mesh = UsdGeom.Mesh.Define(stage, f"/World/{_token(one.name)}")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(one.vertices.astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(one.faces), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(one.faces.astype(np.int32).ravel()))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        low, high = one.vertices.min(axis=0), one.vertices.max(axis=0)
        mesh.CreateExtentAttr([Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))])
        prim = mesh.GetPrim()
        prim.SetDisplayName(one.name)
        for key, value in _plain(one.extras).items():
            prim.SetCustomDataByKey(f"urbantwin:{key}", value)
        binding = UsdShade.MaterialBindingAPI.Apply(prim)
        if len(one.materials) == 1:
            binding.Bind(shaders[one.materials[0]])
            continue
        for number, name in enumerate(one.materials):
            faces = np.flatnonzero(one.material == number).astype(np.int32)
            subset = binding.CreateMaterialBindSubset(_token(name), Vt.IntArray.FromNumpy(faces))
            UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(shaders[name])
    stage.GetRootLayer().Save()


def _token(name: str) -> str:
    """Return a valid USD name: letters, digits and underscores."""
    token = re.sub(r"\W", "_", name, flags=re.ASCII)
    return token if re.match(r"[A-Za-z_]", token) else f"_{token}"


def _plain(values: Mapping[str, object]) -> dict[str, object]:
    return {key: value for key, value in values.items() if value is not None}
