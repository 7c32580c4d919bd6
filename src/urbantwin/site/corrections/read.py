"""Reading of a correction file: GeoJSON of editors, with every feature checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.corrections.kinds import ACTIONS, Asked, RemoveThing
from urbantwin.site.drawn_geojson import EDITORS, ToSite, shapes_in_site, to_site
from urbantwin.site.region import read_geojson
from urbantwin.site.yaml_document import Document, nearest

__all__ = ["CORRECTIONS", "Correction", "read_corrections"]

#: Default file name beside a site.
CORRECTIONS = "corrections.geojson"
_EXPECTED = "a FeatureCollection of corrections (docs/howto/corrections.md)"


@dataclass(frozen=True, eq=False)
class Correction:
    """A correction.

    Attributes:
        number: number of the feature in the file, from 1, as on the plan.
        asked: the requested action.
        shapes: drawn geometry, site frame; empty if none is needed.
        file: the file.
    """

    number: int
    asked: Asked
    shapes: tuple[shapely.Geometry, ...]
    file: Path

    @property
    def place(self) -> str:
        """Return its place in the file, for messages: ``feature 3 (add pole)``."""
        return _place(self.number, self.asked.action, self.asked.what)

    def error(self, problem: str, expected: str | None = None) -> InputError:
        """Return an error about the correction."""
        return InputError(problem, file=self.file, place=self.place, expected=expected)


def read_corrections(path: Path, frame: SiteFrame, region: shapely.Polygon) -> list[Correction]:
    """Read a correction file.

    Args:
        path: GeoJSON: a FeatureCollection whose features have the property ``action``. Coordinates
            are as in a sketch: degrees, or metres of the site frame (``"crs": "site"``).
        frame: the site frame.
        region: the region, site frame; drawn geometry must touch it.

    Raises:
        InputError: a feature is wrong; names the number of the first.
    """
    value = read_geojson(path)
    features = value.get("features")
    if value.get("type") != "FeatureCollection" or not isinstance(features, list):
        raise InputError("is no FeatureCollection", file=path, expected=_EXPECTED)
    if not features:
        raise InputError("holds no corrections", file=path, expected=f"{_EXPECTED}, or no file")
    to_metres = to_site(path, value.get("crs"), frame)
    return [
        _correction(path, number, one, to_metres, region)
        for number, one in enumerate(features, start=1)
    ]


def _place(number: int, action: str = "", what: str = "") -> str:
    named = f"{action} {what}".strip()
    return f"feature {number} ({named:.40})" if named else f"feature {number}"


def _correction(
    path: Path,
    number: int,
    value: Any,  # noqa: ANN401
    to_metres: ToSite,
    region: shapely.Polygon,
) -> Correction:
    if not isinstance(value, Mapping) or not isinstance(value.get("properties"), Mapping):
        expected = "geometry, and properties with an action"
        raise InputError("is no feature", file=path, place=_place(number), expected=expected)
    given = {
        str(key): one
        for key, one in value["properties"].items()
        if one not in (None, "") and not EDITORS.fullmatch(str(key))
    }
    action, what = str(given.get("action", "")), str(given.get("what", ""))
    plain = Document(path, given, None, (_place(number),))
    if action not in ACTIONS:
        problem = f"is {action!r:.40}" if action else "is missing"
        raise plain.error(problem, ("action",), nearest(action, list(ACTIONS)))
    known = ACTIONS[action]
    if what not in known:
        problem = f"is {what!r:.40}" if what else "is missing"
        things = [one for one in known if one]
        raise plain.error(problem, ("what",), nearest(what, things) if things else "nothing")
    place = _place(number, action, what)
    # An element determines its kind itself, except for its lanes.
    model = known["" if action == "remove" and what != "lane" and "element" in given else what]
    asked = Document(path, given, None, (place,)).validated(model)
    return Correction(number, asked, _shapes(path, place, value, asked, to_metres, region), path)


def _shapes(
    path: Path,
    place: str,
    value: Mapping[str, Any],
    asked: Asked,
    to_metres: ToSite,
    region: shapely.Polygon,
) -> tuple[shapely.Geometry, ...]:
    """Return the drawn geometry of a correction, which must touch the region."""

    def error(problem: str, expected: str) -> InputError:
        return InputError(problem, file=path, place=place, expected=expected)

    geometry = value.get("geometry")
    if geometry is None:
        if asked.must_be_drawn:
            raise error("is not drawn", " or ".join(asked.drawn_as))
        return ()
    if not isinstance(geometry, Mapping):
        raise error("has a geometry that is none", "a GeoJSON geometry, or null")
    if not asked.drawn_as:
        return ()  # drawn as a reminder only; the element is decisive
    shapes = tuple(shapes_in_site(path, place, geometry, asked.drawn_as, to_metres))
    for shape in shapes:
        gap = shapely.distance(shape, region)
        if gap > 0:
            problem = f"is drawn {gap:.0f} m outside the region" if gap >= 1 else "lies outside it"
            raise error(problem, "a place in the site's region")
    if isinstance(asked, RemoveThing):
        _check_reach(asked, shapes, error)
    return shapes


def _check_reach(asked: RemoveThing, shapes: Sequence[shapely.Geometry], error: Any) -> None:  # noqa: ANN401
    """Reject a radius with an area, and a wall at a point without radius."""
    points = [shape.geom_type == "Point" for shape in shapes]
    if asked.radius_m is not None and not all(points):
        raise error("has radius_m, and is drawn as an area", "one of the two")
    if asked.what == "wall" and asked.radius_m is None and any(points):
        raise error("is a point without radius_m", "how far about it, an area, or an element")
