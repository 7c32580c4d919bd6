"""Reading of reference lines and road heights."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.model import Curve, Piece, Profile
from urbantwin.roads.opendrive.cubics import added, stepped
from urbantwin.roads.opendrive.reading.parsing import Spot

__all__ = ["read_curve", "read_heights"]

#: Tolerance between the length of a reference line and of its road, metres.
LENGTH_M = 0.1
#: Gaps in a reference line that are reported, and those that are an error, metres.
GAP_M, BROKEN_M = 0.01, 1.0
#: Maximum length of a road, metres.
LONGEST_M = 1e6
#: Shorter pieces are left out, metres.
SHORTEST_M = 1e-6
#: Smaller curvatures are straight, 1/m: the deviation at 1 km is 0.05 mm.
STRAIGHT = 1e-10
_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")
#: Maximum distance between a curve and its approximating cubics at equal stations, metres.
TOLERANCE_M = 5e-5
#: Maximum turn of a clothoid per quadrature step, radians.
STEP_TURN = 0.4
#: Step of u for the integration of the length of a cubic over u, metres.
STEP_U_M = 0.25
#: Maximum number of such steps.
STEPS_U = 20_000
_ROOTS, _WEIGHTS = np.polynomial.legendre.leggauss(10)
NODES, WEIGHTS = (_ROOTS + 1) / 2, _WEIGHTS / 2
_PointsAt = Callable[[NDArray[np.float64]], NDArray[np.float64]]
#: Maximum deviation of a cross section from a crown without a remark, metres.
SHAPE_M = 0.01


def read_curve(road: etree._Element, spot: Spot) -> Curve:
    """Return the reference line of a road.

    Lines, arcs and parametric cubics are kept. Clothoids and ``poly3`` become parametric cubics
    within 0.1 mm of them.

    Args:
        road: the ``<road>``.
        spot: the road, for errors.

    Raises:
        InputError: there is no reference line, it has no length, it has a gap, or a number in it is
            invalid.
    """
    items = road.findall("planView/geometry")
    if not items:
        raise spot.error("has no reference line", expected="<planView> with <geometry>")
    stated = spot.number(road, "length")
    if not 0 < stated <= LONGEST_M:
        raise spot.error(f"has length {stated:g}", expected=f"more than 0 m, up to {LONGEST_M:g} m")
    pieces: list[Piece] = []
    s = 0.0
    for item in sorted(items, key=lambda e: spot.number(e, "s")):
        start, length = spot.number(item, "s"), spot.number(item, "length")
        if length < 0:
            raise spot.error(
                f"<geometry> at s = {start:g} has length {length:g}", expected="0 or more"
            )
        if abs(start - s) > LENGTH_M:
            raise spot.error(
                f"<geometry> begins at s = {start:g}, where the one before ends at {s:.3f}",
                expected="one after the other",
            )
        if length > SHORTEST_M:
            pieces += _pieces(item, length, spot.within(f"geometry at s = {start:g}"))
        s += length
    if not pieces and stated <= LENGTH_M:
        # Tools write movements straight across a boundary between two roads like this.
        spot.remark("roads whose reference line has no length: a straight one is taken")
        x, y, heading = (spot.number(items[0], key) for key in ("x", "y", "hdg"))
        pieces, s = [Piece(x, y, heading, stated)], stated
    if not pieces:
        raise spot.error("has a reference line of no length", expected="more than 0 m")
    if abs(s - stated) > LENGTH_M:
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
    gap_text = f"a gap of {gaps[k]:.3g} m in its reference line at s = {curve.starts[k + 1]:.3f}"
    if gaps[k] > BROKEN_M:
        raise spot.error(f"has {gap_text}", expected="pieces that meet")
    if gaps[k] > GAP_M:
        spot.remark("reference lines with gaps of more than 1 cm")


def spiral_pieces(
    start: tuple[float, float, float], length: float, first: float, last: float
) -> list[Piece]:
    """Return a clothoid (ASAM OpenDRIVE 1.8, 9.5) as cubics.

    Args:
        start: x, y, heading of its start.
        length: its length, metres.
        first: curvature at its start, 1/m.
        last: curvature at its end, 1/m.
    """
    rate = (last - first) / length

    def place(s: NDArray[np.float64]) -> NDArray[np.float64]:
        # For small turns between stations, Gauss-Legendre quadrature is exact up to rounding.
        total = (abs(first) + abs(last)) * length
        grid = np.linspace(0.0, length, 2 + int(total / STEP_TURN))
        stations = np.unique(np.concatenate([grid, s]))
        step = np.diff(stations)
        q = stations[:-1, None] + step[:, None] * NODES
        angle = first * q + rate * q * q / 2
        moves = [((f(angle) * WEIGHTS).sum(axis=1) * step) for f in (np.cos, np.sin)]
        xy = [np.concatenate([[0.0], np.cumsum(move)]) for move in moves]
        index = np.searchsorted(stations, s)
        return np.column_stack([xy[0][index], xy[1][index], first * s + rate * s * s / 2])

    return _cubic_pieces(start, length, place)


def polynomial_pieces(
    start: tuple[float, float, float], length: float, abcd: tuple[float, ...]
) -> list[Piece]:
    """Return a ``poly3`` (ASAM OpenDRIVE 1.4, 5.3.4.1.4), v over u, as cubics.

    Args:
        start: x, y, heading of its frame.
        length: its length along the curve, metres.
        abcd: coefficients of v.
    """
    a, b, c, d = abcd

    def speed(u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.hypot(1.0, b + u * (2 * c + 3 * d * u))

    # The curve is at least as long as u.
    grid = np.linspace(0.0, length, min(int(length / STEP_U_M) + 2, STEPS_U))
    step = np.diff(grid)
    cells = (speed(grid[:-1, None] + step[:, None] * NODES) * WEIGHTS).sum(axis=1) * step
    along = np.concatenate([[0.0], np.cumsum(cells)])

    def place(s: NDArray[np.float64]) -> NDArray[np.float64]:
        u = np.interp(s, along, grid)
        for _ in range(4):
            k = np.clip(np.searchsorted(grid, u, side="right") - 1, 0, len(grid) - 2)
            part = u - grid[k]
            inner = (speed(grid[k][:, None] + part[:, None] * NODES) * WEIGHTS).sum(axis=1) * part
            u = u - (along[k] + inner - s) / speed(u)
        v = a + u * (b + u * (c + u * d))
        return np.column_stack([u, v, np.arctan(b + u * (2 * c + 3 * d * u))])

    return _cubic_pieces(start, length, place)


def arc_length(u: Sequence[float], v: Sequence[float]) -> float:
    """Return the length of a parametric cubic over a parameter from 0 to 1, metres."""
    slope = NODES[:, None] ** np.arange(3) * [1, 2, 3]
    speed = np.hypot(slope @ np.asarray(u[1:]), slope @ np.asarray(v[1:]))
    return float(speed @ WEIGHTS)


def _cubic_pieces(
    start: tuple[float, float, float], length: float, place: _PointsAt
) -> list[Piece]:
    """Return as many cubics through positions and headings as the tolerance requires."""
    count = 1
    probe = np.linspace(0.0, 1.0, 9)
    powers = probe[:, None] ** np.arange(4)
    while True:
        knots = np.linspace(0.0, length, count + 1)
        reach = length / count
        x, y, heading = place(knots).T
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        dx, dy = np.diff(x), np.diff(y)
        du, dv = dx * c + dy * s, dy * c - dx * s
        turn = np.diff(heading)
        eu, ev = reach * np.cos(turn), reach * np.sin(turn)
        zero = np.zeros(count)
        u = np.column_stack([zero, zero + reach, 3 * du - 2 * reach - eu, reach + eu - 2 * du])
        v = np.column_stack([zero, zero, 3 * dv - ev, ev - 2 * dv])
        inner = place((knots[:-1, None] + reach * probe).ravel())
        pu, pv = (cubic @ powers.T for cubic in (u, v))
        px = x[:-1, None] + pu * c[:, None] - pv * s[:, None]
        py = y[:-1, None] + pu * s[:, None] + pv * c[:, None]
        gap = np.hypot(px.ravel() - inner[:, 0], py.ravel() - inner[:, 1])
        if gap.max() < TOLERANCE_M or reach < 1e-3:
            break
        count *= 2
    x0, y0, h0 = start
    c0, s0 = np.cos(h0), np.sin(h0)
    return [
        Piece(
            float(x0 + x[k] * c0 - y[k] * s0),
            float(y0 + x[k] * s0 + y[k] * c0),
            float(h0 + heading[k]),
            float(reach),
            u=tuple(map(float, u[k])),
            v=tuple(map(float, v[k])),
        )
        for k in range(count)
    ]


def read_heights(
    road: etree._Element, length: float, reach: tuple[float, float], spot: Spot
) -> tuple[Profile, Profile, Profile]:
    """Return elevation, superelevation and crown of a road.

    A crossfall (1.1 to 1.4) or a shape (1.4 on) becomes a crown, symmetric about the reference
    line, and its one-sided part is added to the superelevation. Other parts of a cross section (a
    gutter, a crown beside the reference line) are dropped and reported.

    Args:
        road: the ``<road>``.
        length: length of its reference line, metres.
        reach: extent of lanes to the left and to the right of the reference line, metres.
        spot: the road, for errors.
    """
    elevation = spot.profile(road.findall("elevationProfile/elevation"))
    bank = spot.profile(road.findall("lateralProfile/superelevation"))
    crown = Profile.constant(0.0)
    if np.abs(bank.at(np.linspace(0, length, 9))).max() > 1.0:
        spot.drop("has a superelevation of more than 1 radian")
        bank = Profile.constant(0.0)
    crossfall = road.findall("lateralProfile/crossfall")
    if crossfall:
        left, right = (
            spot.profile([e for e in crossfall if e.get("side", "both") in (side, "both")])
            for side in ("left", "right")
        )
        crown = added([(0.5, left), (0.5, right)], length)
        bank = added([(1.0, bank), (0.5, right), (-0.5, left)], length)
    shapes = road.findall("lateralProfile/shape")
    if shapes:
        lift, tilt, shape = _shape(shapes, reach, spot)
        elevation = added([(1.0, elevation), (1.0, lift)], length)
        bank = added([(1.0, bank), (1.0, tilt)], length)
        crown = added([(1.0, crown), (1.0, shape)], length)
    if road.find("lateralProfile/crossSectionSurface") is not None:
        spot.remark("cross section surfaces that are not read: such roads are flat across")
    return elevation, bank, crown


def _shape(
    shapes: Sequence[etree._Element], reach: tuple[float, float], spot: Spot
) -> tuple[Profile, Profile, Profile]:
    """Return height at the reference line, tilt to the left, and crown of cross sections."""
    by_station: dict[float, list[etree._Element]] = {}
    for item in shapes:
        by_station.setdefault(spot.number(item, "s"), []).append(item)
    stations = sorted(by_station)
    across = np.concatenate(
        [np.linspace(-max(reach[1], 0.5), 0, 8), np.linspace(0, max(reach[0], 0.5), 8)[1:]]
    )
    rows = []
    for s in stations:
        # Before its first record a cross section continues as that record.
        height = spot.profile(by_station[s], "t").at(across)
        middle = height[7]
        # Least squares over both sides: z = lift + tilt t - crown |t|.
        basis = np.column_stack([across, -np.abs(across)])
        tilt, crown = np.linalg.lstsq(basis, height - middle, rcond=None)[0]
        if np.abs(basis @ [tilt, crown] - (height - middle)).max() > SHAPE_M:
            spot.remark("cross sections more than 1 cm off a crown: the nearest crown is taken")
        rows.append((middle, tilt, crown))
    lift, tilt, crown = zip(*rows, strict=True)
    return stepped(stations, lift), stepped(stations, tilt), stepped(stations, crown)
