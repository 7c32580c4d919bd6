"""A site with a small town on a slope, and sources of geometry for it."""

from pathlib import Path

import numpy as np
import shapely
import shapely.affinity
import yaml

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.reconstruct import ImportedModel, Surroundings, TriangleMesh
from urbantwin.reconstruct.georeference import Placed, SiteHeights, placed
from urbantwin.site.geometry import GeometrySource, GeometrySpec
from urbantwin.site.yaml_document import read_document

FRAME = SiteFrame(52.0117, 4.3667)
REGION = shapely.Point(0, 0).buffer(90.0)
ROADS = shapely.union_all(
    [
        shapely.LineString([(-120, -5), (120, 10)]).buffer(5),
        shapely.LineString([(10, -120), (-4, 120)]).buffer(4),
    ]
)


def slope(xy: np.ndarray) -> np.ndarray:
    """The site's ground: a plane with a slight swell, 0 at the anchor."""
    return 0.02 * xy[:, 0] - 0.01 * xy[:, 1] + 0.3 * np.sin(xy[:, 0] / 25.0)


def elevation() -> Elevation:
    x, y = np.meshgrid(np.arange(-130, 131, 1.0), np.arange(-130, 131, 1.0))
    raw = slope(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    return Elevation(-130.0, -130.0, 1.0, raw)


def town(seed: int = 3) -> tuple[shapely.Polygon, ...]:
    """Houses of all sizes and headings beside the roads."""
    random = np.random.default_rng(seed)
    houses: list[shapely.Polygon] = []
    while len(houses) < 22:
        x, y = random.uniform(-80, 80, 2)
        width, depth = random.uniform(7, 24, 2)
        house = shapely.affinity.rotate(
            shapely.box(x, y, x + width, y + depth), random.uniform(0, 90)
        )
        inside = house.within(REGION)
        if inside and not any(house.distance(other) < 4 for other in (*houses, ROADS)):
            houses.append(house)
    return tuple(houses)


def surroundings(
    footprints: tuple[shapely.Polygon, ...] = (), roads: shapely.Geometry = ROADS
) -> Surroundings:
    return Surroundings(REGION, roads, footprints, np.zeros((0, 3)))


def ground_mesh(height=slope, half: float = 100.0, step: float = 4.0) -> TriangleMesh:
    """A square of ground about the anchor."""
    line = np.arange(-half, half + step / 2, step)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    n = len(line)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.vstack(
        [
            np.column_stack([corner, corner + 1, corner + n + 1]),
            np.column_stack([corner, corner + n + 1, corner + n]),
        ]
    )
    xy = np.column_stack([x, y])
    return TriangleMesh.build(np.column_stack([xy, height(xy)]), faces)


def box(house: shapely.Polygon, height: float) -> TriangleMesh:
    """Walls and a flat roof over four corners, standing half a metre in the slope."""
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(house))[:4]
    base = slope(ring).min() - 0.5
    low = np.column_stack([ring, np.full(4, base)])
    vertices = np.vstack([low, low + [0, 0, height + 0.5]])
    faces = [[4, 5, 6], [4, 6, 7]]
    for a in range(4):
        b = (a + 1) % 4
        faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    return TriangleMesh.build(vertices, np.array(faces))


def town_mesh(footprints: tuple[shapely.Polygon, ...]) -> TriangleMesh:
    houses = [box(house, 5.0 + number % 4 * 2.5) for number, house in enumerate(footprints)]
    return TriangleMesh.concatenate([ground_mesh(), *houses])


def source(folder: Path, **spec) -> GeometrySource:
    """A source as a site.yaml in a folder names it."""
    entry = {"file": "model.obj", **spec}
    path = folder / "site.yaml"
    path.write_text(yaml.safe_dump({"geometry": [entry]}))
    return GeometrySource(GeometrySpec(**entry), read_document(path, kind="a site"), 0)


def place(
    folder: Path,
    model: ImportedModel,
    *,
    ground: Elevation | None = None,
    heights: SiteHeights | None = None,
    around: Surroundings | None = None,
    frame: SiteFrame = FRAME,
    **spec,
) -> Placed:
    around = around or surroundings()
    return placed(model, source(folder, **spec), frame, around, ground, heights=heights)


def mesh_of(points: np.ndarray, **more) -> ImportedModel:
    """A model of a few points, as a fan of triangles."""
    count = len(points)
    faces = np.column_stack(
        [np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)]
    )
    return ImportedModel(mesh=TriangleMesh.build(np.asarray(points, float), faces), **more)
