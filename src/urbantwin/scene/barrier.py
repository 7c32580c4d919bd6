"""Barriers along lines: walls, fences, guard rails, hedges."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.placement import grounded
from urbantwin.scene.pole import bollards
from urbantwin.scene.solids import Assembly, GroundHeight, box, sweep
from urbantwin.scene.tag import length_m_of
from urbantwin.scene.tree.shrub import hedge
from urbantwin.site.extract import OsmFeature

__all__ = ["barrier_mesh"]

#: Barriers are cut this far from carriageways, and open this wide at mapped gates, metres.
KERB_M = 0.25
GATE_M = 3.0
BURIED_M = 0.3
#: The ground is asked at least this often along a barrier; posts stand this far apart, metres.
STEP_M = 2.5
BOLLARDS_M = 1.5
SHORTEST_M = 0.5


@dataclass(frozen=True)
class _Form:
    """What a kind of barrier looks like: its make, default height and thickness, material."""

    make: str
    height_m: float
    thickness_m: float
    material: str
    semantic: str = "fence"


FORMS = {
    "fence": _Form("rails", 1.5, 0.05, "metal-painted"),
    "wall": _Form("solid", 1.8, 0.25, "brick"),
    "retaining_wall": _Form("solid", 0.8, 0.3, "concrete"),
    "city_wall": _Form("solid", 5.0, 1.2, "brick", "other-structure"),
    "guard_rail": _Form("guard", 0.75, 0.1, "metal-painted"),
    "handrail": _Form("handrail", 1.0, 0.05, "metal-painted"),
    "jersey_barrier": _Form("jersey", 0.85, 0.6, "concrete"),
    "block": _Form("solid", 0.6, 0.5, "concrete"),
    "hedge": _Form("hedge", 1.4, 0.8, "foliage", "vegetation"),
    "bollard": _Form("bollards", 0.9, 0.0, "metal-painted", "pole"),
}
SOLID_FENCES = ("wood", "wooden", "panel", "metal_panel", "wood_panel", "corrugated_metal", "slate")
WALL_MATERIALS = {
    "concrete": "concrete",
    "stone": "concrete",
    "dry_stone": "concrete",
    "brick": "brick",
    "wood": "wood",
    "gabion": "concrete",
    "plaster": "plaster",
}
OPENINGS = ("gate", "entrance", "swing_gate", "lift_gate", "sliding_gate", "kissing_gate", "stile")


def barrier_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build the barriers inside the region, following the ground.

    Walls are solid; fences are posts and rails, so that beams pass between them. Barriers are
    interrupted where a carriageway crosses and at mapped gates, which are themselves not drawn.

    Args:
        features: the map's features, site frame.
        region: barriers are cut at its border.
        ground_height: heights of the ground.
        carriageway: where no barrier may stand.

    Returns:
        The mesh, ``part`` 1, 2, ... per piece, and counts of what was built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    kept = region
    if not carriageway.is_empty:
        kept = shapely.difference(region, carriageway.buffer(KERB_M))
    gates = [
        f.geometry for f in features
        if isinstance(f.geometry, Point)
        and (f.tags.get("barrier") in OPENINGS or f.tags.get("entrance", "no") != "no")
    ]  # fmt: skip
    gate_tree = shapely.STRtree(gates)
    shapely.prepare(kept)
    for feature in features:
        form = FORMS.get(feature.tags.get("barrier", ""))
        if form is None or "building" in feature.tags:
            continue
        if isinstance(feature.geometry, Point):
            if feature.tags["barrier"] == "block" and kept.covers(feature.geometry):
                _add_block(assembly, feature, ground_height)
                notes["blocks"] += 1
            continue
        if feature.tags.get("layer", "0").startswith("-"):
            continue
        if form.make == "hedge" and isinstance(feature.geometry, Polygon):
            continue  # an area of shrubs: see tree_mesh
        form = _with_tags(form, feature.tags)
        lines = _lines(feature.geometry, kept, gates, gate_tree)
        for line in lines:
            _add_line(assembly, line, form, feature, ground_height)
        notes[feature.tags["barrier"]] += bool(lines)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _with_tags(form: _Form, tags: dict[str, str]) -> _Form:
    """Return a form with its mapped height, thickness and material."""
    height = min(length_m_of(tags.get("height")) or form.height_m, 15.0)
    thickness = min(length_m_of(tags.get("width")) or form.thickness_m, 3.0)
    make, material = form.make, form.material
    if make == "rails":
        thickness = form.thickness_m
        if tags.get("fence_type") in SOLID_FENCES:
            make = "solid"
            material = "metal-painted" if "metal" in tags["fence_type"] else "wood"
    if make == "solid":
        said = tags.get("material") or tags.get("wall") or ""
        material = WALL_MATERIALS.get(said, material)
    return _Form(make, height, thickness, material, form.semantic)


def _lines(
    geometry: Geometry, kept: Geometry, gates: Sequence[Point], gate_tree: shapely.STRtree
) -> list[LineString]:
    """Return the pieces of a barrier that stand, straight pieces split at every step."""
    line = geometry.boundary if isinstance(geometry, Polygon) else geometry
    line = shapely.intersection(line, kept)
    near = gate_tree.query(line, predicate="dwithin", distance=0.3)
    for k in sorted(near.tolist()):
        line = shapely.difference(line, gates[k].buffer(GATE_M / 2))
    if isinstance(line, shapely.MultiLineString):
        line = shapely.line_merge(line)
    pieces = [
        shapely.remove_repeated_points(piece, 0.05)
        for piece in shapely.get_parts(line)
        if isinstance(piece, LineString) and piece.length >= SHORTEST_M
    ]
    return [shapely.segmentize(piece, STEP_M) for piece in pieces if not piece.is_empty]


def _add_line(
    assembly: Assembly,
    line: LineString,
    form: _Form,
    feature: OsmFeature,
    ground_height: GroundHeight,
) -> None:
    """Add one piece of a barrier."""
    if form.make == "bollards":
        count = max(int(line.length / BOLLARDS_M), 1)
        spots = line.interpolate((np.arange(count) + 0.5) / count, normalized=True)
        xy = shapely.get_coordinates(spots)
        bollards(assembly, grounded(xy, ground_height(xy)), np.full(count, form.height_m))
        return
    if form.make == "hedge":
        line = shapely.segmentize(line, 0.7)
    xy = shapely.get_coordinates(line)
    closed = len(xy) > 3 and bool(np.allclose(xy[0], xy[-1]))
    if closed:
        xy = xy[:-1]
    path = grounded(xy, ground_height(xy))
    part = assembly.new_part()
    half, height = form.thickness_m / 2, form.height_m
    if form.make == "hedge":
        solid = hedge(path, height, form.thickness_m, feature.id, closed=closed)
        assembly.add(solid, form.semantic, form.material, part)
        return
    if form.make == "solid":
        strips = [_rectangle(half, half, -BURIED_M, height)]
    elif form.make == "jersey":
        strips = [_outline([(0.5, -0.1), (0.5, 0.1), (0.22, 0.35), (0.13, 1.0)], half, height)]
    elif form.make == "guard":
        strips = [_rectangle(0.02, 0.06, height - 0.31, height)]
    elif form.make == "handrail":
        strips = [_rectangle(0.025, 0.025, height - 0.05, height)]
    else:
        strips = [
            _rectangle(0.02, 0.02, up - 0.04, up + 0.04)
            for up in (0.15 * height, 0.55 * height, height - 0.04)
        ]
    for strip in strips:
        assembly.add(sweep(path, strip, closed=closed), form.semantic, form.material, part)
    if form.make in ("rails", "guard", "handrail"):
        centre = path + [0, 0, (height - BURIED_M) / 2]
        posts = box(centre, np.full((len(path), 3), [0.06, 0.06, height + BURIED_M]))
        assembly.add(posts, form.semantic, form.material, part)


def _rectangle(right: float, left: float, low: float, high: float) -> NDArray[np.float64]:
    return np.array([(left, low), (-right, low), (-right, high), (left, high)])


def _outline(
    steps: Sequence[tuple[float, float]], half: float, height: float
) -> NDArray[np.float64]:
    """Return a symmetric profile of (share of the thickness, share of the height) from below."""
    right = np.array([(-share * 2 * half, up * height) for share, up in steps])
    return np.concatenate([right, right[::-1] * [-1, 1]])


def _add_block(assembly: Assembly, feature: OsmFeature, ground_height: GroundHeight) -> None:
    xy = shapely.get_coordinates(feature.geometry)
    foot = grounded(xy, ground_height(xy))[0]
    height = min(length_m_of(feature.tags.get("height")) or 0.6, 2.0)
    centre = foot + [0, 0, (height - BURIED_M) / 2]
    solid = box(centre, [1.0, 0.5, height + BURIED_M])
    assembly.add(solid, "other-object", "concrete", assembly.new_part())
