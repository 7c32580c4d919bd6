"""Georeferencing in a local frame: by control points, similarity, origin or geotag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.axes import Axes, axes_of
from urbantwin.reconstruct.georeference.control_points import fit, read_control_points
from urbantwin.reconstruct.georeference.height_system import (
    HeightSystem,
    NoGridError,
    SiteHeights,
    heights_between,
)
from urbantwin.reconstruct.georeference.initial_placement import InitialPlacement
from urbantwin.reconstruct.georeference.overlap import (
    all_points,
)
from urbantwin.reconstruct.georeference.pose_search import Freedom
from urbantwin.reconstruct.georeference.similarity import Similarity, moved
from urbantwin.reconstruct.georeference.vertical_datum import (
    UNSTATED_M,
    HeightsOnSite,
    ground_above_site,
    laid_on_ground,
    shifted,
)
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource, SimilaritySpec

__all__ = ["by_control_points", "by_geotag", "by_origin", "by_similarity", "in_the_middle"]


def by_control_points(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Place a model by control points known in it and on site.

    Raises:
        InputError: the points cannot be read, do not determine the transform, or are inconsistent.
    """
    points = read_control_points(source, frame, elevation)
    axes = axes_of(model, source)
    transform, residuals = fit(points, axes.transform() if axes.up_known else None)
    named = zip(points.names, residuals, strict=True)
    report: dict[str, object] = {
        "control_points": [{"name": name, "residual_m": one} for name, one in named],
        "rms_m": round(float(np.sqrt(np.mean(np.square(residuals)))), 4),
        "transform": transform.as_report(),
        "scale": float(f"{transform.scale:.9g}"),
        "up": "as the points say",
    }
    problems = list(points.notes)
    ratio = transform.scale / axes.unit_m
    if axes.unit_known and abs(ratio - 1) > 0.02:
        problems.append(f"its scale by the control points is {ratio:.4g} of what its unit says")
    out = moved(model, transform)
    out, more = _with_offset(out, source, elevation)
    return InitialPlacement(
        out,
        report | more[0],
        heights,
        "control points",
        "control_points",
        (*problems, *more[1]),
    )


def by_similarity(
    model: ImportedModel,
    source: GeometrySource,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Place a model by the transform in ``site.yaml``; without one it is in the site frame."""
    spec = source.spec.similarity or SimilaritySpec()
    axes = axes_of(model, source)
    if not axes.unit_known:
        # the scale is given, so no unit is estimated
        axes = replace(axes, unit_m=1.0, unit_why="not said: the similarity's scale is all")
    yaw, pitch, roll = np.radians([spec.yaw_deg, spec.pitch_deg, spec.roll_deg])
    rotation = _about("z", yaw) @ _about("y", pitch) @ _about("x", roll)
    given = Similarity(spec.scale, rotation, np.array(spec.translation_m, np.float64))
    transform = given.after(axes.transform())
    out, more = _with_offset(moved(model, transform), source, elevation)
    report = {**axes.as_report(), "transform": transform.as_report(), "scale": transform.scale}
    return InitialPlacement(
        out, report | more[0], heights, "similarity", "similarity", tuple(more[1])
    )


def by_origin(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Place a model by its origin's location; on the site's ground if no height is given."""
    spec = source.spec.origin
    assert spec is not None
    axes = axes_of(model, source)
    out = _at(model, axes, frame, spec.longitude, spec.latitude, spec.heading_deg)
    report: dict[str, object] = {**axes.as_report(), "heading_deg": spec.heading_deg}
    problems: tuple[str, ...] = ()
    if spec.height_m is not None:
        out, more = _with_offset(shifted(out, spec.height_m), source, elevation)
        report |= more[0] | {"height_m": spec.height_m}
        problems = tuple(more[1])
    else:
        out = shifted(out, source.spec.height_offset_m)
        laid = laid_on_ground(out, elevation, heights, source.name)
        out, report["heights"] = laid.model, laid.report
    return InitialPlacement(
        out,
        report,
        heights,
        "origin",
        "origin",
        problems,
        _freedom(
            axes,
            _xy(frame, spec.longitude, spec.latitude),
            heading="heading_deg" not in spec.model_fields_set,
        ),
    )


def by_geotag(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Place a model by its geotag; on the site's ground if its height is unusable."""
    tag = model.geotag
    assert tag is not None
    axes = axes_of(model, source)
    out = _at(model, axes, frame, tag.longitude, tag.latitude, tag.heading_deg)
    report: dict[str, object] = {**axes.as_report(), "heading_deg": tag.heading_deg}
    problems: list[str] = []
    told: HeightsOnSite | None = None
    if tag.height_m is not None and heights is not None and heights.datum is not None:
        system = _system_of_tag(tag.height_datum)
        lonlat = np.array([[tag.longitude, tag.latitude]])
        try:
            if system is None:
                raise NoGridError("the geotag does not say of what datum its height is")
            metres, how = heights_between(
                lonlat, np.array([tag.height_m]) / system.metres, system, heights.datum
            )
            raised = shifted(out, float(metres[0]) - heights.anchor_m)
            raised, more = _with_offset(raised, source, elevation)
            found = more[0].get("ground_above_site_m")
            if isinstance(found, float) and abs(found) > UNSTATED_M:
                raise NoGridError(f"its ground would lie {found:+.1f} m from the site's")
            told = HeightsOnSite(
                raised, {"transformation": how, **more[0]}, tuple(more[1]), heights
            )
        except NoGridError as error:
            problems.append(f"the height of its geotag was not used: {error}")
    if told is None:
        out = shifted(out, source.spec.height_offset_m)
        told = laid_on_ground(out, elevation, heights, source.name)
    report["heights"] = told.report
    return InitialPlacement(
        told.model,
        report,
        heights,
        "geotag",
        None,
        (*problems, *told.problems),
        _freedom(axes, _xy(frame, tag.longitude, tag.latitude), heading=False),
    )


def in_the_middle(
    model: ImportedModel,
    source: GeometrySource,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Centre a model without any placement on the region."""
    axes = axes_of(model, source)
    out = moved(model, axes.transform())
    points = np.vstack(all_points(out))
    low, high = np.quantile(points[:: max(1, len(points) // 100_000)], [0.02, 0.98], axis=0)
    middle = (low + high) / 2
    centre = surroundings.region.centroid
    shift = np.array([centre.x - middle[0], centre.y - middle[1], -low[2]])
    out = moved(out, Similarity(1.0, np.eye(3), shift))
    return InitialPlacement(
        out,
        axes.as_report(),
        heights,
        "the middle of the region",
        "register",
        (),
        replace(_freedom(axes, heading=True), place=True),
    )


def _at(
    model: ImportedModel,
    axes: Axes,
    frame: SiteFrame,
    longitude: float,
    latitude: float,
    heading_deg: float,
) -> ImportedModel:
    """Move a model's origin to a location, with +y at a heading clockwise from north."""
    xy = frame.site_from_lonlat([[longitude, latitude]])[0]
    turn = Similarity.in_plan(-float(np.radians(heading_deg)), [xy[0], xy[1], 0.0])
    return moved(model, turn.after(axes.transform()))


def _freedom(axes: Axes, pivot: tuple[float, float] | None = None, *, heading: bool) -> Freedom:
    """Return the freedom of registration for a model with estimated heights."""
    return Freedom(
        heading=heading,
        scale=not axes.unit_known,
        level=not axes.up_known,
        height=True,
        pivot=pivot,
    )


def _xy(frame: SiteFrame, longitude: float, latitude: float) -> tuple[float, float]:
    x, y = frame.site_from_lonlat([[longitude, latitude]])[0]
    return float(x), float(y)


def _with_offset(
    model: ImportedModel, source: GeometrySource, elevation: Elevation | None
) -> tuple[ImportedModel, tuple[dict[str, object], list[str]]]:
    """Add height_offset_m to heights given on site, and compare the grounds."""
    offset = source.spec.height_offset_m
    model = shifted(model, offset)
    report: dict[str, object] = {"height_offset_m": offset} if offset else {}
    problems: list[str] = []
    found = ground_above_site(model, elevation)
    if found is not None:
        report["ground_above_site_m"] = round(found[0], 3)
        if abs(found[0]) > UNSTATED_M:
            problems.append(f"its ground lies {found[0]:+.1f} m from the site's, as it was placed")
    return model, (report, problems)


def _system_of_tag(datum: str) -> HeightSystem | None:
    if datum == "ellipsoidal":
        return HeightSystem(CRS("EPSG:4979"))
    try:
        return HeightSystem.of(CRS.from_user_input(datum)) if datum else None
    except Exception:
        return None


def _about(axis: str, angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),
    }[axis]
