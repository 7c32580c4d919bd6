"""Every backend finds the same hits: Embree, bvh, Warp and Open3D against double precision.

What a backend may answer is defined by moving things. A ray tracer in single precision sees
every triangle up to `delta` away from where it is, with ``delta = 2^-20`` of the distance from
the ray's origin (a few roundings of a coordinate: 0.1 mm at 100 metres). A triangle is

- *surely* met if it is met wherever its corners are moved by up to ``delta``: the ray then enters
  the slab of that half thickness around its plane, and leaves it, inside its border less
  ``delta``;
- *possibly* met if it may be met when its corners are moved so: some part of the ray lies in that
  slab inside its border plus ``delta``.

An answer is right if it is the range on a surely met triangle's plane, to 1 mm, or lies on the
part of the ray that possibly meets one; and if no surely met triangle lies wholly before it. "No
hit" is right if no triangle is surely met. Where only one range is right, to 1 mm, all backends
so agree within 1 mm; elsewhere the ray runs within ``delta`` of a border (a silhouette, the line
where two surfaces cross) or along a surface.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import open3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import Hits, RayScene
from urbantwin.lidar.actor_path import Paths
from urbantwin.lidar.casting.processor import ProcessorTracer
from urbantwin.lidar.casting.tracer import Blocks, Casting, Firing, Spread
from urbantwin.lidar.shapes import ActorShape, PresentActors, Shapes

MILLIMETRE = 1e-3
#: Of single precision, and of double precision.
SINGLE, DOUBLE = 2.0**-20, 1e-11

Cast = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], Hits]


def embree(vertices, faces, origins, directions):
    return RayScene(vertices, faces, library="embree").cast(origins, directions)


def bvh(vertices, faces, origins, directions):
    return RayScene(vertices, faces, library="bvh").cast(origins, directions)


def warp(vertices, faces, origins, directions):
    pytest.importorskip("warp", reason="the extra 'warp' is not installed")
    from urbantwin.lidar.casting.warp import WarpTracer

    return thin_rays(WarpTracer("cpu"), vertices, faces, origins, directions)


def packets(vertices, faces, origins, directions):
    """Cast eight at a time, as Embree casts whole turns at the street."""
    tracer = ProcessorTracer("embree")
    return thin_rays(tracer, vertices, faces, origins, directions, around=True)


def bvh_packets(vertices, faces, origins, directions):
    return thin_rays(ProcessorTracer("bvh"), vertices, faces, origins, directions, around=True)


def thin_rays(tracer, vertices, faces, origins, directions, *, around=False):
    """Cast rays as the beams of a turn in which each column stands somewhere else.

    With arrays and numbers of the same types as frames have: numba compiles nothing again.
    """
    rays, face = len(directions), np.zeros(len(faces))
    mesh = LabelledMesh(np.asarray(vertices, np.float64), faces, face, face.astype(int), face)
    firing = Firing(
        np.zeros(rays),
        np.zeros(1),
        np.tile(np.eye(3), (rays, 1, 1)),
        np.array(np.broadcast_to(origins, (rays, 3)), np.float64, order="C"),
        directions.astype(np.float64),
        np.zeros((1, 2)),
    )
    world = Shapes.of([ActorShape(mesh, with_hull=False)])
    standing = PresentActors(world, np.zeros(1, np.int64), Paths.standing())
    block = Blocks(*np.array([[0], [1], [rays], [0]]), np.arange(rays, dtype=np.int32))
    met = tracer.layers(firing, standing, block, Casting(False, int(Spread.NOWHERE), around))
    hits = Hits(np.full(rays, np.inf, np.float32), np.full(rays, -1, np.int32))
    hits.range_m[met.ray], hits.face[met.ray] = met.range_m, met.face
    return hits


def open3d_(vertices, faces, origins, directions):
    """Cast with Open3D, which is spared triangles that are lines: it sees them elsewhere."""
    solid = np.flatnonzero(~are_lines(vertices[faces]))
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces[solid].astype(np.uint32))
    rays = np.hstack([np.broadcast_to(origins, directions.shape), directions]).astype(np.float32)
    found = scene.cast_rays(open3d.core.Tensor(rays))
    range_m = found["t_hit"].numpy()
    face = np.full(len(rays), -1, np.int32)
    hit = np.isfinite(range_m)
    face[hit] = solid[found["primitive_ids"].numpy()[hit]]
    return Hits(range_m, face)


class Met(NamedTuple):
    """How N rays meet F triangles, (N, F) each."""

    at: np.ndarray  # on the plane
    enter: np.ndarray  # where it possibly begins to meet it; inf if it does not
    leave: np.ndarray
    surely: np.ndarray


def meetings(corners, origins, directions, share, least=0.0) -> Met:
    """Work out how rays meet triangles (F, 3, 3), straight from the definition above."""
    a = corners[None]
    o, d = origins[:, None], directions[:, None].astype(np.float64)
    d = d / np.linalg.norm(d, axis=2, keepdims=True)
    delta = least + share * np.linalg.norm(a - o[:, :, None], axis=3).max(axis=2)
    normal = normals(corners)[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        slant = (normal * d).sum(axis=2)
        height = (normal * (a[:, :, 0] - o)).sum(axis=2)
        at = height / slant
        half = delta / np.abs(slant)
        along = slant == 0
        near = np.abs(height) <= delta
        low = np.where(along, np.where(near, 0.0, np.inf), np.maximum(at - half, 0.0))
        high = np.where(along, np.where(near, np.inf, -np.inf), at + half)
        surely = ~along & (at - half > 0)
        for k in range(3):
            p, q = a[:, :, k], a[:, :, (k + 1) % 3]
            inward = np.cross(normal, q - p)
            inward /= np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), 1e-300)
            start, step = (inward * (o - p)).sum(axis=2), (inward * d).sum(axis=2)
            for end in (at - half, at + half):
                surely &= start + step * end > delta
            cut = -(start + delta) / step
            low = np.where(step > 0, np.maximum(low, cut), low)
            high = np.where(step < 0, np.minimum(high, cut), high)
            high = np.where((step == 0) & (start + delta < 0), -np.inf, high)
        # Beyond a sharp corner the widened borders run on: no farther than the bounds do.
        for axis in range(3):
            below = a[..., axis].min(axis=2) - delta - o[..., axis]
            above = a[..., axis].max(axis=2) + delta - o[..., axis]
            one, other = below / d[..., axis], above / d[..., axis]
            still = d[..., axis] == 0
            low = np.where(still, low, np.maximum(low, np.minimum(one, other)))
            high = np.where(still, high, np.minimum(high, np.maximum(one, other)))
            high = np.where(still & ((below > 0) | (above < 0)), -np.inf, high)
    possibly = low <= high
    surely &= possibly
    return Met(
        np.where(surely, at, np.nan),
        np.where(possibly, low, np.inf),
        np.where(possibly, high, -np.inf),
        surely,
    )


def are_lines(corners):
    """Return which triangles (F, 3, 3) are less wide than a nanometre."""
    edges = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return area <= 1e-9 * np.linalg.norm(edges, axis=2).max(axis=1)


def normals(corners):
    """Return unit normals (F, 3); of a triangle that is a line, any that is square to it."""
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    for number in np.flatnonzero(are_lines(corners)):
        longest = edges[number, np.linalg.norm(edges[number], axis=1).argmax()]
        axis = np.eye(3)[np.abs(longest).argmin()]
        normal[number] = np.cross(longest, axis) if longest.any() else axis
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def right(met: Met, hits: Hits):
    """Return which of the answers (N,) are right."""
    ray = np.arange(len(hits.face))
    at, face = hits.range_m.astype(np.float64), hits.face
    of_face = Met(*(column[ray, face] for column in met))
    on_plane = np.abs(at - of_face.at) <= MILLIMETRE
    within = (at >= of_face.enter - MILLIMETRE) & (at <= of_face.leave + MILLIMETRE)
    first = at <= blocked(met) + MILLIMETRE
    hit = first & np.where(of_face.surely, on_plane, within)
    return np.where(face >= 0, hit, np.isinf(at) & ~met.surely.any(axis=1))


def blocked(met: Met):
    """Return where (N,) the first surely met triangle ends; inf without one."""
    return np.where(met.surely, met.leave, np.inf).min(axis=1)


def certain(met: Met):
    """Return for which rays (N,) all right answers are one, to 1 mm."""
    end = blocked(met)[:, None]
    nearest = np.where(met.surely, met.at, met.enter).min(axis=1)
    ahead = met.enter <= end
    farthest = np.where(ahead, np.where(met.surely, met.at, met.leave), -np.inf).max(axis=1)
    none = np.isinf(met.enter).all(axis=1)
    return none | (met.surely.any(axis=1) & (farthest - nearest <= MILLIMETRE))


def assert_same(vertices, faces, origins, directions):
    """Compare all backends with the definition, and with each other; return who was certain."""
    vertices, origins = np.asarray(vertices, np.float64), np.asarray(origins, np.float64)
    directions = np.asarray(directions, np.float64)
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    corners = vertices[faces]
    single = meetings(corners, origins, directions, SINGLE)
    double = meetings(corners, origins, directions, DOUBLE, 1.01e-9)
    ours = {
        "embree": embree(vertices, faces, origins, directions),
        "packets": packets(vertices, faces, origins, directions),
        "bvh": bvh(vertices, faces, origins, directions),
        "bvh packets": bvh_packets(vertices, faces, origins, directions),
        "warp": warp(vertices, faces, origins, directions),
    }
    for name, hits in ours.items():
        wrong = np.flatnonzero(~right(single, hits))
        assert not len(wrong), (name, origins[wrong[0]], directions[wrong[0]])
    wrong = np.flatnonzero(~right(double, ours["warp"]))
    assert not len(wrong), ("warp", origins[wrong[0]], directions[wrong[0]])

    # The range on the plane of the triangle that Open3D says: its own is of single precision.
    judge = open3d_(vertices, faces, origins, directions)
    ray = np.flatnonzero(judge.face >= 0)
    plane = single.at[ray, judge.face[ray]]
    judge.range_m[ray] = np.where(np.isnan(plane), judge.range_m[ray], plane)

    sure = certain(single)
    # Open3D sees a triangle that a ray runs along metres away from where it is.
    judged = sure & ~runs_along(corners, origins, directions)
    others = [(hits, sure) for hits in ours.values()]
    for hits, chosen in [*others, (judge, judged)]:
        one, other = ours["embree"].range_m[chosen], hits.range_m[chosen]
        np.testing.assert_array_equal(np.isinf(one), np.isinf(other))
        hit = np.isfinite(one)
        assert np.abs(one[hit] - other[hit]).max(initial=0.0) <= MILLIMETRE
    return sure


def runs_along(corners, origins, directions):
    """Return which rays (N,) run in the plane of any triangle, as single precision sees it."""
    normal = normals(corners)
    away = corners[None, :, 0] - origins[:, None]
    height = np.abs((normal * away).sum(axis=2))
    slant = np.abs(directions.astype(np.float64) @ normal.T)
    near = height <= 4 * SINGLE * np.linalg.norm(away, axis=2)
    return (near & (slant <= 4 * SINGLE)).any(axis=1)


def turned(seed):
    """Return a rotation matrix; the identity for 0."""
    return np.eye(3) if seed == 0 else Rotation.random(random_state=seed).as_matrix()


lattice = st.tuples(*[st.integers(0, 4)] * 3)


@settings(max_examples=30, deadline=None)
@given(
    vertices=st.lists(lattice, min_size=3, max_size=12),
    faces=st.lists(st.tuples(*[st.integers(0, 11)] * 3), min_size=1, max_size=12),
    origins=st.lists(lattice, min_size=1, max_size=4),
    targets=st.lists(
        st.tuples(st.integers(0, 11), st.integers(0, 2), st.integers(0, 2), st.integers(0, 2)),
        min_size=1,
        max_size=12,
    ),
    spacing=st.sampled_from([0.1, 1.0, 12.5, 37.0]),
    turn=st.sampled_from([0, 1, 2]),
    aside=st.sampled_from([0.0, 0.3]),
)
def test_rays_at_corners_and_edges_and_along_surfaces(
    vertices, faces, origins, targets, spacing, turn, aside
):
    """Everything stands on a lattice, so most rays run through corners, edges and planes."""
    faces = np.array(faces, np.int32) % len(vertices)
    rotation = turned(turn) * spacing
    vertices = np.array(vertices, float)
    aims = [
        (vertices[faces[face % len(faces)]] * np.array(weights)[:, None]).sum(axis=0) / sum(weights)
        for face, *weights in targets
        if sum(weights)
    ]
    rays = [
        (origin, aim - origin)
        for origin in np.array(origins, float) + [aside, 0.0, -aside]
        for aim in aims
        if np.abs(aim - origin).max() > 1e-6
    ]
    if rays:
        start, direction = np.array(rays).transpose(1, 0, 2)
        assert_same(vertices @ rotation.T, faces, start @ rotation.T, direction @ rotation.T)


def soup(rng, size):
    """Return triangles of all sizes and shapes, slivers among them, in a cube of 200 m."""
    middle = rng.uniform(-100, 100, (size, 1, 3))
    spread = 10.0 ** rng.uniform(-2, 2, (size, 1, 1))
    corners = middle + spread * rng.normal(size=(size, 3, 3)) * 10.0 ** rng.uniform(
        -4, 0, (size, 1, 3)
    )
    return corners.reshape(-1, 3), np.arange(3 * size, dtype=np.int32).reshape(-1, 3)


def street(rng, size):
    """Return a ground of large triangles, and boxes that stand on it and reach into it."""
    x, y = (line.ravel() for line in np.meshgrid(*[np.linspace(-120, 120, 7)] * 2))
    cell = np.array([7 * i + j for i in range(6) for j in range(6)])
    ground = np.column_stack([x, y, rng.uniform(-0.05, 0.05, len(x))])
    parts = [ground]
    faces = [
        np.column_stack([cell, cell + 1, cell + 8]),
        np.column_stack([cell, cell + 8, cell + 7]),
    ]
    box = ConvexHull(np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T)
    for _ in range(size // 12):
        half = rng.uniform([0.2, 0.2, 0.5], [15, 15, 10])
        yaw = Rotation.from_euler("z", rng.uniform(0, 6.3)).as_matrix()
        place = [*rng.uniform(-100, 100, 2), half[2] - rng.choice([0.0, 0.3])]
        faces.append(box.simplices + sum(map(len, parts)))
        parts.append(box.points * half @ yaw.T + place)
    return np.vstack(parts), np.vstack(faces).astype(np.int32)


@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    world=st.sampled_from([soup, street]),
    size=st.sampled_from([3, 24, 60]),
    kind=st.sampled_from(["anywhere", "edges", "corners", "grazing"]),
    anchor=st.sampled_from([0.0, 150.0]),
)
def test_random_worlds(seed, world, size, kind, anchor):
    rng = np.random.default_rng(seed)
    vertices, faces = world(rng, size)
    vertices = vertices + anchor * np.array([1.0, -0.5, 0.0])
    count = 150
    origins = rng.uniform([-60, -60, 0.5], [60, 60, 12], (count, 3)) + anchor * np.array(
        [1, -0.5, 0]
    )
    corners = vertices[rng.choice(faces, count)]
    weights = rng.dirichlet([1, 1, 1], count)
    if kind == "edges":
        weights[:, 0] = 0
        weights /= weights.sum(axis=1, keepdims=True)
    elif kind == "corners":
        weights = np.eye(3)[rng.integers(0, 3, count)]
    aims = (corners * weights[..., None]).sum(axis=1)
    if kind == "anywhere":
        aims = origins + rng.normal(size=(count, 3))
    elif kind == "grazing":
        # From beside the triangle, nearly or exactly in its plane.
        lift = rng.choice([0.0, 1e-6, 1e-4, 1e-3, 1e-2], count)[:, None] * normals(corners)
        across = corners[:, 1] - corners[:, 0]
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        origins = aims + 60 * (across + lift)
    sure = assert_same(vertices, faces, origins, aims - origins)
    if kind == "anywhere":
        assert sure.mean() > 0.95


@pytest.mark.parametrize("backend", [embree, packets, bvh, bvh_packets, warp])
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([0.5, 8.0, 120.0]))
def test_no_ray_leaves_a_closed_surface(backend, seed, size):
    """A convex body from inside, at its corners and edges: the nearest of its planes, always."""
    rng = np.random.default_rng(seed)
    hull = ConvexHull(rng.normal(size=(rng.integers(5, 40), 3)) * size)
    corners = hull.points[hull.simplices]
    origin = hull.points[hull.vertices].mean(axis=0)
    share = rng.uniform(size=(len(corners), 3, 1))
    edges = corners * share + np.roll(corners, 1, axis=1) * (1 - share)
    aims = np.vstack([corners.reshape(-1, 3), edges.reshape(-1, 3), corners.mean(axis=1)])
    directions = aims - origin
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    normal, offset = hull.equations[:, :3], hull.equations[:, 3]
    with np.errstate(divide="ignore"):
        planes = -(normal @ origin + offset) / (directions.astype(float) @ normal.T)
    expected = np.where(planes > 0, planes, np.inf).min(axis=1)
    hits = backend(hull.points, hull.simplices.astype(np.int32), origin, directions)
    if backend in {embree, packets}:
        # Exactly at a corner, a ray may slip through in Embree, as it does in Open3D.
        away = hull.points[hull.vertices] - origin
        aside = np.linalg.norm(np.cross(away[None], directions[:, None]), axis=2)
        ahead = directions @ away.T > 0
        sharp = (ahead & (aside < SINGLE * np.linalg.norm(away, axis=1))).any(axis=1)
        assert not sharp[-len(corners) :].any()
        seen = ~(sharp & (hits.face < 0))
        hits = Hits(hits.range_m[seen], hits.face[seen])
        directions, expected = directions[seen], expected[seen]
    assert (hits.face >= 0).all()
    # A thin body's edges are seen at a slant: there a rounding goes a longer way.
    steep = np.abs((directions * normal[hits.face]).sum(axis=1))
    assert (np.abs(hits.range_m - expected) <= MILLIMETRE + SINGLE * size * 8 / steep).all()
