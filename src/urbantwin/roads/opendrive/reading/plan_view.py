"""Reading reference lines."""

from __future__ import annotations

import numpy as np
from lxml import etree

from urbantwin.geometry import wrapped
from urbantwin.roads.model import Curve, Piece
from urbantwin.roads.opendrive.reading.clothoid import arc_length, polynomial_pieces, spiral_pieces
from urbantwin.roads.opendrive.reading.parsing import Spot

__all__ = ["read_curve"]

#: A reference line may be this much longer or shorter than its road says, metres.
LENGTH_M = 0.1
#: Gaps in a reference line from here on are remarked, and from there on refused, metres.
GAP_M, BROKEN_M = 0.01, 1.0
#: The longest road that is read, metres.
LONGEST_M = 1e6
#: Shorter pieces are left out, metres.
SHORTEST_M = 1e-6
#: Curvatures below this are straight, 1/m: at 1 km they are 0.05 mm off.
STRAIGHT = 1e-10
_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")


def read_curve(road: etree._Element, spot: Spot) -> Curve:
    """Return the reference line of a road.

    Lines, arcs and parametric cubics are kept as they are. Clothoids and ``poly3`` become
    parametric cubics that stay within 0.1 mm of them.

    Args:
        road: the ``<road>``.
        spot: the road, for errors.

    Raises:
        InputError: there is no reference line, it has no length, it has a gap, or a number in it
            is invalid.
    """
    items = road.findall("planView/geometry")
    if not items:
        raise spot.error("has no reference line", expected="<planView> with <geometry>")
    told = spot.number(road, "length")
    if not 0 < told <= LONGEST_M:
        raise spot.error(f"has length {told:g}", expected=f"more than 0 m, up to {LONGEST_M:g} m")
    pieces: list[Piece] = []
    s = 0.0
    for item in sorted(items, key=lambda e: spot.number(e, "s")):
        at, length = spot.number(item, "s"), spot.number(item, "length")
        if length < 0:
            raise spot.error(
                f"<geometry> at s = {at:g} has length {length:g}", expected="0 or more"
            )
        if abs(at - s) > LENGTH_M:
            raise spot.error(
                f"<geometry> begins at s = {at:g}, where the one before ends at {s:.3f}",
                expected="one after the other",
            )
        if length > SHORTEST_M:
            pieces += _pieces(item, length, spot.within(f"geometry at s = {at:g}"))
        s += length
    if not pieces and told <= LENGTH_M:
        # Tools write manoeuvres straight across a border between two roads like this.
        spot.remark("roads whose reference line has no length: a straight one is taken")
        x, y, heading = (spot.number(items[0], key) for key in ("x", "y", "hdg"))
        pieces, s = [Piece(x, y, heading, told)], told
    if not pieces:
        raise spot.error("has a reference line of no length", expected="more than 0 m")
    if abs(s - told) > LENGTH_M:
        spot.remark("roads whose length is not that of their reference line: the line's is taken")
    curve = Curve(tuple(pieces))
    _check_gaps(curve, spot)
    return curve


def _pieces(item: etree._Element, length: float, spot: Spot) -> list[Piece]:
    shape = next((child for child in item if child.tag in _SHAPES), None)
    if shape is None:
        raise spot.error("has no shape", expected=f"one of {', '.join(_SHAPES)}")
    x, y, heading = (spot.number(item, key) for key in ("x", "y", "hdg"))
    heading = wrapped(heading) if abs(heading) > 7 else heading
    if shape.tag == "line":
        return [Piece(x, y, heading, length)]
    if shape.tag == "arc":
        return [Piece(x, y, heading, length, _bend(spot.number(shape, "curvature")))]
    if shape.tag == "spiral":
        if shape.get("curvStart") is None or shape.get("curvEnd") is None:
            spot.remark("spirals that are straight where they do not say how they bend")
        first, last = (spot.number(shape, key, 0.0) for key in ("curvStart", "curvEnd"))
        if abs(last - first) * length < 1e-9:
            return [Piece(x, y, heading, length, _bend((first + last) / 2))]
        if max(abs(first), abs(last)) * length > 1000:
            raise spot.error("turns more than 1000 radians", expected="a spiral of a road")
        return spiral_pieces((x, y, heading), length, first, last)
    if shape.tag == "poly3":
        abcd = tuple(spot.number(shape, key) for key in "abcd")
        return polynomial_pieces((x, y, heading), length, abcd)
    u, v = (_coefficients(shape, axis, spot) for axis in "UV")
    if shape.get("pRange", "normalized") == "arcLength":
        u, v = ([value * length**k for k, value in enumerate(row)] for row in (u, v))
    piece = Piece(x, y, heading, length, u=tuple(u), v=tuple(v))
    if not any(u[1:]) and not any(v[1:]):
        raise spot.error("does not move", expected="coefficients of a curve")
    if abs(arc_length(u, v) - length) > LENGTH_M:
        spot.remark("cubics whose length is not what the file says: stations stretch along them")
    return [piece]


def _bend(curvature: float) -> float:
    return 0.0 if abs(curvature) < STRAIGHT else curvature


def _coefficients(shape: etree._Element, axis: str, spot: Spot) -> list[float]:
    return [spot.number(shape, letter + axis) for letter in "abcd"]


def _check_gaps(curve: Curve, spot: Spot) -> None:
    if len(curve.pieces) < 2:
        return
    ends = curve.at(curve.starts[1:-1] - 1e-9)
    starts = np.array([(piece.x, piece.y) for piece in curve.pieces[1:]])
    gaps = np.hypot(*(starts - ends[:, :2]).T)
    k = int(gaps.argmax())
    at = f"a gap of {gaps[k]:.3g} m in its reference line at s = {curve.starts[k + 1]:.3f}"
    if gaps[k] > BROKEN_M:
        raise spot.error(f"has {at}", expected="pieces that meet")
    if gaps[k] > GAP_M:
        spot.remark("reference lines with gaps of more than 1 cm")
