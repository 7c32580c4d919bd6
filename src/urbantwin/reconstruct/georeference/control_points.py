"""Control points, known in a model and on site: reading, checks, and the fit of a similarity."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.number_text import finite_number
from urbantwin.reconstruct.georeference.similarity import Similarity, fitted, level_fitted
from urbantwin.site.geometry import ControlPoint, GeometrySource

__all__ = ["ControlPoints", "fit", "read_control_points"]

_COLUMNS = "columns model_x, model_y, model_z and x, y, z (or latitude, longitude, height_m)"
#: Maximum deviation of a point from the others' transform, metres; larger ones are named in the
#: error.
_OUTLIER_M = 1.0
#: Maximum residual, metres, or a fiftieth of the points' extent if larger.
_WORST_M = 2.0
_MOST_POINTS = 10_000


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Points known on both sides.

    Attributes:
        names: their names.
        model: (N, 3) in the model's own axes and units.
        site: (N, 3) site frame, metres.
        file: file that defines them, for errors.
        place: position in the file.
        notes: assumptions made.
    """

    names: tuple[str, ...]
    model: NDArray[np.float64]
    site: NDArray[np.float64]
    file: Path
    place: str | None
    notes: tuple[str, ...]


def read_control_points(
    source: GeometrySource, frame: SiteFrame, elevation: Elevation | None
) -> ControlPoints:
    """Return a source's control points, from ``site.yaml`` or the CSV file that it names.

    A point without a height is on the ground.

    Raises:
        InputError: the file is missing or a row is invalid.
    """
    given = source.spec.control_points
    assert given is not None
    if isinstance(given, str):
        file = source.document.file.parent / given
        names, points = _read_csv(file)
        place = None
    else:
        file, points = source.document.file, given
        names = [f"control_points[{number}]" for number in range(len(given))]
        place = source.place("control_points")
    site, laid = np.zeros((len(points), 3)), []
    for row, (name, point) in enumerate(zip(names, points, strict=True)):
        if point.site_m is not None:
            site[row] = point.site_m
            continue
        assert point.longitude is not None
        assert point.latitude is not None
        site[row, :2] = frame.site_from_lonlat([[point.longitude, point.latitude]])[0]
        if point.height_m is None:
            laid.append(name)
            site[row, 2] = 0.0 if elevation is None else elevation.raw_at(site[row, :2])[0]
        else:
            site[row, 2] = point.height_m
    notes = (f"without a height, laid on the ground: {', '.join(laid[:5])}",) if laid else ()
    model = np.array([point.model for point in points], np.float64).reshape(-1, 3)
    return ControlPoints(tuple(names), model, site, file, place, notes)


def fit(points: ControlPoints, upright: Similarity | None) -> tuple[Similarity, list[float]]:
    """Fit a similarity to control points, and return it with each point's residual in metres.

    Args:
        points: three or more points that are not collinear; or two, or several collinear ones, if
            the model's up axis is known.
        upright: the transform of the model to z-up; ``None`` if unknown.

    Raises:
        InputError: too few, coincident, collinear, or inconsistent points.
    """
    count = len(points.model)
    if count < 2:
        raise _wrong(points, f"{'is' if count == 1 else 'are'} {count}", "at least three")
    _check_apart(points)
    extent = float(np.linalg.norm(np.ptp(points.site, axis=0)))
    if count == 2 and upright is None:
        raise _wrong(points, "are 2", "at least three, or up: y or z")
    flat = count == 2 or any(_on_a_line(side) for side in (points.model, points.site))
    if flat and upright is None:
        raise _wrong(points, "lie on one line, about which the model could turn", "one beside it")
    if flat:
        assert upright is not None
        if any(np.ptp(side[:, :2], axis=0).max() == 0 for side in (points.site,)):
            raise _wrong(points, "lie above each other", "points apart in plan")

    def solve(rows: NDArray[np.int64]) -> Similarity:
        a, b = points.model[rows], points.site[rows]
        if flat and upright is not None:
            return level_fitted(upright.apply(a), b).after(upright)
        return fitted(a, b)

    everyone = np.arange(count)
    out = solve(everyone)
    residual = np.linalg.norm(out.apply(points.model) - points.site, axis=1)
    if not np.isfinite(residual).all() or out.scale <= 0:
        raise _wrong(points, "give no transform", "points apart on both sides")
    if count >= 4 and not flat:
        _check_outlier(points, solve)
    worst = int(np.argmax(residual))
    if residual[worst] > max(_WORST_M, extent / 50):
        raise _wrong(
            points,
            f"disagree: {points.names[worst]} is {residual[worst]:.2f} m off",
            f"points that agree within {max(_WORST_M, extent / 50):.2g} m",
        )
    return out, [round(float(one), 4) for one in residual]


def _check_apart(points: ControlPoints) -> None:
    for side, what in ((points.model, "in the model"), (points.site, "on site")):
        _, first, group = np.unique(side, axis=0, return_index=True, return_inverse=True)
        twice = np.flatnonzero(first[group.ravel()] != np.arange(len(side)))
        if len(twice):
            one, other = int(first[group.ravel()][twice[0]]), int(twice[0])
            pair = f"{points.names[one]} and {points.names[other]}"
            raise _wrong(points, f"{pair} are the same point {what}", "points apart")


def _check_outlier(points: ControlPoints, solve: object) -> None:
    """Raise an error if a single point deviates from the fit of the others."""
    assert callable(solve)
    count = len(points.model)
    found: list[tuple[float, float, int]] = []
    for number in range(count):
        rest = np.delete(np.arange(count), number)
        if _on_a_line(points.model[rest]) or _on_a_line(points.site[rest]):
            continue
        transform = solve(rest)
        off = np.linalg.norm(transform.apply(points.model) - points.site, axis=1)
        found.append((float(np.sqrt((off[rest] ** 2).mean())), float(off[number]), number))
    if not found:
        return
    agree, off_by, number = min(found)
    if off_by > max(_OUTLIER_M, 5 * agree):
        raise _wrong(
            points,
            f"{points.names[number]} is {off_by:.2f} m off, and without it the others agree to "
            f"{agree:.2f} m",
            "that point corrected or left out",
        )


def _on_a_line(points: NDArray[np.float64]) -> bool:
    """Return whether points are collinear, to a thousandth of their extent."""
    if len(points) < 3:
        return True
    stretch = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(stretch[1] <= 1e-3 * stretch[0])


def _wrong(points: ControlPoints, problem: str, expected: str) -> InputError:
    if not problem.startswith(("control", *points.names)):
        problem = f"control points {problem}"
    return InputError(problem, file=points.file, place=points.place, expected=expected)


def _read_csv(file: Path) -> tuple[list[str], list[ControlPoint]]:
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        why = "not found" if isinstance(error, FileNotFoundError) else f"cannot be read ({error})"
        raise InputError(why, file=file, expected=f"a CSV file: {_COLUMNS}") from None
    except UnicodeDecodeError:
        raise InputError("is not text", file=file, expected=f"a CSV file: {_COLUMNS}") from None
    lines = [one for one in text.splitlines() if one.strip() and not one.startswith("#")]
    first = lines[0] if lines else ""
    separator = ";" if first.count(";") > first.count(",") else ","
    rows = csv.DictReader(io.StringIO("\n".join(lines)), delimiter=separator, skipinitialspace=True)
    try:
        columns = {(name or "").strip().lower() for name in rows.fieldnames or ()}
    except csv.Error as error:
        raise InputError(f"is not CSV ({error})", file=file, expected=_COLUMNS) from None
    on_site = {"x", "y", "z"} <= columns
    if not {"model_x", "model_y", "model_z"} <= columns or not (
        on_site or {"latitude", "longitude"} <= columns
    ):
        raise InputError("has other columns", file=file, expected=_COLUMNS)
    names: list[str] = []
    points: list[ControlPoint] = []
    try:
        for number, row in enumerate(rows):
            if number >= _MOST_POINTS:
                raise InputError(f"holds more than {_MOST_POINTS} points", file=file)
            clean = {(key or "").strip().lower(): value for key, value in row.items()}
            names.append(str(clean.get("name") or f"point {number + 1}").strip()[:40])
            points.append(_point(clean, on_site, file, names[-1]))
    except csv.Error as error:
        raise InputError(f"is not CSV ({error})", file=file, expected=_COLUMNS) from None
    return names, points


def _point(row: Mapping[str, object], on_site: bool, file: Path, name: str) -> ControlPoint:
    def number(key: str) -> float:
        value = row.get(key)
        out = finite_number(str(value).strip())
        if out is None:
            raise InputError(f"{key} is {value!r}", file=file, place=name, expected="a number")
        return out

    model = [number(f"model_{axis}") for axis in "xyz"]
    if on_site:
        return ControlPoint(model=model, site_m=[number(axis) for axis in "xyz"])
    latitude, longitude = number("latitude"), number("longitude")
    if not (-90 <= latitude <= 90 and -180 <= longitude <= 180):
        raise InputError(
            f"lies at {latitude:g}, {longitude:g}", file=file, place=name, expected="degrees"
        )
    height = number("height_m") if str(row.get("height_m") or "").strip() else None
    return ControlPoint(model=model, latitude=latitude, longitude=longitude, height_m=height)
