"""Placement of a model on site, by the settings of its source and its files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.io.model import ImportedModel
from urbantwin.progress import Progress, untold
from urbantwin.reconstruct.georeference.height_system import (
    SiteHeights,
)
from urbantwin.reconstruct.georeference.initial_placement import InitialPlacement
from urbantwin.reconstruct.georeference.known_crs import by_crs
from urbantwin.reconstruct.georeference.local_frame import (
    by_control_points,
    by_geotag,
    by_origin,
    by_similarity,
    in_the_middle,
)
from urbantwin.reconstruct.georeference.overlap import (
    all_points,
    check_finite,
    check_meets,
)
from urbantwin.reconstruct.georeference.registration import Registration, register
from urbantwin.reconstruct.georeference.similarity import moved
from urbantwin.reconstruct.georeference.source_error import source_error
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Placed", "placed"]


#: Coordinates beyond this are those of a map grid, metres.
_GRID = 20_000.0
_MOST_POINTS = 12


@dataclass(frozen=True, eq=False)
class Placed:
    """A model on site.

    Attributes:
        model: in the site frame: east-north-up metres, z above the anchor's ground, float64.
            Warnings were added to its ``problems``.
        report: its placement, for ``geometry.json``: method, systems, transformations with their
            accuracy, scale, up axis with its source, offsets, residuals; ``summary`` has text
            lines.
        heights: the site's zero in known heights, for the next source.
        registration: data for a picture of the registration; ``None`` without registration.
    """

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    registration: Registration | None = None


def placed(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    *,
    heights: SiteHeights | None = None,
    progress: Progress | None = None,
) -> Placed:
    """Place a model on site.

    Settings of ``site.yaml`` (control points, a similarity, an origin, a CRS) have priority over
    the file (its CRS, its geotag). Registration refines any of them, or is used alone.

    Args:
        model: the model as read.
        source: its entry in ``site.yaml``.
        frame: the site frame.
        surroundings: region, roads and footprints for comparison.
        elevation: the bare earth so far; ``None`` or a level plain if unknown.
        heights: the anchor's ground height (`SiteHeights.of_dem`, or from an earlier source);
            ``None`` if unknown: this source then defines it.
        progress: called with the fraction done (0..1) and the current step.

    Raises:
        InputError: it cannot be placed without a guess; the error names what is missing.
    """
    tell = progress or untold
    check_finite(model, source)
    if elevation is not None and elevation.is_flat:
        elevation = None
    tell(0.0, "placing")
    first = _first(model, source, frame, surroundings, elevation, heights)
    report: dict[str, object] = {"source": source.name, "method": first.how, **first.report}
    registration = None
    if source.spec.register_to is not None:
        if not first.freedom.place:
            _check(first, surroundings, source, frame)
        tell(0.3, "registering")
        registration = register(
            first.model,
            source,
            surroundings,
            elevation,
            first.freedom,
            lambda share, text: tell(0.3 + 0.7 * share, text),
        )
        report["registration"] = registration.report
        first = replace(
            first,
            model=moved(first.model, registration.transform),
            how="registration" if first.freedom.place else f"{first.how}, then registration",
        )
        report["method"] = first.how
    _check(first, surroundings, source, frame)
    lines = registration.lines if registration else ()
    report["summary"] = summary_of(report, lines)
    if first.problems:
        report["problems"] = list(first.problems)
    out = replace(first.model, crs=None, up="z", unit_m=1.0, geotag=None)
    out = replace(out, problems=(*out.problems, *(f"{source.name}: {p}" for p in first.problems)))
    tell(1.0, "placed")
    return Placed(out, report, first.heights, registration)


def _check(
    first: InitialPlacement, surroundings: Surroundings, source: GeometrySource, frame: SiteFrame
) -> None:
    check_meets(first.model, surroundings.region, source, frame, how=first.how, field=first.said)


def _first(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    spec = source.spec
    if spec.control_points is not None:
        return by_control_points(model, source, frame, elevation, heights)
    in_site = spec.kind == "recording" and not (spec.origin or spec.crs or spec.register_to)
    if spec.similarity is not None or in_site:
        return by_similarity(model, source, elevation, heights)
    if spec.origin is not None:
        return by_origin(model, source, frame, elevation, heights)
    if spec.crs is not None or model.crs is not None:
        return by_crs(model, source, frame, surroundings, elevation, heights)
    if model.geotag is not None:
        return by_geotag(model, source, frame, elevation, heights)
    if spec.register_to is not None:
        return in_the_middle(model, source, surroundings, elevation, heights)
    far = max(float(np.abs(one[:, :2]).max()) for one in all_points(model))
    seems = " although its coordinates look like those of a map grid" if far > _GRID else ""
    raise source_error(
        source,
        f"does not say where it is{seems}",
        expected="crs, control_points, similarity, origin or register: true",
    )


def summary_of(report: dict[str, object], registration: tuple[str, ...]) -> list[str]:
    """Return a report of `placed` as text lines: method, accuracy, heights, residuals."""
    first = f"placed by {report['method']}"
    if "crs" in report:
        accuracy = report.get("accuracy_m")
        good = f", good to {accuracy:g} m" if isinstance(accuracy, float) else ""
        first = f"placed by {report['method']}: {report['crs']}{good}"
    lines = [first]
    points = report.get("control_points")
    if isinstance(points, list):
        told = ", ".join(f"{p['name']} {p['residual_m']:.3f} m" for p in points[:_MOST_POINTS])
        more = f" and {len(points) - _MOST_POINTS} more" if len(points) > _MOST_POINTS else ""
        lines.append(f"residuals: {told}{more}; RMS {report['rms_m']:.3f} m")
    axes = [f"{report['up']} is up ({report['up_why']})"] if "up_why" in report else []
    if "unit_m" in report:
        axes.append(f"its unit is {report['unit_m']:g} m ({report['unit_why']})")
    if axes:
        lines.append(", ".join(axes))
    lines += _heights(report)
    return [*lines, *(f"registered: {line}" for line in registration)]


def _heights(report: dict[str, object]) -> list[str]:
    heights = report.get("heights")
    if not isinstance(heights, dict):
        return []
    if "laid_on" in heights:
        return [f"heights: laid on {heights['laid_on']}"]
    anchor = heights["anchor"]
    text = f"heights: {heights['datum']}; the anchor's ground is at {anchor['anchor_m']:.2f} m"
    text += f" ({anchor['datum']}, by {anchor['of']})"
    if "ground_above_site_m" in heights:
        text += f"; its ground lies {heights['ground_above_site_m']:+.2f} m from the site's"
    return [text]
