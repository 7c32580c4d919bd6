"""Delft from the air: our buildings and the reference model's beside the points of the survey.

The survey is two tiles of the Dutch AHN3, the outlines are the city's (BGT), the reference is what
3dfier made of both (LoD1 blocks). Judged are the points that the survey classifies as building
within a metre of an outline, by Open3D's closest point; the other way round, places on upward
faces are judged by their nearest such point. Once more our buildings are made of one random half
of the points and judged by the other half. The ground is judged by the other half of its points,
and the filter that unclassified surveys get by the survey's own classes.

    python benchmarks/delft.py
    python benchmarks/delft.py --data ../shared/data/airborne/delft-ahn3 --picture delft.png --json
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

import laspy
import numpy as np
import open3d as o3d
import shapely
from numpy.typing import NDArray
from pyproj import Transformer
from scipy.spatial import cKDTree

from urbantwin.geometry import LabelledMesh, SiteFrame
from urbantwin.reconstruct import PointCloud
from urbantwin.reconstruct.airborne import AirborneModel, from_airborne, read_footprints
from urbantwin.reconstruct.airborne.ground_filter import ground_by_filter
from urbantwin.reconstruct.airborne.noise import is_noise

DATA = Path(__file__).parents[2] / "shared/data/airborne/delft-ahn3"
MIDDLE = (84940.0, 447527.0)  # EPSG:28992
REGION = shapely.box(-130.0, -112.0, 130.0, 112.0)
NEAR_M = 1.0
TO_WGS84 = Transformer.from_crs(28992, 4326, always_xy=True)
Surface = tuple[NDArray[np.float64], NDArray[np.int64]]


def site_frame() -> SiteFrame:
    longitude, latitude = TO_WGS84.transform(*MIDDLE)
    return SiteFrame(latitude, longitude)


def placed(frame: SiteFrame, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of EPSG:28992 and NAP in the site frame; heights stay NAP's."""
    lonlat = np.column_stack(TO_WGS84.transform(points[:, 0], points[:, 1]))
    return np.column_stack([frame.site_from_lonlat(lonlat), points[:, 2]])


def survey(data: Path, frame: SiteFrame) -> PointCloud:
    tiles = [laspy.read(path) for path in sorted((data / "ahn3").glob("*.laz"))]
    return PointCloud(
        placed(frame, np.concatenate([tile.xyz for tile in tiles])),
        None,
        np.concatenate([np.asarray(tile.classification, np.uint8) for tile in tiles]),
        np.concatenate([np.asarray(t.return_number == t.number_of_returns) for t in tiles]),
    )


def reference(data: Path, frame: SiteFrame) -> Surface:
    """The buildings of the reference model: roofs and walls."""
    vertices, faces, wanted = [], [], False
    for line in (data / "reference/testarea.obj").read_text().splitlines():
        key, *rest = line.split() or [""]
        if key == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif key == "usemtl":
            wanted = rest[0] in ("Building", "BuildingWall")
        elif key == "f" and wanted:
            faces.append([int(x.split("/")[0]) - 1 for x in rest])
    return placed(frame, np.array(vertices)), np.array(faces)


def distances(surface: Surface, points: NDArray[np.float64]) -> NDArray[np.float64]:
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(surface[0].astype(np.float32), surface[1].astype(np.uint32))
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def backward(surface: Surface, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances of places on upward faces (one in a tenth of a square metre) to the points."""
    corners = surface[0][surface[1]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area = np.linalg.norm(normal, axis=1)
    up = normal[:, 2] > 0.2 * area
    random = np.random.default_rng(0)
    face = random.choice(np.flatnonzero(up), int(area[up].sum() / 0.1), p=area[up] / area[up].sum())
    u, v = random.random((2, len(face), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = np.moveaxis(corners[face], 1, 0)
    return np.asarray(cKDTree(points).query(a + u * (b - a) + v * (c - a))[0])


def mapped(model: AirborneModel, count: int) -> Surface:
    """The buildings over the first ``count`` outlines: those that the reference has too."""
    mesh = model.buildings.select(model.buildings.part <= count)
    return mesh.vertices, mesh.faces.astype(np.int64)


def row(name: str, values: NDArray[np.float64], triangles: int) -> dict[str, object]:
    quantile = np.percentile(values, [50, 95])
    return {
        "what": name,
        "median_m": round(float(quantile[0]), 3),
        "p95_m": round(float(quantile[1]), 3),
        "mean_m": round(float(values.mean()), 3),
        "places": len(values),
        "triangles": triangles,
    }


def measure(data: Path) -> tuple[dict[str, object], AirborneModel]:
    frame = site_frame()
    cloud = survey(data, frame)
    outlines = read_footprints(data / "bgt/bgt_pand.sqlite", frame, REGION)
    wide = shapely.union_all(outlines).buffer(NEAR_M)
    building = cloud.classification == 6
    judged = building & shapely.contains_xy(wide, cloud.points[:, 0], cloud.points[:, 1])
    points = cloud.points[judged]
    seconds = []
    for _ in range(2):
        began = time.perf_counter()
        model = from_airborne(cloud, footprints=outlines, region=REGION, name="AHN3")
        seconds.append(round(time.perf_counter() - began, 1))
    ours, theirs = mapped(model, len(outlines)), reference(data, frame)
    half = np.random.default_rng(0).random(len(cloud.points)) < 0.5
    part = from_airborne(cloud.select(half), footprints=outlines, region=REGION, name="half")
    fitted, held = mapped(part, len(outlines)), cloud.points[judged & ~half]
    rows = [
        row("points to reference", distances(theirs, points), len(theirs[1])),
        row("points to ours", distances(ours, points), len(ours[1])),
        row("other half to ours of one half", distances(fitted, held), len(fitted[1])),
        row("other half to reference", distances(theirs, held), len(theirs[1])),
        row("reference to points", backward(theirs, points), len(theirs[1])),
        row("ours to points", backward(ours, points), len(ours[1])),
    ]
    return {
        "rows": rows,
        "ground": ground(cloud, part, half),
        "report": model.report,
        "seconds_first_and_again": seconds,
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }, model


def ground(cloud: PointCloud, part: AirborneModel, half: NDArray[np.bool_]) -> dict[str, float]:
    """Bare earth beside points that it was not made of; the filter beside the survey's classes."""
    patch = part.ground
    earth = cloud.points[(cloud.classification == 2) & ~half]
    column = np.rint((earth[:, 0] - patch.west) / patch.step).astype(int)
    line = np.rint((earth[:, 1] - patch.south) / patch.step).astype(int)
    rows, columns = patch.heights.shape
    inside = (column >= 0) & (column < columns) & (line >= 0) & (line < rows)
    off = earth[inside, 2] - patch.heights[line[inside], column[inside]]
    off = off[np.isfinite(off)]
    clean = cloud.select(~is_noise(cloud))
    clean = clean.select(clean.classification != 26)
    truth = np.isin(clean.classification, (2, 9))
    found = ground_by_filter(clean.points)
    return {
        "rms_of_other_half_m": round(float(np.sqrt(np.mean(off**2))), 3),
        "filter_omission": round(float((truth & ~found).sum() / truth.sum()), 4),
        "filter_commission": round(float((found & ~truth).sum() / found.sum()), 4),
    }


def picture(model: AirborneModel, path: Path) -> None:
    """Draw buildings and trees from the south-east, shaded."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    mesh: LabelledMesh = model.buildings
    shade = 0.45 + 0.5 * np.clip(mesh.normals() @ (np.array([0.5, -0.6, 0.62])), 0, 1)
    roof = mesh.normals()[:, 2] > 0.1
    colour = np.where(roof[:, None], [0.80, 0.42, 0.32], [0.85, 0.80, 0.72]) * shade[:, None]
    figure = pyplot.figure(figsize=(16, 11))
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.add_collection3d(Poly3DCollection(mesh.triangles(), facecolors=colour))
    axes.set(xlim=(-120, 120), ylim=(-110, 110), zlim=(0, 60))
    axes.set_box_aspect((240, 220, 60), zoom=1.6)
    axes.view_init(50, -60)
    axes.set_axis_off()
    figure.savefig(path, dpi=110, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise SystemExit(f"{options.data} is missing")
    result, model = measure(options.data)
    if options.picture:
        picture(model, options.picture)
    if options.json:
        print(json.dumps(result, indent=1))
        return
    print(f"{'':34}{'median':>9}{'P95':>8}{'mean':>8}{'places':>9}{'triangles':>11}")
    for item in result["rows"]:  # type: ignore[attr-defined]
        print(
            f"{item['what']:34}{item['median_m']:7.3f} m{item['p95_m']:6.3f} m"
            f"{item['mean_m']:6.3f} m{item['places']:9}{item['triangles']:11}"
        )
    for key in ("ground", "report", "seconds_first_and_again", "memory_mb"):
        print(f"{key}: {result[key]}")


if __name__ == "__main__":
    main()
