"""Georeferencing of models with a known CRS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.io.model import ImportedModel
from urbantwin.reconstruct.georeference.axes import UNITS
from urbantwin.reconstruct.georeference.crs import crs_from_text, in_plan, lengths_of
from urbantwin.reconstruct.georeference.height_system import (
    HeightSystem,
    SiteHeights,
)
from urbantwin.reconstruct.georeference.initial_placement import InitialPlacement
from urbantwin.reconstruct.georeference.overlap import (
    all_points,
    check_meets,
    distance_to,
)
from urbantwin.reconstruct.georeference.pose_search import Freedom
from urbantwin.reconstruct.georeference.similarity import Similarity, moved
from urbantwin.reconstruct.georeference.vertical_datum import (
    heights_on_site,
)
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["by_crs"]

#: Distance from the site beyond which the up axis is wrong, metres.
_FAR_M = 10_000.0


def by_crs(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> InitialPlacement:
    """Place a model by its CRS, including the vertical datum.

    Raises:
        InputError: the CRS is unknown or places it elsewhere, or its heights cannot be transformed
            to the site's.
    """
    spec = source.spec
    problems: list[str] = []
    crs = model.crs
    if spec.crs is not None:
        crs = crs_from_text(spec.crs, source)
        if model.crs is not None and model.crs != crs:
            problems.append(f"its own CRS {model.crs.name!r} was set aside for {crs.name!r}")
    assert crs is not None
    report: dict[str, object] = {"crs": _named(crs)}
    model = _in_units_of(model, crs, source, report)
    up, why = _up_in_crs(model, crs, source, frame, surroundings)
    report |= {"up": up, "up_why": why}
    model = moved(model, Similarity.of_axes(up, 1.0))
    transformed = {}
    told: dict[str, object] = {}

    def to_site(points: NDArray[np.float64]) -> NDArray[np.float64]:
        plan = in_plan(points, crs, frame, source)
        told.update(transformation=plan.transformation, accuracy_m=plan.accuracy_m)
        transformed["missing"] = plan.missing
        return np.column_stack([plan.xy, plan.height])

    out = _with_points(model, to_site)
    report |= told
    accuracy = told.get("accuracy_m")
    if not isinstance(accuracy, float) or accuracy > 3.0:
        said = "of unknown accuracy" if accuracy is None else f"good to {accuracy:g} m only"
        grids = ", ".join(transformed.get("missing", ()))
        better = f"; PROJ's grid {grids} would do better" if grids else ""
        problems.append(f"the transformation of its CRS is {said}{better}")
    system = HeightSystem.of(crs)
    first = InitialPlacement(out, report, heights, "its CRS", "crs")
    check_meets(out, surroundings.region, source, frame, how=f"its CRS {crs.name!r}", field="crs")
    if system is None:
        # heights without a datum have the unit of the plan
        lengths = lengths_of(crs) or 1.0
        if lengths != 1.0:
            out = _with_points(out, lambda p: p * [1.0, 1.0, lengths])
            report["height_unit_m"] = lengths
    laid = heights_on_site(out, frame.lonlat_from_site, system, source, frame, elevation, heights)
    report["heights"] = laid.report
    return replace(
        first,
        model=laid.model,
        heights=laid.heights,
        problems=(*problems, *laid.problems),
        freedom=Freedom(height=bool(laid.problems)),
    )


def _in_units_of(
    model: ImportedModel, crs: CRS, source: GeometrySource, report: dict[str, object]
) -> ImportedModel:
    """Scale a model with a unit in ``site.yaml`` to the unit of its CRS."""
    unit, lengths = source.spec.unit, lengths_of(crs)
    if unit == "auto" or lengths is None:
        return model
    said = UNITS[unit] if isinstance(unit, str) else float(unit)
    if abs(said / lengths - 1) < 1e-9:
        return model
    report["scale"] = said / lengths
    return moved(model, Similarity(said / lengths, np.eye(3), np.zeros(3)))


def _up_in_crs(
    model: ImportedModel,
    crs: CRS,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
) -> tuple[str, str]:
    """Return the height axis: as stated, otherwise the one with which the model is at the site."""
    if crs.is_geocentric:
        return "z", "geocentric: up is away from the Earth's middle"
    if source.spec.up != "auto":
        return source.spec.up, "site.yaml says so"
    order = ("z", "y") if model.up != "y" else ("y", "z")
    points = np.vstack([one[:: max(1, len(one) // 1000)] for one in all_points(model)])
    off: dict[str, float] = {}
    for up in order:
        turned = Similarity.of_axes(up, 1.0).apply(points)
        try:
            plan = in_plan(turned, crs, frame, source)
        except InputError:
            if up == order[-1] and not off:
                raise
            continue
        off[up] = distance_to(surroundings.region, [np.column_stack([plan.xy, plan.height])])
        if off[up] < _FAR_M:
            break
    if not off:
        return order[0], "usual for its CRS"
    best = min(off, key=lambda one: off[one])
    if best == model.up:
        return best, "the file says so"
    if best == order[0]:
        return best, "usual for its CRS"
    return best, f"found: with {order[0]} up it would lie far away"


def _with_points(
    model: ImportedModel, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> ImportedModel:
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None and len(mesh.vertices):
        mesh = replace(mesh, vertices=change(mesh.vertices))
    if cloud is not None and len(cloud.points):
        cloud = replace(cloud, points=change(cloud.points))
    return replace(model, mesh=mesh, cloud=cloud)


def _named(crs: CRS) -> str:
    code = crs.to_authority()
    return crs.name if code is None else f"{crs.name} ({':'.join(code)})"
