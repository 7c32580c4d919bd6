"""Transformation of a model's heights to the site's zero, across vertical datums."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.ground_level import (
    above,
    height_at_anchor,
    samples_of,
)
from urbantwin.reconstruct.georeference.height_system import (
    HeightSystem,
    NoGridError,
    SiteHeights,
    geoid_height,
    heights_between,
)
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.site.geometry import GeometrySource

__all__ = ["HeightsOnSite", "ground_above_site", "heights_on_site", "laid_on_ground", "shifted"]

#: Maximum difference of grounds if a datum is not stated, metres.
UNSTATED_M = 1.0
#: The same if both are stated, as a survey and a mesh of buildings may differ, metres.
STATED_M = 5.0

#: Distance from the anchor within which ground has about the anchor's height, metres.
_AT_ANCHOR_M = 15.0

WAYS_OUT = "height_offset_m or register: true"


@dataclass(frozen=True, eq=False)
class HeightsOnSite:
    """A model with heights of the site.

    Attributes:
        model: z above the anchor's ground, metres.
        report: what was done.
        problems: warnings for the user.
        heights: the site's zero in known heights.
    """

    model: ImportedModel
    report: dict[str, object]
    problems: tuple[str, ...] = ()
    heights: SiteHeights | None = None


@dataclass
class _Work:
    """Intermediate results."""

    report: dict[str, object] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def shifted(model: ImportedModel, change: float | NDArray[np.float64]) -> ImportedModel:
    """Return a model raised by a height."""
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None:
        mesh = replace(mesh, vertices=mesh.vertices + np.array([0, 0, change]))
    if cloud is not None:
        cloud = replace(cloud, points=cloud.points + np.array([0, 0, change]))
    return replace(model, mesh=mesh, cloud=cloud)


def ground_above_site(
    model: ImportedModel, elevation: Elevation | None
) -> tuple[float, float] | None:
    """Return the median height of a model's ground above the site's, and half the spread."""
    if elevation is None or elevation.is_flat:
        return None
    rows, columns = elevation.raw.shape
    east = elevation.west + (columns - 1) * elevation.step
    north = elevation.south + (rows - 1) * elevation.step

    def surface(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        low, high = (xy >= [elevation.west, elevation.south]), (xy <= [east, north])
        out = elevation.raw_at(xy)
        out[~(low & high).all(axis=1)] = np.nan
        return out

    return above(samples_of(model, ground=True), surface)


def laid_on_ground(
    model: ImportedModel, elevation: Elevation | None, heights: SiteHeights | None, name: str
) -> HeightsOnSite:
    """Return a model of unknown height, shifted so that its ground is at the site's."""
    found = ground_above_site(model, elevation)
    report: dict[str, object] = {}
    if found is not None:
        change = -found[0]
        report = {"laid_on": "the site's ground", "spread_m": round(found[1], 3)}
    else:
        own = height_at_anchor(samples_of(model, ground=True))
        change = 0.0 if own is None else -own
        report = {"laid_on": "z = 0 at the anchor, by its own ground there"}
    report["raised_m"] = round(change, 3)
    return HeightsOnSite(shifted(model, change), report, (), heights)


def heights_on_site(
    model: ImportedModel,
    lonlat: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    system: HeightSystem | None,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> HeightsOnSite:
    """Transform a model's heights to heights above the anchor's ground.

    Args:
        model: x, y in the site frame; z in its CRS (in metres if ``system`` is ``None``).
        lonlat: returns degrees (N, 2) for site metres (N, 2).
        system: its height system; ``None`` if not stated.
        source: for ``height_offset_m``, ``register`` and positions of errors.
        frame: the site frame.
        elevation: the bare earth so far, if there is any.
        heights: the anchor's ground height, if known.

    Raises:
        InputError: heights have different datums without a grid between them, or the grounds
            differ.
    """
    work = _Work()
    offset = source.spec.height_offset_m
    work.report["datum"] = "not stated" if system is None else system.name
    if offset:
        work.report["height_offset_m"] = offset
    name = source.name
    if heights is None:
        model = _with_heights(model, lambda _, z: z * _metres(system) + offset)
        # Ground without a datum (a map's roads, a local model) is the reference.
        found = ground_above_site(model, elevation)
        own = height_at_anchor(samples_of(model, ground=True)) if found is None else found[0]
        zero = 0.0 if own is None else own
        work.report["anchor"] = SiteHeights(zero, system, name).as_report()
        return HeightsOnSite(
            shifted(model, -zero), work.report, (), SiteHeights(zero, system, name)
        )
    work.report["anchor"] = heights.as_report()
    transformation = "none: taken as the same, which the grounds must show"
    if system is not None and heights.datum is not None:
        try:
            transformation, model = _transformed(model, lonlat, system, heights.datum)
        except NoGridError as error:
            if not offset and source.spec.register_to is None:
                raise source_error(
                    source,
                    f"has {system.name}, and {heights.name} has {heights.datum.name}: {error}",
                    "crs",
                    expected=f"the grid (projsync, or PROJ_NETWORK=ON), or {WAYS_OUT}",
                ) from None
            transformation = f"none: {error}"
            model = _with_heights(model, lambda _, z: z * _metres(system))
    else:
        model = _with_heights(model, lambda _, z: z * _metres(system))
    work.report["transformation"] = transformation
    model = shifted(model, offset - heights.anchor_m)
    _compare(work, model, system, source, frame, elevation, heights)
    return HeightsOnSite(model, work.report, tuple(work.problems), heights)


def _compare(
    work: _Work,
    model: ImportedModel,
    system: HeightSystem | None,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights,
) -> None:
    """Compare the model's ground with the site's.

    Raises:
        InputError: they differ, and ``site.yaml`` does not allow it.
    """
    found = ground_above_site(model, elevation)
    stated = system is not None and heights.datum is not None
    if found is None and elevation is None and not stated:
        # only the anchor's height is known of the site's ground
        own = height_at_anchor(samples_of(model, ground=True), farthest_m=_AT_ANCHOR_M)
        found = None if own is None else (own, 0.0)
    if found is None:
        if not stated:
            work.problems.append(
                "its heights are of an unknown datum and no ground of it was found to compare: "
                "they may be wrong by the geoid"
            )
        return
    difference, spread = found
    work.report["ground_above_site_m"] = round(difference, 3)
    work.report["ground_spread_m"] = round(spread, 3)
    if abs(difference) <= UNSTATED_M:
        return
    where = "above" if difference > 0 else "below"
    text = f"has its ground {abs(difference):.1f} m {where} that of {heights.name}"
    text += _likely(difference, frame, system, heights)
    limit = STATED_M if stated else UNSTATED_M
    explained = source.spec.height_offset_m or source.spec.register_to is not None
    if abs(difference) <= limit or explained:
        work.problems.append(text)
        return
    raise source_error(
        source,
        text,
        "crs",
        expected=f"heights of one datum: crs with its vertical part, or {WAYS_OUT}",
    )


def _likely(
    difference: float, frame: SiteFrame, system: HeightSystem | None, heights: SiteHeights
) -> str:
    """Return a likely reason of different grounds: one is above the ellipsoid."""
    geoid = float(geoid_height(np.array([[frame.longitude, frame.latitude]]))[0])
    if not np.isfinite(geoid) or abs(geoid) < UNSTATED_M:
        return ""
    for sign, own, name in ((1, system, "it has"), (-1, heights.datum, f"{heights.name} has")):
        if abs(difference - sign * geoid) < max(2.0, 0.05 * abs(geoid)):
            said = "" if own is None else f", although {own.name} is stated"
            return (
                f": looks as if {name} ellipsoidal heights{said} "
                f"(the geoid is at {geoid:.1f} m here)"
            )
    return ""


def _transformed(
    model: ImportedModel,
    lonlat: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    a: HeightSystem,
    b: HeightSystem,
) -> tuple[str, ImportedModel]:
    told = ""

    def change(xy: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal told
        out, told = heights_between(lonlat(xy), z, a, b)
        return out

    out = _with_heights(model, change)
    return told, out


def _with_heights(
    model: ImportedModel,
    change: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
) -> ImportedModel:
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None and len(mesh.vertices):
        v = mesh.vertices
        mesh = replace(mesh, vertices=np.column_stack([v[:, :2], change(v[:, :2], v[:, 2])]))
    if cloud is not None and len(cloud.points):
        p = cloud.points
        cloud = replace(cloud, points=np.column_stack([p[:, :2], change(p[:, :2], p[:, 2])]))
    return replace(model, mesh=mesh, cloud=cloud)


def _metres(system: HeightSystem | None) -> float:
    return 1.0 if system is None else system.metres
