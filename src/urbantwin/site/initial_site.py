"""Initial ``site.yaml`` for an extract: commented, and complete enough to run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress, between, untold
from urbantwin.site.draft import (
    RADIUS_M,
    GivenPlace,
    SiteDraft,
    check_target,
    write_draft,
)
from urbantwin.site.extract import Extract
from urbantwin.site.extract_coverage import check_roads, mapped_area
from urbantwin.site.extract_file import LonLatBox, box_around, read_extract
from urbantwin.site.fetched import FetchedInput
from urbantwin.site.junction_proposal import STREETS, propose_junction, streets_near, titled
from urbantwin.site.pole_site import PoleChoice, PoleGround, ground_around, nearest_place
from urbantwin.site.region import circle
from urbantwin.site.traffic_around import per_hour_around

__all__ = ["init_site"]

#: Smallest radius of a region with room for queues, metres.
LEAST_RADIUS_M = 100.0
#: Smallest mapped fraction of a region's circle; below, the region is made smaller.
_MAPPED_SHARE = 0.6
#: Crossings and stop lines within these distances inside and outside of the border would be cut;
#: the proposed border is moved by at most the last value; metres.
_CUT_M, _MOVED_M = (8.0, 4.0), 20.0

#: Function that adds known facts about a place to a draft, given the ground for poles.
Furnishing = Callable[[SiteDraft, PoleGround], SiteDraft]


@dataclass(frozen=True)
class _Place:
    """The anchor, and the reason for its choice."""

    latitude: float
    longitude: float
    title: str
    why: str


def init_site(  # noqa: PLR0913 - every one is a person's choice
    folder: Path,
    osm: Path,
    *,
    latitude: float | None = None,
    longitude: float | None = None,
    region: Path | None = None,
    radius_m: float | None = None,
    force: bool = False,
    choose_pole: PoleChoice = nearest_place,
    furnish: Furnishing | None = None,
    fetched: Sequence[FetchedInput] = (),
    progress: Progress | None = None,
) -> Path:
    """Write a commented ``site.yaml`` for an OpenStreetMap extract and return its path.

    Files outside of ``folder`` are copied into it, so that it is self-contained.

    Args:
        folder: folder to write, created if missing.
        osm: the extract.
        latitude: latitude of the anchor, degrees; if not given, that of the busiest signalised
            junction.
        longitude: longitude of the anchor, degrees.
        region: GeoJSON polygon; a circle if not given.
        radius_m: radius of the circle, metres; if not given, about 150 m, or less within a smaller
            extract, such that its border cuts no crossing.
        force: replace an existing ``site.yaml``.
        choose_pole: chooses the sensor's position on the ground of the junction.
        furnish: adds known facts about the place to the draft.
        fetched: inputs fetched for the place, including the extract.
        progress: called with the share done (0..1) and the current task.

    Raises:
        InputError: the extract or the region is wrong, the place is not in the extract, no road is
            in the region, or there is a ``site.yaml`` already.
    """
    check_target(folder, force=force)
    given = GivenPlace.checked(latitude, longitude, region, radius_m)
    tell = progress or untold
    near = _near(given)
    extract = read_extract(osm, near, progress=between(tell, 0.0, 0.8))
    tell(0.8, "looking for the place")
    is_fetched = any(one.path == osm for one in fetched)
    place = _place(extract, given, "" if is_fetched else osm.name.split(".")[0])
    frame = SiteFrame(place.latitude, place.longitude)
    radius = radius_m
    if radius is None:
        radius = RADIUS_M if region else _radius(extract, frame)
    shape = given.region(frame, radius)
    check_roads(extract, frame, shape, "the region")
    tell(0.9, "looking for a place of the sensor")
    ground = ground_around(extract, frame, shape)
    draft = SiteDraft(
        title=place.title,
        why=place.why,
        latitude=place.latitude,
        longitude=place.longitude,
        region=radius if region is None else region,
        osm=osm,
        roads=None,
        anchor_m=None,
        per_hour=per_hour_around(extract, frame, shape),
        pole=choose_pole(ground),
        fetched=tuple(fetched),
    )
    if furnish is not None:
        draft = furnish(draft, ground)
    return write_draft(folder, draft, force=force)


def _near(given: GivenPlace) -> LonLatBox | None:
    """Return the box around the place in degrees, if known before the map is read."""
    if given.point is not None:
        # Too near to a pole for such a box.
        if abs(given.point[0]) > 89.0:
            return None
        farthest = given.radius_m or RADIUS_M + _MOVED_M
        return box_around(SiteFrame(*given.point), circle(farthest))
    if given.polygon is None:
        return None
    middle = given.polygon.centroid
    frame = SiteFrame(middle.y, middle.x)
    return box_around(frame, given.region(frame, RADIUS_M))


def _place(extract: Extract, given: GivenPlace, otherwise: str) -> _Place:
    """Return the given or proposed place.

    Args:
        extract: the map.
        given: the given place.
        otherwise: title for streets without names; coordinates if empty.
    """
    if given.point is None:
        found = propose_junction(extract, given.polygon)
        kind = "signalised " if found.signalised else ""
        lights = (
            f"{found.signals} mapped signals" if found.signals else "no signals in this extract"
        )
        why = f"The busiest {kind}junction that is mapped all around: {found.arms} arms, {lights}."
        title = titled(found.names) or "Junction"
        return _Place(found.latitude, found.longitude, title, why)
    latitude, longitude = given.point
    nodes = np.array(list(extract.nodes.values()))
    if not len(nodes):
        raise InputError(
            f"has nothing near {latitude:g}, {longitude:g}",
            file=extract.path,
            expected="an extract around there",
        )
    here = np.broadcast_to([longitude, latitude], nodes.shape)
    away = float(np.min(Geod(ellps="WGS84").inv(*here.T, *nodes.T)[2]))
    if away > RADIUS_M:
        low, high = np.percentile(nodes, [5, 95], axis=0)
        shown = f"{away / 1000:.0f} km" if away >= 10_000 else f"{away:.0f} m"
        raise InputError(
            f"{latitude:g}, {longitude:g} is {shown} from the extract",
            file=extract.path,
            expected=f"latitude {low[1]:.4f} to {high[1]:.4f}, "
            f"longitude {low[0]:.4f} to {high[0]:.4f}",
        )
    title = " / ".join(streets_near(extract, SiteFrame(latitude, longitude))[:2])
    title = title or otherwise or f"{latitude:.5f}, {longitude:.5f}"
    return _Place(latitude, longitude, title, "As given.")


def _radius(extract: Extract, frame: SiteFrame) -> float:
    """Return the default radius, or less within a smaller extract."""
    area = mapped_area(extract, frame)
    for radius in np.arange(RADIUS_M, LEAST_RADIUS_M, -10.0):
        disc = circle(float(radius))
        if shapely.intersection(area, disc).area >= _MAPPED_SHARE * disc.area:
            return _cutting_none(extract, frame, float(radius))
    return _cutting_none(extract, frame, LEAST_RADIUS_M)


def _cutting_none(extract: Extract, frame: SiteFrame, radius: float) -> float:
    """Return the nearest radius whose circle cuts no crossing and no stop line."""
    driven = {
        node for way in extract.highways() if way.tags["highway"] in STREETS for node in way.nodes
    }
    marks = [
        extract.nodes[node]
        for node in sorted(driven & extract.nodes.keys())
        if extract.node_tags.get(node, {}).get("highway") in ("crossing", "traffic_signals")
    ]
    xy = frame.site_from_lonlat(np.array(marks).reshape(-1, 2))
    away = np.hypot(xy[:, 0], xy[:, 1])
    steps = sorted(np.arange(-_MOVED_M, _MOVED_M + 1.0, 2.0), key=lambda step: (abs(step), -step))
    for step in steps:
        beyond = away - (radius + step)
        if not ((beyond > -_CUT_M[0]) & (beyond < _CUT_M[1])).any():
            return radius + float(step)
    return radius
