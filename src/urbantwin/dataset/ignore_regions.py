"""``ignore_regions.geojson``: where labels of a dataset are not to be counted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shapely

from urbantwin.artefact import read_json, write_json
from urbantwin.errors import InputError
from urbantwin.lidar.coverage import IgnoreArea

__all__ = ["IGNORE_REGIONS", "read_ignore_regions", "write_ignore_regions"]

#: The file in a dataset's folder.
IGNORE_REGIONS = "ignore_regions.geojson"
#: Coordinates are written so fine, metres.
_GRID_M = 0.01


def write_ignore_regions(path: Path, areas: Sequence[IgnoreArea]) -> None:
    """Write areas as GeoJSON: a feature each, ``reason`` among its properties.

    Coordinates are east and north of the anchor in metres, in the site frame:
    ``dataset_SE3_site`` of ``dataset.json`` takes them to the frame of the points.
    """
    features = [
        {
            "type": "Feature",
            "properties": {"reason": one.reason},
            "geometry": _plain(shapely.geometry.mapping(shapely.set_precision(one.area, _GRID_M))),
        }
        for one in areas
    ]
    write_json(path, {"type": "FeatureCollection", "frame": "site", "features": features})


def read_ignore_regions(path: Path) -> list[IgnoreArea]:
    """Read what ``write_ignore_regions`` wrote.

    Raises:
        InputError: the file is missing or holds something else.
    """
    value = read_json(path, kind="file of ignore regions")
    try:
        return [
            IgnoreArea(
                str(one["properties"]["reason"]),
                shapely.MultiPolygon(
                    shapely.get_parts(shapely.geometry.shape(one["geometry"])).tolist()
                ),
            )
            for one in value["features"]
        ]
    except (KeyError, TypeError, ValueError, AttributeError, shapely.errors.ShapelyError) as error:
        raise InputError(
            f"is not readable ({error})", file=path, expected="polygons with a reason"
        ) from None


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return tuples as lists and numbers in centimetres, as JSON has them."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return round(value, 2) + 0.0 if isinstance(value, float) else value
