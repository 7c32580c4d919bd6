"""Seconds to clean a street of a million triangles, beside Open3D and pymeshlab.

The mesh is made here, so that the truth is known: one scanned surface of a street on a slope with
cross-fall and curbs, into which houses and vehicles are melted as photogrammetry does it, with
lamp posts, trees and floating shards. UrbanTwin does all of it: crop, shards, traffic cut out and
the surface closed, decimation with a measured bound. The others do the parts that they can:
connected pieces, small ones dropped, and decimation to the same number of triangles.

    python benchmarks/clean.py
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import numpy as np
import shapely

from urbantwin.reconstruct import TriangleMesh
from urbantwin.reconstruct.cleaning import cleaned
from urbantwin.site.geometry import CleanSpec

SIDE_M = 220.0
ROAD_M = 12.0
SIDEWALK_M = 4.0
CURB_M = 0.15


def ground_height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The street without anything on it: two crossing roads, curbs, sidewalks, a slope."""
    plane = 0.04 * x + 0.5 * np.sin(y / 40)
    off = np.minimum(np.abs(x), np.abs(y))
    raised = np.clip((off - ROAD_M / 2) / 0.05, 0, 1) * CURB_M
    return plane + raised


def cars(generator: np.random.Generator) -> list[tuple[float, float, float, float, float, float]]:
    """x, y, yaw, length, width, height of vehicles along both roads, none near another."""
    placed = []
    for along in np.arange(-95.0, 96.0, 9.5):
        if abs(along) < 12:
            continue
        for road in (0, 1):
            side = generator.choice([-1, 1]) * generator.uniform(1.4, 4.3)
            size = (4.4, 1.8, 1.5) if generator.random() < 0.85 else (11.0, 2.5, 3.2)
            at = along + generator.uniform(-0.5, 0.5)
            if size[0] > 6 and (placed and placed[-1][3] > 6):
                size = (4.4, 1.8, 1.5)
            x, y = (at, side) if road == 0 else (side, at)
            if size[0] > 6:
                size = (8.0, 2.5, 3.2)
            placed.append((x, y, 0.0 if road == 0 else np.pi / 2, *size))
    return placed


def car_height(u: np.ndarray, v: np.ndarray, length: float, width: float, height: float):
    """Height over the ground of a car's body at places along and across it."""
    body = (np.abs(u) < length / 2) & (np.abs(v) < width / 2)
    roof = (u > -0.42 * length) & (u < 0.2 * length) if length < 6 else body
    return np.where(body, np.where(roof, height, 0.62 * height), 0.0)


def street(triangles: int = 1_000_000, seed: int = 7):
    """Return the mesh, its vehicles, and the roads."""
    generator = np.random.default_rng(seed)
    n = int(np.sqrt(triangles * 0.96 / 2)) + 1
    axis = np.linspace(-SIDE_M / 2, SIDE_M / 2, n)
    x, y = np.meshgrid(axis, axis)
    z = ground_height(x, y)
    vehicles = cars(generator)
    for cx, cy, yaw, *size in vehicles:
        c, s = np.cos(yaw), np.sin(yaw)
        u, v = (x - cx) * c + (y - cy) * s, -(x - cx) * s + (y - cy) * c
        z = z + car_height(u, v, *size)
    off = ROAD_M / 2 + SIDEWALK_M
    house = (np.abs(x) > off) & (np.abs(y) > off) & (np.abs(x) < 60) & (np.abs(y) < 60)
    house &= (np.abs(x) % 30 > 10) | (np.abs(y) % 30 > 10)
    z = np.where(house, z + 12.0, z)
    z = z + generator.normal(0, 0.003, z.shape)
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, 1:].ravel(), k[1:, :-1].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    colour = np.full((len(faces), 3), 90, np.uint8)
    parts = [TriangleMesh.build(points, faces.astype(np.int32), colour=colour, name="scan")]
    for side in (-1, 1):
        places = [along for along in np.arange(-100.0, 101.0, 25.0) if abs(along) > 15]
        parts += [post(along, side * (ROAD_M / 2 + 1.0)) for along in places]
    parts.append(shards(generator, max(triangles - sum(len(p.faces) for p in parts), 100)))
    roads = shapely.union_all(
        [
            shapely.box(-SIDE_M / 2, -ROAD_M / 2, SIDE_M / 2, ROAD_M / 2),
            shapely.box(-ROAD_M / 2, -SIDE_M / 2, ROAD_M / 2, SIDE_M / 2),
        ]
    )
    return TriangleMesh.concatenate(parts), vehicles, roads


def post(x: float, y: float) -> TriangleMesh:
    """Return a lamp post, a piece of its own that stands on the sidewalk."""
    ring = np.linspace(0, 2 * np.pi, 13)[:-1]
    base = float(ground_height(np.array(x), np.array(y)))
    low, high = (
        np.column_stack([x + 0.08 * np.cos(ring), y + 0.08 * np.sin(ring), np.full(12, base + h)])
        for h in (-0.1, 8.0)
    )
    i, j = np.arange(12), (np.arange(12) + 1) % 12
    faces = np.concatenate([np.column_stack([i, j, j + 12]), np.column_stack([i, j + 12, i + 12])])
    colour = np.full((24, 3), 160, np.uint8)
    return TriangleMesh.build(np.vstack([low, high]), faces.astype(np.int32), colour=colour)


def shards(generator: np.random.Generator, triangles: int) -> TriangleMesh:
    """Return floating pieces of two triangles, 0.1-1.5 m, 2-20 m over the ground."""
    count = triangles // 2
    middle = generator.uniform(-SIDE_M / 2, SIDE_M / 2, (count, 2))
    z = ground_height(middle[:, 0], middle[:, 1]) + generator.uniform(14, 30, count)
    size = generator.uniform(0.05, 0.75, (count, 1, 1))
    corner = generator.normal(0, 1, (count, 4, 3))
    corner = corner / np.linalg.norm(corner, axis=2, keepdims=True) * size
    points = (np.column_stack([middle, z])[:, None] + corner).reshape(-1, 3)
    first = 4 * np.arange(count)[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]]).astype(np.int32)
    colour = np.full((len(faces), 3), 200, np.uint8)
    return TriangleMesh.build(points, faces, colour=colour, name="shards")


def in_open3d(mesh: TriangleMesh, target: int) -> dict[str, float]:
    """Seconds of the parts that Open3D has."""
    import open3d as o3d

    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    whole = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    began = time.perf_counter()
    whole.remove_duplicated_vertices()
    whole.remove_degenerate_triangles()
    whole.remove_duplicated_triangles()
    tidy_s = time.perf_counter() - began
    began = time.perf_counter()
    of_face, count, _ = whole.cluster_connected_triangles()
    whole.remove_triangles_by_mask((np.asarray(count) < 20)[np.asarray(of_face)])
    pieces_s = time.perf_counter() - began
    began = time.perf_counter()
    whole.simplify_quadric_decimation(target)
    return {"tidy": tidy_s, "pieces": pieces_s, "decimation": time.perf_counter() - began}


def in_pymeshlab(mesh: TriangleMesh, target: int) -> dict[str, float]:
    """Seconds of the parts that MeshLab has."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    began = time.perf_counter()
    meshes.meshing_remove_duplicate_vertices()
    meshes.meshing_remove_null_faces()
    meshes.meshing_remove_duplicate_faces()
    tidy_s = time.perf_counter() - began
    began = time.perf_counter()
    meshes.meshing_remove_connected_component_by_face_number(mincomponentsize=20)
    pieces_s = time.perf_counter() - began
    began = time.perf_counter()
    meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=target, preserveboundary=True)
    return {"tidy": tidy_s, "pieces": pieces_s, "decimation": time.perf_counter() - began}


def found_and_false(vehicles: list, removed: list[dict], region: shapely.Geometry) -> dict:
    """How many vehicles were found, and what else was taken for one."""
    at = np.array([vehicle[:2] for vehicle in vehicles])
    inside = shapely.contains_xy(region, at[:, 0], at[:, 1])
    taken = np.array([one["at_m"][:2] for one in removed if one["what"] != "shard"]).reshape(-1, 2)
    apart = np.linalg.norm(at[:, None] - taken[None], axis=2)
    return {
        "vehicles": int(inside.sum()),
        "found": int((apart.min(axis=1) < 1.0)[inside].sum()),
        "false": int((apart.min(axis=0) > 1.0).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, default=1_000_000)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    mesh, vehicles, roads = street(given.triangles)
    region = shapely.Point(0, 0).buffer(SIDE_M / 2 - 5.0)
    sensors = [[8.0, 8.0, 6.0]]
    # Once on a small street, so that loading of libraries is not counted.
    cleaned(street(20_000)[0], CleanSpec(), region=region, roads=roads, sensors=sensors)
    began = time.perf_counter()
    result = cleaned(mesh, CleanSpec(), region=region, roads=roads, sensors=sensors)
    seconds = time.perf_counter() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    out: dict[str, object] = {
        "triangles": len(mesh.faces),
        "left": len(result.mesh.faces),
        "shards": sum(one["what"] == "shard" for one in result.report["removed"]),
        **found_and_false(vehicles, result.report["removed"], region.buffer(-6.0)),
        "urbantwin_s": round(seconds, 2),
        "memory_gb": round(memory, 2),
    }
    for name, judge in (("open3d", in_open3d), ("pymeshlab", in_pymeshlab)):
        try:
            parts = judge(mesh, len(result.mesh.faces))
        except ImportError:
            out[name] = "not installed"
            continue
        out |= {f"{name}_{part}_s": round(value, 2) for part, value in parts.items()}
        out[f"{name}_s"] = round(sum(parts.values()), 2)
        out[f"ratio_to_{name}"] = round(seconds / sum(parts.values()), 2)
    if given.json:
        print(json.dumps(out))
    else:
        for key, number in out.items():
            print(f"{key}: {number}")


if __name__ == "__main__":
    main()
