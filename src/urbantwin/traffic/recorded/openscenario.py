"""Trajectories of ASAM OpenSCENARIO XML: polylines that objects follow."""

from __future__ import annotations

import math
from pathlib import Path

from lxml import etree

from urbantwin.errors import InputError
from urbantwin.number_text import finite_number
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.row_list import RowList
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = ["openscenario_rows"]

_EXPECTED = "ASAM OpenSCENARIO XML with polylines of timed world positions"


def openscenario_rows(
    path: Path, spec: TracksSpec, *, without_story: str | None = None
) -> RecordedRows:
    """Read the trajectories of objects (``FollowTrajectoryAction`` with a ``Polyline``).

    A position is that of the object's reference point; its box's middle lies before it by the
    ``Center`` of the object's ``BoundingBox`` (ASAM OpenSCENARIO XML 1.3, "BoundingBox").

    Args:
        path: the file.
        spec: what a description says besides.
        without_story: name of a ``Story`` that is passed over.

    Raises:
        InputError: the file is missing, is none, or has positions of other kinds; the element's
            line is named.
    """
    del spec
    rows = RowList(path, _EXPECTED)
    try:
        root = etree.parse(
            path, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
        ).getroot()
    except OSError:
        raise InputError("not found", file=path, expected=_EXPECTED) from None
    except etree.XMLSyntaxError as error:
        line = f"line {error.lineno}"
        raise InputError("is not XML", file=path, place=line, expected=_EXPECTED) from None
    bodies = {
        str(one.get("name")): _body(one, rows) for one in root.iterfind("Entities/ScenarioObject")
    }
    for group in root.iter("ManeuverGroup", "Private"):
        story = next(group.iterancestors("Story"), None)
        if without_story is not None and story is not None and story.get("name") == without_story:
            continue
        names = [ref.get("entityRef") for ref in group.iterfind("Actors/EntityRef")]
        if group.tag == "Private":
            names = [group.get("entityRef")]
        for vertex in group.iter("Vertex"):
            place = f"line {vertex.sourceline}"
            world = vertex.find("Position/WorldPosition")
            time_s = finite_number(vertex.get("time"))
            if world is None or time_s is None:
                raise rows.error(place, "is not a WorldPosition with a time")
            x, y = finite_number(world.get("x")), finite_number(world.get("y"))
            z, yaw = finite_number(world.get("z", "nan")), finite_number(world.get("h", "nan"))
            if x is None or y is None:
                raise rows.error(place, "has no x and y")
            for name in names:
                if name not in bodies:
                    raise rows.error(place, f"moves {str(name)[:40]!r}, which is no ScenarioObject")
                kind, size, centre = bodies[name]
                facing = math.nan if yaw is None else yaw
                turned = 0.0 if yaw is None else yaw
                middle = (
                    x + centre[0] * math.cos(turned) - centre[1] * math.sin(turned),
                    y + centre[0] * math.sin(turned) + centre[1] * math.cos(turned),
                    math.nan if z is None else z,
                )
                rows.add(place, name, time_s, kind, middle, facing, size)
    return rows.made()


def _body(
    item: etree._Element, rows: RowList
) -> tuple[str, tuple[float, ...], tuple[float, float]]:
    """Return an object's class, its size, and where the middle of its box is."""
    kind = "unknown"
    for name in ("vehicleCategory", "pedestrianCategory", "miscObjectCategory"):
        found = item.xpath(f".//@{name}")
        if found:
            kind = str(found[0])
    box = item.find(".//BoundingBox")
    if box is None:
        return kind, (math.nan, math.nan, math.nan), (0.0, 0.0)
    place = f"line {box.sourceline}"
    sides, centre = box.find("Dimensions"), box.find("Center")
    if sides is None or centre is None:
        raise rows.error(place, "has not Center and Dimensions")
    size = [finite_number(sides.get(name)) for name in ("length", "width", "height")]
    middle = [finite_number(centre.get(name)) for name in ("x", "y")]
    if None in (*size, *middle):
        raise rows.error(place, "holds something else than numbers")
    return kind, tuple(float(one or 0.0) for one in size), (middle[0] or 0.0, middle[1] or 0.0)
