"""Sources of geometry as a test writes them, and shapes that everybody agrees on."""

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.io import read_model
from urbantwin.site.geometry import GeometrySource, GeometrySpec
from urbantwin.site.yaml_document import Document

FRAME = SiteFrame(52.01, 4.36)
REGION = shapely.box(-60, -60, 60, 60)


def source_of(path, **fields):
    spec = GeometrySpec(file=path.name, **fields)
    return GeometrySource(spec, Document(path.parent / "site.yaml", {"geometry": [{}]}), 0)


def read(path, frame=FRAME, region=REGION, **fields):
    return read_model(source_of(path, **fields), frame, region)


def area(mesh):
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume(mesh):
    """Of a closed surface, by the divergence theorem; positive where normals point outward."""
    a, b, c = np.moveaxis(mesh.triangles() - mesh.vertices.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


#: A box of 2 x 3 x 4 as quads, counter-clockwise from outside.
BOX = np.array([[x, y, z] for x in (0, 2) for y in (0, 3) for z in (0, 4)], float)
BOX_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
