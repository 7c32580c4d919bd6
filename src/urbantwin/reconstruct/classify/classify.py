"""Classification of a cleaned mesh: ground as an elevation patch, objects by class and material."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_closing

from urbantwin.geometry import LabelledMesh
from urbantwin.ground import Elevation, ElevationPatch
from urbantwin.io.model import TriangleMesh
from urbantwin.reconstruct.classify.colours import default_material, material_of_colour
from urbantwin.reconstruct.classify.names import labels_of_names
from urbantwin.reconstruct.classify.shape import classes_by_shape
from urbantwin.reconstruct.classify.terrain import STEP_M, Terrain, terrain_of
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.reconstruct.cleaning.weld import pieces_of, selected, welded
from urbantwin.site.geometry import GeometrySpec
from urbantwin.taxonomy import material_id, materials, semantic_classes, semantic_id

__all__ = ["Classified", "classified"]

#: Classes that are the ground.
_GROUND = ("road", "parking", "sidewalk", "other-ground", "terrain")
#: Category of ``provides`` of a class; all other classes are ``other``.
_PROVIDES = {"building": "buildings", "vegetation": "trees", "trunk": "trees"}
#: Minimum ground area of a mesh, square metres.
_LEAST_GROUND_M2 = 20.0
#: Minimum share of ground in the plan of a model of the whole place.
_WHOLE = 0.3


@dataclass(frozen=True, eq=False)
class Classified:
    """The contents of a mesh.

    Attributes:
        mesh: objects on the ground: buildings, vegetation, poles, fences, decks, other. ``part``
            numbers its objects from 1.
        ground: the bare earth; nan under buildings; ``None`` if the mesh has none.
        covers: areas where the map's own objects are left out, by kind: ``buildings``, ``trees``,
            ``other``.
        report: triangles and area by class and material.
    """

    mesh: LabelledMesh
    ground: ElevationPatch | None
    covers: dict[str, shapely.Geometry] = field(default_factory=dict)
    report: dict[str, Any] = field(default_factory=dict)


def classified(
    mesh: TriangleMesh,
    spec: GeometrySpec,
    *,
    elevation: Elevation | None = None,
    roads: shapely.Geometry | None = None,
    name: str = "",
) -> Classified:
    """Classify the triangles of a mesh, and assign materials.

    The labels of a file have priority, then the names of its objects and materials, then shape and
    colour: the lowest connected surface is the ground, faces in all directions are plants, high and
    wide objects are buildings.

    Args:
        mesh: cleaned, site frame, metres.
        spec: the user's settings: class and material of the whole mesh, and what it provides.
        elevation: the ground from other sources, for meshes without ground.
        roads: carriageways, to find decks over them.
        name: name of the source.
    """
    if not len(mesh.faces):
        return Classified(LabelledMesh.empty(), None)
    mesh = welded(mesh)
    said, of_material = labels_of_names(mesh.names)
    semantic = said[mesh.object]
    material = of_material[mesh.object]
    if mesh.semantic is not None:
        semantic = np.where(mesh.semantic > 0, mesh.semantic, semantic)
    if spec.semantic != "auto":
        semantic[:] = semantic_id(spec.semantic)
    semantic = semantic.astype(np.uint16)
    earth = np.isin(semantic, [semantic_id(one) for one in _GROUND])
    terrain = terrain_of(mesh, earth, (semantic > 0) & ~earth, elevation)
    lawn = (semantic == semantic_id("vegetation")) & terrain.lies_low(mesh)
    terrain = replace(terrain, is_ground=terrain.is_ground | lawn)
    stands = ~terrain.is_ground
    unsaid = stands & (semantic == 0)
    if unsaid.any():
        semantic[unsaid] = classes_by_shape(selected(mesh, unsaid), terrain, roads)
    material = _materials(mesh, semantic, material)
    if spec.material != "auto":
        material[:] = material_id(spec.material)

    kinds = np.full(max(one.id for one in semantic_classes().values()) + 1, "other", "<U9")
    for one, kind in _PROVIDES.items():
        kinds[semantic_id(one)] = kind
    of_kind = kinds[semantic]
    patch = _patch(mesh, terrain, semantic == semantic_id("building"), name)
    covers = _covers(terrain, stands, of_kind, patch, spec)
    wanted = stands & np.isin(of_kind, spec.provides)
    part = selected(mesh, wanted)
    numbers = pieces_of(part).of_face + 1 if len(part.faces) else np.zeros(0, np.int32)
    out = LabelledMesh.build(part.vertices, part.faces, semantic[wanted], material[wanted], numbers)
    return Classified(out, patch, covers, _report(out, patch))


def _materials(
    mesh: TriangleMesh, semantic: NDArray[np.uint16], said: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return the material (F,) of every triangle, from its name, otherwise from its colour."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    cross = np.cross(b - a, c - a)
    level = np.abs(cross[:, 2]) > 0.5 * np.linalg.norm(cross, axis=1)
    building = semantic == semantic_id("building")
    plant = np.isin(semantic, [semantic_id("vegetation"), semantic_id("trunk")])
    colour = mesh.colour
    if colour is not None and np.ptp(colour, axis=0).max(initial=0) == 0:
        colour = None  # a uniform colour is the viewer's, not the place's
    out = np.zeros(len(semantic), np.uint8)
    groups = {
        "roof": building & level,
        "wall": building & ~level,
        "plant": plant,
        "thing": ~(building | plant),
    }
    for where, some in groups.items():
        if colour is None:
            out[some] = default_material(where)
        else:
            out[some] = material_of_colour(where, colour[some])
    out[semantic == semantic_id("trunk")] = material_id("bark")
    metal = np.isin(semantic, [semantic_id("pole"), semantic_id("traffic-sign")])
    out[metal] = material_id("metal-painted")
    out[semantic == semantic_id("other-structure")] = material_id("concrete")
    # "Roof" names the part, not its material; colours say more.
    vague = np.isin(said, [material_id("roofing"), material_id("plaster")]) & (colour is not None)
    return np.where((said > 0) & ~vague, said, out).astype(np.uint8)


def _patch(
    mesh: TriangleMesh, terrain: Terrain, building: NDArray[np.bool_], name: str
) -> ElevationPatch | None:
    """Return the bare earth on nodes; nan under buildings and where it is unknown."""
    grid = terrain.grid
    ground = selected(mesh, terrain.is_ground)
    if not len(ground.faces):
        return None
    below = float(mesh.vertices[:, 2].min()) - 1.0
    heights = Rays(ground.vertices, ground.faces).heights(grid.centres(), below, up=True)
    heights = heights.reshape(grid.shape)
    roofed = (terrain.top_face >= 0) & building[terrain.top_face]
    heights[roofed] = np.nan
    if np.isfinite(heights).sum() * grid.step**2 < _LEAST_GROUND_M2:
        return None
    half = grid.step / 2
    return ElevationPatch(
        grid.west + half, grid.south + half, grid.step, heights, max(STEP_M, grid.step), name
    )


def _covers(
    terrain: Terrain,
    stands: NDArray[np.bool_],
    of_kind: NDArray[np.str_],
    patch: ElevationPatch | None,
    spec: GeometrySpec,
) -> dict[str, shapely.Geometry]:
    """Return the areas where the map's own objects are left out.

    A model of the whole place, including the ground, shows everything: for each kind that it
    contains, it covers its whole extent. A model of single objects covers their footprints.
    """
    grid, face = terrain.grid, terrain.top_face
    seen = face >= 0
    area: dict[str, shapely.Geometry] = {}
    shown = patch is not None and np.isfinite(patch.heights).sum() > _WHOLE * seen.sum()
    for kind in ("buildings", "trees", "other"):
        if kind not in spec.provides:
            continue
        mask = seen & stands[face] & (of_kind[face] == kind)
        if shown and mask.any():
            mask = binary_closing(np.pad(seen, 4), np.ones((5, 5), bool))[4:-4, 4:-4] | seen
        shape = shapely.simplify(grid.squares(mask), grid.step)
        if not shape.is_empty:
            area[kind] = shapely.make_valid(shape)
    return area


def _report(mesh: LabelledMesh, patch: ElevationPatch | None) -> dict[str, Any]:
    """Return triangles and square metres by class and by material."""
    areas = mesh.areas()
    out: dict[str, Any] = {"objects": int(mesh.part.max(initial=0))}
    for title, numbers, names in (
        ("classes", mesh.semantic, {one.id: one.name for one in semantic_classes().values()}),
        ("materials", mesh.material, {one.id: one.name for one in materials().values()}),
    ):
        out[title] = {
            names[number]: {
                "triangles": int((numbers == number).sum()),
                "area_m2": round(float(areas[numbers == number].sum()), 1),
            }
            for number in np.unique(numbers).tolist()
        }
    if patch is not None:
        known = float(np.isfinite(patch.heights).sum())
        out["ground_m2"] = round(known * patch.step**2, 1)
    return out
