"""From a model in its own frame to the same model on site."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.reconstruct.georeference.axes import UNITS, Axes, axes_of
from urbantwin.reconstruct.georeference.complaint import complaint
from urbantwin.reconstruct.georeference.control_points import fit, read_control_points
from urbantwin.reconstruct.georeference.crs import crs_from_text, in_plan, lengths_of
from urbantwin.reconstruct.georeference.heights import (
    HeightSystem,
    NoGridError,
    SiteHeights,
    heights_between,
)
from urbantwin.reconstruct.georeference.reach import (
    all_points,
    check_finite,
    check_meets,
    distance_to,
)
from urbantwin.reconstruct.georeference.register import Registration, register
from urbantwin.reconstruct.georeference.search import Freedom
from urbantwin.reconstruct.georeference.settle import (
    UNSTATED_M,
    Settled,
    ground_above_site,
    laid_on_ground,
    settled,
    shifted,
)
from urbantwin.reconstruct.georeference.similarity import Similarity, moved
from urbantwin.reconstruct.model import ImportedModel
from urbantwin.reconstruct.surroundings import Surroundings
from urbantwin.site.geometry import GeometrySource

__all__ = ["Placed", "placed"]

Progress = Callable[[float, str], None]

#: A model that is placed by a CRS with the wrong axis up lies farther off than this, metres.
_FAR_M = 10_000.0


@dataclass(frozen=True, eq=False)
class Placed:
    """A model on site.

    Attributes:
        model: in the site frame: east-north-up metres, z above the anchor's ground, float64.
            What a person should look at was added to its ``problems``.
        report: how it was placed, for ``geometry.json``: method, systems, transformations with
            their accuracy, scale, upward axis and why, offsets, residuals.
        heights: what the site's zero is in the heights of a source: to be handed to the next one.
        registration: what a picture of the registration shows; ``None`` where there was none.
    """

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    registration: Registration | None = None


#: A first place of which everything is known.
_NONE = Freedom()


@dataclass(frozen=True, eq=False)
class _First:
    """A model after its first placing."""

    model: ImportedModel
    report: dict[str, object]
    heights: SiteHeights | None
    how: str
    said: str | None = None
    problems: tuple[str, ...] = ()
    freedom: Freedom = _NONE


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

    What ``site.yaml`` says (control points, a similarity, an origin, a CRS) goes before what the
    file says (its CRS, its geotag). Registration refines any of them, or stands alone.

    Args:
        model: as it was read.
        source: what ``site.yaml`` says of it.
        frame: the site frame.
        surroundings: region, roads and footprints to compare it with.
        elevation: the bare earth so far; ``None`` or a level plain where nothing is known of it.
        heights: what the anchor's ground is in known heights (`SiteHeights.of_dem`, or what an
            earlier source gave); ``None`` where nothing is known: this source then says it.
        progress: told the share done (0..1) and what is being done.

    Raises:
        InputError: it cannot be placed, or not without a guess; the line says what is missing.
    """
    tell = progress or (lambda share, text: None)
    check_finite(model, source)
    if elevation is not None and elevation.is_flat:
        elevation = None
    tell(0.0, "placing")
    first = _first(model, source, frame, surroundings, elevation, heights)
    report: dict[str, object] = {"source": source.name, "method": first.how, **first.report}
    registration = None
    if source.spec.register_to is not None:
        if not first.freedom.place:
            _check(first, surroundings, source)
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
            how=f"{first.how}, registration",
        )
        report["method"] = first.how
    _check(first, surroundings, source)
    if first.problems:
        report["problems"] = list(first.problems)
    out = replace(first.model, crs=None, up="z", unit_m=1.0, geotag=None)
    out = replace(out, problems=(*out.problems, *(f"{source.name}: {p}" for p in first.problems)))
    tell(1.0, "placed")
    return Placed(out, report, first.heights, registration)


def _check(first: _First, surroundings: Surroundings, source: GeometrySource) -> None:
    check_meets(first.model, surroundings.region, source, how=first.how, field=first.said)


def _first(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
    spec = source.spec
    if spec.control_points is not None:
        return _by_control_points(model, source, frame, elevation, heights)
    if spec.similarity is not None:
        return _by_similarity(model, source, elevation, heights)
    if spec.origin is not None:
        return _by_origin(model, source, frame, elevation, heights)
    if spec.crs is not None or model.crs is not None:
        return _by_crs(model, source, frame, surroundings, elevation, heights)
    if model.geotag is not None:
        return _by_geotag(model, source, frame, elevation, heights)
    if spec.register_to is not None:
        return _in_the_middle(model, source, surroundings, elevation, heights)
    raise complaint(
        source,
        "does not say where it is",
        expected="crs, control_points, similarity, origin or register: true",
    )


def _by_control_points(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
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
    return _First(
        out,
        report | more[0],
        heights,
        "control points",
        "control_points",
        (*problems, *more[1]),
    )


def _by_similarity(
    model: ImportedModel,
    source: GeometrySource,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
    spec = source.spec.similarity
    assert spec is not None
    axes = axes_of(model, source)
    if not axes.unit_known:
        # Its scale is given: no guess is put before it.
        axes = replace(axes, unit_m=1.0, unit_why="not said: the similarity's scale is all")
    yaw, pitch, roll = np.radians([spec.yaw_deg, spec.pitch_deg, spec.roll_deg])
    rotation = _about("z", yaw) @ _about("y", pitch) @ _about("x", roll)
    given = Similarity(spec.scale, rotation, np.array(spec.translation_m, np.float64))
    transform = given.after(axes.transform())
    out, more = _with_offset(moved(model, transform), source, elevation)
    report = {**axes.as_report(), "transform": transform.as_report(), "scale": transform.scale}
    return _First(out, report | more[0], heights, "similarity", "similarity", tuple(more[1]))


def _by_origin(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
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
    return _First(
        out,
        report,
        heights,
        "origin",
        "origin",
        problems,
        Freedom(
            heading="heading_deg" not in spec.model_fields_set,
            scale=not axes.unit_known,
            level=not axes.up_known,
            pivot=_xy(frame, spec.longitude, spec.latitude),
        ),
    )


def _by_geotag(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
    tag = model.geotag
    assert tag is not None
    axes = axes_of(model, source)
    out = _at(model, axes, frame, tag.longitude, tag.latitude, tag.heading_deg)
    report: dict[str, object] = {**axes.as_report(), "heading_deg": tag.heading_deg}
    problems: list[str] = []
    told: Settled | None = None
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
            told = Settled(raised, {"transformation": how, **more[0]}, tuple(more[1]), heights)
        except NoGridError as error:
            problems.append(f"the height of its geotag was not used: {error}")
    if told is None:
        out = shifted(out, source.spec.height_offset_m)
        told = laid_on_ground(out, elevation, heights, source.name)
    report["heights"] = told.report
    return _First(
        told.model,
        report,
        heights,
        "geotag",
        None,
        (*problems, *told.problems),
        Freedom(
            heading=False,
            scale=not axes.unit_known,
            level=not axes.up_known,
            pivot=_xy(frame, tag.longitude, tag.latitude),
        ),
    )


def _by_crs(
    model: ImportedModel,
    source: GeometrySource,
    frame: SiteFrame,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
    spec = source.spec
    problems: list[str] = []
    crs = model.crs
    if spec.crs is not None:
        crs = crs_from_text(spec.crs, source)
        if model.crs is not None and model.crs != crs:
            problems.append(f"its own CRS {model.crs.name!r} was set aside for {crs.name!r}")
    assert crs is not None
    report: dict[str, object] = {"crs": crs.name}
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
    first = _First(out, report, heights, "its CRS", "crs")
    _check(first, surroundings, source)
    if system is None:
        # Heights without a datum of their own are in the unit of the plan.
        lengths = lengths_of(crs) or 1.0
        if lengths != 1.0:
            out = _with_points(out, lambda p: p * [1.0, 1.0, lengths])
            report["height_unit_m"] = lengths
    laid = settled(out, frame.lonlat_from_site, system, source, frame, elevation, heights)
    report["heights"] = laid.report
    return replace(
        first,
        model=laid.model,
        heights=laid.heights,
        problems=(*problems, *laid.problems),
    )


def _in_the_middle(
    model: ImportedModel,
    source: GeometrySource,
    surroundings: Surroundings,
    elevation: Elevation | None,
    heights: SiteHeights | None,
) -> _First:
    """Put the middle of a model that knows no place into the middle of the region."""
    axes = axes_of(model, source)
    out = moved(model, axes.transform())
    points = np.vstack(all_points(out))
    low, high = np.quantile(points[:: max(1, len(points) // 100_000)], [0.02, 0.98], axis=0)
    middle = (low + high) / 2
    centre = surroundings.region.centroid
    shift = np.array([centre.x - middle[0], centre.y - middle[1], -low[2]])
    out = moved(out, Similarity(1.0, np.eye(3), shift))
    return _First(
        out,
        axes.as_report(),
        heights,
        "nothing but registration",
        "register",
        (),
        Freedom(
            heading=True,
            place=True,
            scale=not axes.unit_known,
            level=not axes.up_known,
        ),
    )


def _at(
    model: ImportedModel,
    axes: Axes,
    frame: SiteFrame,
    longitude: float,
    latitude: float,
    heading_deg: float,
) -> ImportedModel:
    """Put a model's origin at a place, its +y turned to a heading clockwise from north."""
    xy = frame.site_from_lonlat([[longitude, latitude]])[0]
    turn = Similarity.in_plan(-float(np.radians(heading_deg)), [xy[0], xy[1], 0.0])
    return moved(model, turn.after(axes.transform()))


def _xy(frame: SiteFrame, longitude: float, latitude: float) -> tuple[float, float]:
    x, y = frame.site_from_lonlat([[longitude, latitude]])[0]
    return float(x), float(y)


def _with_offset(
    model: ImportedModel, source: GeometrySource, elevation: Elevation | None
) -> tuple[ImportedModel, tuple[dict[str, object], list[str]]]:
    """Add height_offset_m where heights were given on site, and compare the grounds."""
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


def _in_units_of(
    model: ImportedModel, crs: CRS, source: GeometrySource, report: dict[str, object]
) -> ImportedModel:
    """Scale a model whose unit ``site.yaml`` says to the unit of its CRS."""
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
    """Return the axis that is height: said, or else the one with which the model meets the site."""
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


def _about(axis: str, angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),
    }[axis]
