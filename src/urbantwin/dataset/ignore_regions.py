"""``ignore_regions.geojson``: areas where labels of a dataset do not count."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import shapely
from pydantic import Field

from urbantwin.artefact import read_json, write_json
from urbantwin.artefact.arrays import one_line
from urbantwin.artefact.manifest import Part, validated
from urbantwin.cluster import Cluster
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Rig
from urbantwin.lidar.sight import IgnoreArea, ignore_areas
from urbantwin.processes import Helpers, begun, handed, pool_of, received

__all__ = ["IGNORE_REGIONS", "areas_of", "read_ignore_regions", "write_ignore_regions"]

#: The file in a dataset's folder.
IGNORE_REGIONS = "ignore_regions.geojson"
#: Resolution of coordinates, metres.
_GRID_M = 0.01
_Metres = Annotated[float, Field(ge=-1e6, le=1e6)]
_Point = Annotated[list[_Metres], Field(min_length=2, max_length=3)]
_Rings = Annotated[list[Annotated[list[_Point], Field(min_length=4)]], Field(min_length=1)]


class _Reason(Part):
    reason: str


class _Polygon(Part):
    type: Literal["Polygon"]
    coordinates: _Rings


class _MultiPolygon(Part):
    type: Literal["MultiPolygon"]
    coordinates: list[_Rings]


class _Feature(Part):
    properties: _Reason
    geometry: Annotated[_Polygon | _MultiPolygon, Field(discriminator="type")]


class _Collection(Part):
    features: list[_Feature]


@contextmanager
def areas_of(
    rigs: Mapping[str, Rig], mesh: LabelledMesh, region: shapely.Polygon, crew: Helpers | Cluster
) -> Iterator[Callable[[str], list[IgnoreArea]]]:
    """Yield a function that returns the areas of a rig by name, computed by `ignore_areas`.

    If this process has a helper, the helper computes them while frames are recorded.

    Args:
        rigs: rigs by name.
        mesh: the static world, site frame.
        region: area of the twin's traffic, site frame.
        crew: this process and its helpers.
    """
    pool = pool_of(crew)
    if pool is None or all(rig.ride is not None for rig in rigs.values()):
        yield lambda name: ignore_areas(rigs[name], mesh, region)
        return
    with handed((rigs, mesh, region)) as place, ExitStack() as beside:
        results = {name: beside.enter_context(begun(pool, _areas_at, place, name)) for name in rigs}
        yield lambda name: results[name]()


def _areas_at(place: str, name: str) -> list[IgnoreArea]:
    rigs, mesh, region = received(place)
    return ignore_areas(rigs[name], mesh, region)


def write_ignore_regions(path: Path, areas: Sequence[IgnoreArea]) -> None:
    """Write areas as GeoJSON: one feature each, with the property ``reason``.

    Coordinates are east and north of the anchor in metres, in the site frame: ``dataset_SE3_site``
    of ``dataset.json`` transforms them to the frame of the points.
    """
    features = [
        {
            "type": "Feature",
            "properties": {"reason": area.reason},
            "geometry": shapely.geometry.mapping(_rounded(area.area)),
        }
        for area in areas
    ]
    write_json(path, {"type": "FeatureCollection", "frame": "site", "features": features})


def read_ignore_regions(path: Path) -> list[IgnoreArea]:
    """Read the file of ``write_ignore_regions``.

    Raises:
        InputError: missing, or other content.
    """
    value = read_json(path, kind="file of ignore regions")
    collection = validated(value, _Collection, file=path, expected="polygons with a reason")
    areas = []
    for number, feature in enumerate(collection.features):
        try:
            shape = shapely.geometry.shape(feature.geometry.model_dump())
            area = shapely.MultiPolygon(shapely.get_parts(shape).tolist())
        except (ValueError, shapely.errors.ShapelyError) as error:
            raise InputError(
                f"is not a polygon ({one_line(error)})", file=path, place=f"features[{number}]"
            ) from None
        areas.append(IgnoreArea(feature.properties.reason, area))
    return areas


def _rounded(area: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return an area with coordinates in whole centimetres."""
    snapped = shapely.set_precision(area, _GRID_M)
    return shapely.transform(snapped, lambda xy: np.round(xy, 2) + 0.0)
