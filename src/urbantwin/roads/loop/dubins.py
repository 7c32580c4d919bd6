"""Dubins paths with a bus's turning radius: the shortest paths between two poses.

They consist of arcs of one radius and at most one line (L. E. Dubins, "On curves of minimal length
with a constraint on average curvature", American Journal of Mathematics 79, 1957). Between the two
directions of a street such a path is a turnaround loop.
"""

from __future__ import annotations

import math

from urbantwin.roads.model import Curve, Piece

__all__ = ["BUS_RADIUS_M", "Pose2", "dubins_path"]

#: x, y in metres and heading in radians.
Pose2 = tuple[float, float, float]

#: Minimum radius of a lane's centre line on a turnaround: a 12 m bus turns about an inner radius of
#: 5.3 m (Directive 97/27/EC, annex I, 7.6.1), with its lane's centre at about 7 m.
BUS_RADIUS_M = 7.0
#: Path types by the side of their largest turn: +1 turns left, -1 right, 0 is straight.
_PATH_TYPES = {
    "left": ((1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 1, -1)),
    "right": ((-1, 0, -1), (1, 0, -1), (-1, 0, 1), (1, -1, 1)),
}
_LEAST_M = 1e-6  # Shorter pieces are left out.


def dubins_path(
    start: Pose2, end: Pose2, *, radius: float = BUS_RADIUS_M, turn: str | None = None
) -> Curve:
    """Return the shortest curve of lines and arcs between two poses.

    Args:
        start: x, y, heading of the start, site frame.
        end: the same of the end.
        radius: radius of all arcs, metres.
        turn: ``left`` or ``right``, the side of the turnaround; ``None`` for the shorter one. In
            right-hand traffic it is the left.

    Raises:
        ValueError: the radius is not positive, or the poses are the same.
    """
    if radius <= 0:
        raise ValueError(f"the radius is {radius:g} m")
    dx, dy = (end[0] - start[0]) / radius, (end[1] - start[1]) / radius
    distance, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
    a, b = start[2] - bearing, end[2] - bearing
    words = _PATH_TYPES[turn] if turn else (*_PATH_TYPES["left"], *_PATH_TYPES["right"])
    paths = [(sum(legs), word, legs) for word in words if (legs := _legs(word, a, b, distance))]
    length, word, legs = min(paths)
    if length * radius < _LEAST_M:
        raise ValueError("a path from a pose to itself")
    pieces: list[Piece] = []
    x, y, heading = start
    for side, leg in zip(word, legs, strict=True):
        if leg * radius < _LEAST_M:
            continue
        piece = Piece(x, y, heading, leg * radius, side / radius)
        pieces.append(piece)
        x, y, heading = piece.at(piece.length)
    return Curve(tuple(pieces))


def _legs(
    word: tuple[int, int, int], a: float, b: float, d: float
) -> tuple[float, float, float] | None:
    """Return the lengths of a path type's three pieces for radius 1; ``None`` if impossible.

    Start at the origin with heading ``a``, end at (d, 0) with heading ``b``.
    """
    first, middle, last = word
    # Centres of the first and last circle; that of a left turn lies 90 degrees to the left.
    cx, cy = -first * math.sin(a), first * math.cos(a)
    ex, ey = d - last * math.sin(b), last * math.cos(b)
    gap, course = math.hypot(ex - cx, ey - cy), math.atan2(ey - cy, ex - cx)
    if middle:
        if gap > 4.0:
            return None
        # The three circles touch: their centres form a triangle with sides 2, 2 and gap.
        angle = math.acos(gap / 4.0)
        # Heading where the circles touch: perpendicular to the line between their centres.
        touch = course + first * angle + first * math.pi / 2
        turn_first = _turned(touch - a, first)
        turn_middle = math.pi + 2 * angle
        turn_last = _turned(b - touch - middle * turn_middle, last)
        return turn_first, turn_middle, turn_last
    if first == last:
        heading, straight = course, gap
    else:
        if gap < 2.0:
            return None
        straight = math.sqrt(gap * gap - 4.0)
        heading = course + first * math.atan2(2.0, straight)
    return _turned(heading - a, first), straight, _turned(b - heading, last)


def _turned(angle: float, side: int) -> float:
    """Return the angle of a turn to one side for a change of heading, 0 to 2 pi."""
    turn = (side * angle) % (2 * math.pi)
    return 0.0 if 2 * math.pi - turn < 1e-9 else turn
