"""Transformation of a lane model from a map's coordinates to the site frame."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import (
    Curve,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Piece,
    Profile,
    RoadArea,
    RoadSignal,
)

__all__ = ["Similarity", "crs_of", "placed", "shifted"]

#: A scale with a smaller effect over the whole map is dropped, metres.
SCALE_M = 0.002
#: Maximum number of points for the fit of a similarity.
PLACES = 4000
#: Parts of PROJ strings on heights, which are not transformed.
_VERTICAL = re.compile(r"\+(geoidgrids|vunits|vto_meter|geoid_crs|nadgrids=@null)(=\S+)?")


@dataclass(frozen=True)
class Similarity:
    """Rotation by ``angle`` (radians), scale and translation; lines, arcs and cubics stay such."""

    scale: float
    angle: float
    x: float
    y: float

    def apply(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return transformed points (N, 2)."""
        c, s = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        return np.column_stack(
            [self.x + c * xy[:, 0] - s * xy[:, 1], self.y + s * xy[:, 0] + c * xy[:, 1]]
        )


def placed(model: LaneModel, projection: str, frame: SiteFrame) -> LaneModel:
    """Return a lane model in the site frame.

    Both planes are conformal, so a similarity maps one to the other, with errors of millimetres
    over a few kilometres. It is fitted to the reference lines. Heights are unchanged.

    Args:
        model: the lane model, in a map's coordinates.
        projection: their CRS, as PROJ or WKT.
        frame: the site frame.

    Raises:
        InputError: the projection is not understood, or the map lies outside its area of validity.
    """
    crs = crs_of(projection)
    xy = np.vstack([_samples(road.curve) for road in model.roads])
    xy = xy[:: max(1, len(xy) // PLACES)]
    middle = xy.mean(axis=0)
    around = middle + np.array([[0.0, 0], [10, 0], [0, 10], [-10, 0], [0, -10]])
    try:
        transformer = Transformer.from_crs(crs, CRS(frame.proj_with_datum), always_xy=True)
        xy = np.vstack([xy, around])
        in_site = np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))
    except ProjError as error:
        raise InputError(
            f"the map's georeference cannot be used ({error})", place="geoReference"
        ) from None
    if not np.isfinite(in_site).all():
        raise InputError("the map lies where its georeference does not hold", place="geoReference")
    return _moved(model, _fitted(xy, in_site))


def crs_of(projection: str) -> CRS:
    """Return the projected CRS of a map.

    Raises:
        InputError: it is not understood, or is not a projected CRS.
    """
    try:
        crs = CRS(_VERTICAL.sub("", projection) if "+proj" in projection else projection)
    except CRSError:
        raise InputError(
            f"the map's georeference {projection[:80]!r} is not understood",
            place="geoReference",
            expected="PROJ or WKT",
        ) from None
    if crs.is_geographic:
        raise InputError(
            "the map's georeference gives degrees, not metres",
            place="geoReference",
            expected="a projection",
        )
    return crs


def shifted(model: LaneModel, offset: tuple[float, float, float, float]) -> LaneModel:
    """Return a lane model moved by a header's offset: rotated by its heading, then translated."""
    if not any(offset):
        return model
    x, y, z, heading = offset
    model = _moved(model, Similarity(1.0, heading, x, y)) if (x, y, heading) != (0, 0, 0) else model
    if not z:
        return model
    up = np.array([z, 0.0, 0.0, 0.0])
    roads = tuple(
        replace(road, elevation=Profile(road.elevation.start, road.elevation.abcd + up))
        for road in model.roads
    )
    signals = tuple(
        replace(signal, pose=(*signal.pose[:2], signal.pose[2] + z, signal.pose[3]))
        if signal.pose
        else signal
        for signal in model.signals
    )
    return replace(model, roads=roads, signals=signals)


def _samples(curve: Curve) -> NDArray[np.float64]:
    count = max(2, int(curve.length / 20))
    return curve.at(np.linspace(0.0, curve.length, count))[:, :2]


def _fitted(xy: NDArray[np.float64], there: NDArray[np.float64]) -> Similarity:
    """Return the least-squares similarity between point sets (Umeyama 1991, in the plane)."""
    a, b = xy.mean(axis=0), there.mean(axis=0)
    p, q = (xy - a) @ [1, 1j], (there - b) @ [1, 1j]
    turn = np.vdot(p, q) / np.vdot(p, p).real
    scale = float(np.abs(turn))
    if abs(scale - 1) * float(np.abs(p).max()) < SCALE_M:
        scale = 1.0
    angle = float(np.angle(turn))
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    x, y = b - [c * a[0] - s * a[1], s * a[0] + c * a[1]]
    return Similarity(scale, angle, float(x), float(y))


def _moved(model: LaneModel, how: Similarity) -> LaneModel:
    return replace(
        model,
        roads=tuple(_road(road, how) for road in model.roads),
        junctions=tuple(_junction(junction, how) for junction in model.junctions),
        areas=tuple(_area(area, how.scale) for area in model.areas),
        signals=tuple(_signal(signal, how) for signal in model.signals),
    )


def _road(road: ModelRoad, how: Similarity) -> ModelRoad:
    xy = how.apply(np.array([(piece.x, piece.y) for piece in road.curve.pieces]))
    k = how.scale
    pieces = tuple(
        Piece(
            float(x),
            float(y),
            piece.heading + how.angle,
            piece.length * k,
            piece.curvature / k,
            tuple(value * k for value in piece.u),
            tuple(value * k for value in piece.v),
        )
        for piece, (x, y) in zip(road.curve.pieces, xy, strict=True)
    )
    placed_road = replace(road, curve=Curve(pieces))
    if k == 1.0:
        return placed_road
    return replace(
        placed_road,
        offset=_scaled(road.offset, k, k),
        elevation=_scaled(road.elevation, k),
        bank=_scaled(road.bank, k),
        crown=_scaled(road.crown, k),
        sections=tuple(_section(section, k) for section in road.sections),
    )


def _scaled(profile: Profile, k: float, value: float = 1.0) -> Profile:
    """Return a profile with stations scaled by ``k`` and values scaled by ``value``."""
    return Profile(profile.start * k, profile.abcd * value / k ** np.arange(4))


def _section(section: LaneSection, k: float) -> LaneSection:
    lanes = tuple(replace(lane, width=_scaled(lane.width, k, k)) for lane in section.lanes)
    return replace(section, s=section.s * k, lanes=lanes)


def _junction(junction: ModelJunction, how: Similarity) -> ModelJunction:
    return replace(junction, outline=how.apply(junction.outline.reshape(-1, 2)))


def _area(area: RoadArea, k: float) -> RoadArea:
    if k == 1.0:
        return area
    return replace(area, s=area.s * k, corners=area.corners * [k, k, 1.0])


def _signal(signal: RoadSignal, how: Similarity) -> RoadSignal:
    k = how.scale
    if signal.pose:
        x, y, z, heading = signal.pose
        point = how.apply(np.array([[x, y]]))[0]
        pose = (float(point[0]), float(point[1]), z, heading + how.angle)
        signal = replace(signal, pose=pose)
    return signal if k == 1.0 else replace(signal, s=signal.s * k, t=signal.t * k)
