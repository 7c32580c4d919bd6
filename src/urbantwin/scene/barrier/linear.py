"""Barriers along lines: walls, fences, guard rails, kerb stones, hedges."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.barrier import fence
from urbantwin.scene.barrier.form import Form, form_of
from urbantwin.scene.barrier.gate import Opening, add_openings, add_point_barriers, opening_of
from urbantwin.scene.catalogue import street_objects
from urbantwin.scene.piece import add_pieces
from urbantwin.scene.placement import not_imported, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, sweep
from urbantwin.scene.tree.shrub import hedge, leafy_hedge
from urbantwin.site.extract import OsmFeature

__all__ = ["barrier_mesh"]

#: A W-beam is 310 mm high and 81 mm deep (EN 1317 profile A, AASHTO M 180).
BEAM_M, DEPTH_M = 0.31, 0.081
POST_M = (0.06, 0.12)
GUARD_RAIL_BURIED_M = 0.3


def w_beam(
    path: NDArray[np.float64], height: float, carriageway: Geometry, *, closed: bool
) -> list[Solid]:
    """Return a guard rail along (N, 3) points on the ground: the beam's two waves and its posts.

    The beam is on the side of the nearest carriageway.

    Args:
        path: base points of its posts.
        height: height of the beam's upper edge, metres.
        carriageway: the carriageways.
        closed: whether the path is a ring.
    """
    side = _traffic_side(path, carriageway)
    face = POST_M[0] / 2
    low = height - BEAM_M
    half = BEAM_M / 2
    waves = []
    for foot in (low, low + half):
        out = np.array([(face, 0.0), (face + DEPTH_M, 0.3), (face + DEPTH_M, 0.7), (face, 1.0)])
        profile = np.column_stack([-out[:, 0], foot + half * out[:, 1]])
        if side > 0:  # mirrored, counter-clockwise order restored
            profile = (profile * [-1, 1])[::-1]
        waves.append(sweep(path, profile, closed=closed))
    tall = height - 0.02 + GUARD_RAIL_BURIED_M
    way = np.roll(path, -1, axis=0) - path
    if not closed:
        way[-1] = path[-1] - path[-2]
    yaw = np.arctan2(way[:, 1], way[:, 0])
    centre = path + [0, 0, tall / 2 - GUARD_RAIL_BURIED_M]
    posts = box(centre, np.full((len(path), 3), [POST_M[1], POST_M[0], tall]), yaw)
    return [*waves, posts]


def _traffic_side(path: NDArray[np.float64], carriageway: Geometry) -> float:
    """Return 1 if traffic is to the left of a path, else -1."""
    if carriageway.is_empty:
        return -1.0
    middle = path[:-1, :2] + np.diff(path[:, :2], axis=0) / 2
    way = np.diff(path[:, :2], axis=0)
    left = np.column_stack([-way[:, 1], way[:, 0]])
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    far = [
        shapely.distance(carriageway, shapely.points(middle + sign * 0.5 * left)).sum()
        for sign in (1, -1)
    ]
    return 1.0 if far[0] < far[1] else -1.0


def concrete_barrier(
    path: NDArray[np.float64], thickness: float, height: float, *, closed: bool
) -> Solid:
    """Return a New Jersey profile: a base, a steep slope above it, and a vertical stem."""
    steps = [(0.5, -0.1), (0.5, 0.1), (0.22, 0.35), (0.13, 1.0)]
    right = np.array([(-share * thickness, up * height) for share, up in steps])
    return sweep(path, np.concatenate([right, right[::-1] * [-1, 1]]), closed=closed)


#: Minimum distance of barriers from carriageways, metres.
KERB_M = 0.25
BURIED_M = 0.3
#: Maximum distance of ground height samples along a barrier, and distance of posts, metres.
STEP_M = 2.5
GUARD_STEP_M = 2.0
BOLLARDS_M = 1.5
SHORTEST_M = 0.5
#: Kerb stones within this distance of a carriageway are curbs of the lane model, metres.
OWN_KERB_M = 2.5
LOWEST_KERB_M = 0.02
#: A line that turns by more than this is split into two barriers, radians.
SHARPEST = np.radians(100)


@dataclass(frozen=True)
class _Site:
    kept: Geometry
    openings: Sequence[Opening]
    near: shapely.STRtree
    ground_height: GroundHeight
    carriageway: Geometry


def barrier_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build the barriers inside the region, following the ground.

    Walls are solid; fences are posts with rails, bars, wires or a mesh, so that beams can pass.
    Barriers are interrupted at carriageways and at mapped gates and entrances. Gates of barriers
    are closed, except on carriageways.

    Args:
        features: the map's features, site frame.
        region: barriers are cut at its border.
        ground_height: heights of the ground.
        carriageway: area without barriers.
        without: area in which imported geometry contains the barriers.

    Returns:
        The mesh, ``part`` 1, 2, ... per piece, and counts of objects built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    mine = not_imported([f for f in features if _may_bar(f)], without)
    kept: Geometry = region
    if not carriageway.is_empty:
        kept = shapely.difference(region, carriageway.buffer(KERB_M))
    shapely.prepare(kept)
    openings = [o for o in map(opening_of, mine) if o is not None]
    near = shapely.STRtree([opening.spot for opening in openings])
    site = _Site(kept, openings, near, ground_height, carriageway)
    for feature in mine:
        form = form_of(feature.tags)
        if form is None or isinstance(feature.geometry, Point):
            continue
        if form.make == "hedge" and isinstance(feature.geometry, Polygon | shapely.MultiPolygon):
            continue  # an area of shrubs: see tree_mesh
        pieces = _pieces(feature.geometry, form, site)
        for piece in pieces:
            _add_line(assembly, piece, form, feature, site)
        notes[feature.tags["barrier"]] += bool(pieces)
    lines = [f for f in mine if not isinstance(f.geometry, Point)]
    ways = [f.geometry for f in features if "highway" in f.tags and region.intersects(f.geometry)]
    add_openings(assembly, openings, lines, ways, site.kept, ground_height, notes)
    add_point_barriers(assembly, mine, ways, site.kept, ground_height, notes)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _may_bar(feature: OsmFeature) -> bool:
    tags = feature.tags
    if "building" in tags or tags.get("layer", "0").startswith("-"):
        return False
    if tags.get("location") == "underground" or tags.get("tunnel", "no") not in ("no",):
        return False
    return "barrier" in tags or tags.get("entrance", "no") != "no" or tags.get("natural") == "stone"


def _pieces(geometry: Geometry, form: Form, site: _Site) -> list[LineString]:
    """Return the pieces of a barrier outside its gaps, split at hairpins."""
    if form.make == "kerb" and form.height_m < LOWEST_KERB_M:
        return []
    line = geometry.boundary if geometry.geom_type.endswith("Polygon") else geometry
    kept = site.kept
    if form.make == "kerb" and not site.carriageway.is_empty:
        kept = shapely.difference(kept, site.carriageway.buffer(OWN_KERB_M))
    line = shapely.intersection(line, kept)
    for k in sorted(site.near.query(line, predicate="dwithin", distance=0.3).tolist()):
        opening = site.openings[k]
        line = shapely.difference(line, opening.spot.buffer(opening.width_m / 2))
    if isinstance(line, shapely.MultiLineString):
        line = shapely.line_merge(line)
    step = GUARD_STEP_M if form.make == "guard" else 0.7 if form.make == "hedge" else STEP_M
    closest = max(0.05, form.thickness_m / 2)
    found = []
    for part in shapely.get_parts(line):
        if not isinstance(part, LineString):
            continue
        whole = [piece for piece in _unbent(part, closest) if piece.length >= SHORTEST_M]
        found += [shapely.segmentize(piece, step) for piece in whole]
    return found


def _unbent(line: LineString, closest: float) -> list[LineString]:
    """Split a line at sharp turns; drop points too close to the previous point."""
    closed = line.is_closed
    line = shapely.remove_repeated_points(line.simplify(closest / 10), closest)
    xy = shapely.get_coordinates(line)
    if len(xy) < 2 or line.length < closest:
        return []
    way = np.diff(xy, axis=0)
    yaw = np.arctan2(way[:, 1], way[:, 0])
    turn = np.abs(np.angle(np.exp(1j * np.diff(yaw))))
    sharp = np.flatnonzero(turn > SHARPEST) + 1
    if not len(sharp):
        ends = abs(np.angle(np.exp(1j * (yaw[0] - yaw[-1])))) if closed else 0.0
        return [line] if ends <= SHARPEST else [LineString(xy[:2]), LineString(xy[1:])]
    cuts = [0, *sharp.tolist(), len(xy) - 1]
    return [LineString(xy[a : b + 1]) for a, b in pairwise(cuts)]


def _add_line(
    assembly: Assembly, line: LineString, form: Form, feature: OsmFeature, site: _Site
) -> None:
    """Add one piece of a barrier."""
    if form.make == "bollards":
        count = max(int(line.length / BOLLARDS_M), 1)
        spots = line.interpolate((np.arange(count) + 0.5) / count, normalized=True)
        xy = shapely.get_coordinates(spots)
        feet = on_ground(xy, site.ground_height(xy))
        bollard = street_objects()["bollard"].pieces({"height": str(form.height_m)})
        for foot in feet:
            add_pieces(assembly, bollard, foot, 0.0)
        return
    xy = shapely.get_coordinates(line)
    closed = len(xy) > 3 and bool(np.allclose(xy[0], xy[-1]))
    if closed:
        xy = xy[:-1]
    path = on_ground(xy, site.ground_height(xy))
    part = assembly.new_part()
    half, height = form.thickness_m / 2, form.height_m
    make = form.make
    if make == "hedge":
        loose = "triangles" in feature.tags and not closed
        solids = (
            leafy_hedge(path, height, form.thickness_m, feature.id)
            if loose
            else [hedge(path, height, form.thickness_m, feature.id, closed=closed)]
        )
    elif make in ("solid", "kerb"):
        profile = fence.rectangle(half, half, -BURIED_M, height)
        solids = [sweep(path, profile, closed=closed)]
    elif make == "jersey":
        solids = [concrete_barrier(path, form.thickness_m, height, closed=closed)]
    elif make == "guard":
        solids = w_beam(path, height, site.carriageway, closed=closed)
    elif make == "handrail":
        solids = [
            fence.strip(path, 0.025, height - 0.05, height, closed=closed),
            fence.posts(path, height),
        ]
    else:
        solids = _fence(path, make, height, closed=closed)
    for solid in solids:
        assembly.add(solid, form.semantic, form.material, part)


def _fence(path: NDArray[np.float64], make: str, height: float, *, closed: bool) -> list[Solid]:
    """Return posts and the fence between them."""
    top = fence.strip(path, 0.02, height - 0.04, height, closed=closed)
    if make == "mesh":
        filling = [top, fence.lattice(path, 0.05, height - 0.04, closed=closed)]
    elif make == "bars":
        foot = fence.strip(path, 0.02, 0.1, 0.14, closed=closed)
        filling = [top, foot, fence.bars(path, 0.12, height - 0.02, closed=closed)]
    elif make == "pales":
        rails = [fence.strip(path, 0.02, u * height, u * height + 0.06, closed=closed)
                 for u in (0.25, 0.75)]  # fmt: skip
        filling = [*rails, fence.pales(path, 0.05, height, closed=closed)]
    elif make == "wires":
        filling = [fence.wires(path, np.array([0.3, 0.55, 0.8, 0.98]) * height, closed=closed)]
    elif make == "chain":
        filling = [fence.chain(path, 0.95 * height, closed=closed)]
    else:
        filling = [
            fence.strip(path, 0.02, up - 0.04, up + 0.04, closed=closed)
            for up in (0.15 * height, 0.55 * height, height - 0.04)
        ]
    return [*filling, fence.posts(path, height)]
