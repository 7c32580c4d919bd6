"""Consistency checks of two frames: place, frame of reference and kind of sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.alignment.ground_plane import ground_plane
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.plan_match import (
    Matches,
    PlanMotion,
    Standing,
    agreement,
    best_match,
    standing,
)
from urbantwin.fidelity.sensor_match import doubts_about_sensors
from urbantwin.geometry import wrapped

__all__ = ["doubts_about"]

Array = NDArray[np.float64]

#: Maximum number of points used, and the minimum required.
_MOST, _LEAST = 60_000, 200
#: Minimum extent of a frame, in any unit.
_LEAST_EXTENT = 1e-3
#: Length of a unit in metres -> name of the unit.
_UNITS = {
    0.3048: "feet",
    0.01: "centimetres",
    0.001: "millimetres",
    0.0254: "inches",
    1000.0: "kilometres",
}
#: Frames in one unit have extents whose ratio is below the first factor. A ratio matches a unit if
#: it is within the second factor of the ratio of the units.
_OTHER_UNIT, _LIKE = 15.0, 2.5
#: Only an axis whose extent is below this share of that of z can be vertical in place of z.
_FLAT = 0.7
#: Points used to find the ground, and the ground share above which z is accepted as vertical.
_OF_GROUND, _PLAINLY = 20_000, 0.45
#: Typical extent of a frame (75th percentile of distances to the median), metres.
_TYPICAL_M = 25.0
#: Frames agree without a motion if this share of the points above ground has a match.
_AGREES = 0.6
#: A motion is accepted if its correlation exceeds that of other headings by the first factor; it is
#: applied if the agreement improves by the second.
_STANDS_OUT, _BETTER = 1.35, 1.25
#: The same for rotations about the origin alone (a single wall fits in many places): factor of the
#: correlation, and the minimum agreement.
_STANDS_OUT_IN_PLACE = (1.1, 0.7)
#: Frames show different places if both have this many points above ground, the agreement is below
#: the second value and the correlation without a motion below the third.
_ENOUGH, _ELSEWHERE, _STRANGE = 800, 0.1, 0.5
#: Reported from: rotation (degrees), shift in plan and in height (metres), tilt (degrees).
_TURN_DEG, _SHIFT_M, _HEIGHT_M, _TILT_DEG = 1.5, 1.0, 0.5, 2.5
#: Vertical axis -> rotation (rows) that maps it to z; "-y" is a camera frame (x right, y down).
_UPRIGHT: dict[str, Array] = {
    "z": np.eye(3),
    "-y": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    "y": np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]),
    "-z": np.diag([1.0, -1, -1]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "-x": np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
}
#: Frames whose centres are farther apart have different frames of reference.
_APART_M = 150.0
#: Size of the cells in which ground heights are compared, metres, and their minimum number.
_CELL_M, _LEAST_CELLS = 2.0, 30
_ALIGN = "or run `urbantwin rig align` and record again"


def doubts_about(real: Frame, other: Frame) -> list[str]:
    """Return what looks wrong about comparing two frames, one sentence each.

    Detected are: another unit; a vertical axis other than z; a tilt; frames that are rotated,
    mirrored, shifted in plan or in height, or of different places; and different sensors
    (`sensor_match`). Places are recognised by points above the ground (`plan_match`): frames with
    few of them raise no doubts.
    """
    if min(len(real.points), len(other.points)) < _LEAST:
        return []
    mine, its = _Upright.of(real.points), _Upright.of(other.points)
    if min(_extent(mine.points), _extent(its.points)) < _LEAST_EXTENT:
        return []
    ratio = _extent(mine.points) / _extent(its.points)
    placed = _placed(mine, its)
    metres = None
    if not placed.found:
        for candidate in _units_like(ratio):
            scaled = replace(mine, points=mine.points * candidate)
            again = _placed(scaled, its)
            if again.found:
                metres, placed = candidate, again
                break
    if metres is None and not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        # Without points above the ground, the likely units cannot be distinguished.
        metres = next(iter(_units_like(ratio)), 0.0)
        return [_unit_said(metres, ratio)]
    said = [] if metres is None else [_unit_said(metres, ratio)]
    if mine.up != "z" or its.up != "z":
        return said + _axes_said(mine, its, placed)
    said += _place_said(placed)
    if placed.elsewhere:
        return said
    level = _level(placed)
    said += _level_said(level)
    if metres is None and level.tilt_deg < _TILT_DEG:
        here = _as_placed(real, placed, level)
        if real.ring is not None or not _is_far(placed, level):
            said += doubts_about_sensors(here, other)
    return said


@dataclass(frozen=True, eq=False)
class _Upright:
    """Points (N, 3) with z vertical, and the axis that was vertical in the frame."""

    points: Array
    up: str

    @classmethod
    def of(cls, points: Array) -> _Upright:
        """Return a subset of a frame's points; z stays vertical unless clearly contradicted."""
        if len(points) > _MOST:
            points = points[:: -(-len(points) // _MOST)]
        some = points[:: -(-len(points) // _OF_GROUND)]
        share = {"z": _ground_share(some)}
        if share["z"] < _PLAINLY:
            tall = np.ptp(np.percentile(some, [5, 95], axis=0), axis=0)
            for up, axes in _UPRIGHT.items():  # in a street the vertical extent is smallest
                if up == "-z" or tall["xyz".index(up[-1])] < _FLAT * tall[2]:
                    share[up] = _ground_share(some @ axes.T)
        best = max(share, key=lambda up: share[up])
        if share[best] < 1.5 * share["z"] + 0.1:
            best = "z"
        return cls(points @ _UPRIGHT[best].T, best)


def _ground_share(points: Array) -> float:
    """Return the share of the nearby cells that are ground if z is vertical: `ground_plane`.

    The points may be in any unit, with any origin.
    """
    level = (points - np.median(points, axis=0)) * (_TYPICAL_M / _extent(points))
    near = level[np.hypot(level[:, 0], level[:, 1]) < _TYPICAL_M / 2, 2]
    if not len(near):
        return 0.0
    plane = ground_plane(level - [0.0, 0.0, np.percentile(near, 1) + 3.0])
    return 0.0 if plane is None else plane.share


@dataclass(frozen=True, eq=False)
class _Placed:
    """Placement of one frame on another.

    Attributes:
        motion: moves the real frame onto the other in plan.
        found: the placement is unambiguous, or the frames agree without a motion.
        moves: the motion is significant.
        elsewhere: the frames show different places.
        mine: points above ground of the real frame, before the motion.
        its: points above ground of the other frame.
    """

    motion: PlanMotion
    found: bool
    moves: bool
    elsewhere: bool
    mine: Standing
    its: Standing


def _placed(mine: _Upright, its: _Upright) -> _Placed:
    one, other = standing(mine.points), standing(its.points)
    before = max(agreement(one, other))
    stays = _Placed(PlanMotion(), before >= _AGREES, False, False, one, other)
    if stays.found:
        return stays
    match = best_match(one, other)
    if match is None:
        return stays
    for candidate, strength, least in (
        (match.anywhere, _STANDS_OUT, 0.0),
        (match.in_place, *_STANDS_OUT_IN_PLACE),
    ):
        after = max(agreement(one.moved(candidate.motion), other))
        if candidate.strength < strength or after < least:
            continue
        moves = _is_another(candidate.motion, one.middle) and after > _BETTER * before
        motion = candidate.motion if moves else PlanMotion()
        return replace(stays, motion=motion, found=True, moves=moves)
    return replace(stays, elsewhere=_is_elsewhere(match, before, one, other))


def _is_another(motion: PlanMotion, middle: Array) -> bool:
    away = float(np.hypot(*(motion.apply(middle[None])[0] - middle)))
    turned = abs(np.degrees(motion.yaw)) > _TURN_DEG
    return motion.mirrored or turned or away > _SHIFT_M


def _is_elsewhere(match: Matches, before: float, one: Standing, other: Standing) -> bool:
    enough = min(len(one.points), len(other.points)) >= _ENOUGH
    return enough and before < _ELSEWHERE and match.as_it_is < _STRANGE


def _extent(points: Array) -> float:
    middle = np.median(points, axis=0)
    return max(float(np.percentile(np.linalg.norm(points - middle, axis=1), 75)), 1e-9)


def _units_like(ratio: float) -> list[float]:
    """Return the factors by which real points may be in another unit, likeliest first."""
    both = [metres for one in _UNITS for metres in (one, 1.0 / one)]
    near = [one for one in both if abs(np.log(ratio * one)) < np.log(_LIKE)]
    return sorted(near, key=lambda one: abs(np.log(ratio * one)))


def _unit_said(metres: float, ratio: float) -> str:
    extents = f"the real extent is {ratio:.3g} times the other's"
    if metres == 0.0:
        return f"One of the frames seems to be in another unit: {extents}."
    whose, factor = ("real", metres) if metres in _UNITS else ("other", 1.0 / metres)
    unit = next(name for one, name in _UNITS.items() if abs(one / factor - 1) < 1e-9)
    return (
        f"The {whose} frames look to be in {unit} ({extents}): multiply x, y and z of the {whose} "
        f"frames by {factor:g}."
    )


def _place_said(placed: _Placed) -> list[str]:
    x, y = placed.mine.middle - placed.its.middle
    if not placed.found and np.hypot(x, y) > _APART_M:
        return [
            f"The real frames lie {np.hypot(x, y):.0f} m away from the other ({x:.0f} m in x, "
            f"{y:.0f} m in y): in a frame of reference with another origin, or of another place."
        ]
    if placed.elsewhere:
        return [
            "The frames look to be of different places: nothing that stands in the one stands in "
            "the other, however they are turned and shifted (or the twin has little of what is "
            "there)."
        ]
    if not placed.moves:
        return []
    motion = placed.motion
    degrees = float(np.degrees(motion.yaw))
    if motion.mirrored:
        return [_mirror_said(degrees, motion)]
    if abs(degrees) <= _TURN_DEG:
        x, y = motion.apply(placed.mine.middle[None])[0] - placed.mine.middle
        return [
            f"The real frames look shifted by {-x:.1f} m in x and {-y:.1f} m in y: add {x:.1f} and "
            f"{y:.1f} m, {_ALIGN}."
        ]
    way = " clockwise" if degrees > 0 else " counter-clockwise"
    if abs(degrees) > 179.5:
        way, degrees = "", 180.0
    said = f"The real frames look rotated by {abs(degrees):.0f} degrees{way}"
    turn = f"turn them by {degrees:.0f} degrees about z"
    return [f"{said}: {turn}{_then_shift(placed)}, {_ALIGN}."]


def _mirror_said(degrees: float, motion: PlanMotion) -> str:
    nearest = round(degrees / 90) * 90 % 360
    what = {
        0: "(y turned round): multiply y by -1",
        180: "(x turned round): multiply x by -1",
        90: "(x and y exchanged): exchange them",
        270: "(x and y exchanged, with signs): take x = -y and y = -x",
    }[nearest]
    if abs(wrapped(degrees - nearest, 360.0)) > _TURN_DEG:
        what = f"and rotated: multiply y by -1, then turn by {degrees:.0f} degrees about z"
    return f"The real frames look mirrored {what}."


def _then_shift(placed: _Placed) -> str:
    """Return the text about the shift after a rotation; a far origin makes the shift uncertain."""
    x, y = placed.motion.shift
    if np.hypot(x, y) < _SHIFT_M + 0.02 * float(np.hypot(*placed.mine.middle)):
        return ""
    return f", then add {x:.1f} m to x and {y:.1f} m to y"


def _axes_said(mine: _Upright, its: _Upright, placed: _Placed) -> list[str]:
    said = []
    if mine.up != "z":
        axes = _UPRIGHT[mine.up]
        how = "exchange axes so that z is upward"
        if placed.found and its.up == "z":
            turn = np.eye(3)
            turn[:2, :2] = placed.motion.matrix
            left = np.degrees(placed.motion.yaw)
            nearest = np.round(turn @ axes)
            if abs(wrapped(float(left), 90.0)) < _TURN_DEG:
                how = f"take {_named(nearest)}"
            else:
                how = f"take {_named(axes)}, then turn by {left:.0f} degrees about z"
        like = " (as a camera's frame: x right, y down, z forward)" if mine.up == "-y" else ""
        said.append(
            f"The height of the real frames runs along {mine.up} and not along z{like}: {how}."
        )
    if its.up != "z":
        said.append(
            f"The height of the other frames runs along {its.up} and not along z: exchange axes "
            "so that z is upward."
        )
    return said


def _named(axes: Array) -> str:
    """Return a signed permutation of axes as "x = z, y = -x, z = -y"."""
    parts = []
    for name, row in zip("xyz", axes, strict=True):
        index = int(np.abs(row).argmax())
        parts.append(f"{name} = {'-' if row[index] < 0 else ''}{'xyz'[index]}")
    return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class _Level:
    """Difference of the grounds of two frames: tilt, and height at the origin in metres."""

    tilt_deg: float = 0.0
    height_m: float = 0.0


def _level(placed: _Placed) -> _Level:
    """Return the difference of the grounds, a plane fitted in L1 where both frames have ground."""
    mine, its = placed.mine.moved(placed.motion).ground, placed.its.ground
    theirs = {tuple(key): z for key, z in zip(_cells(its), its[:, 2], strict=True)}
    rows = [
        (x, y, z - theirs[key])
        for key, (x, y, z) in zip(map(tuple, _cells(mine)), mine, strict=True)
        if key in theirs
    ]
    if len(rows) < _LEAST_CELLS:
        return _Level()
    x, y, apart = np.array(rows).T
    x, y = x - placed.its.middle[0], y - placed.its.middle[1]
    design = np.column_stack([x, y, np.ones(len(x))])
    found = np.array([0.0, 0.0, np.median(apart)])
    for _ in range(20):
        weight = 1.0 / np.sqrt(np.maximum(np.abs(apart - design @ found), 0.02))
        found = np.linalg.lstsq(design * weight[:, None], apart * weight, rcond=None)[0]
    tilt = float(np.degrees(np.arctan(np.hypot(found[0], found[1]))))
    return _Level(tilt, float(found[2] if tilt > _TILT_DEG else np.median(apart)))


def _cells(ground: Array) -> NDArray[np.int64]:
    return np.floor(ground[:, :2] / _CELL_M).astype(np.int64)


def _level_said(level: _Level) -> list[str]:
    said = []
    if level.tilt_deg > _TILT_DEG:
        said.append(
            f"The real frames look tilted by {level.tilt_deg:.0f} degrees against the other: "
            "compare frames that are both level with gravity, or both the sensor's own (`frame:` "
            "in the rig)."
        )
    if abs(level.height_m) > _HEIGHT_M:
        way = "higher" if level.height_m > 0 else "lower"
        said.append(
            f"The ground lies {abs(level.height_m):.1f} m {way} in the real frames, which look "
            f"shifted in height: add {-level.height_m:.1f} m to z, {_ALIGN}."
        )
    return said


def _is_far(placed: _Placed, level: _Level) -> bool:
    """Return whether the real frame is shifted, which leaves its sensor's position unknown."""
    return float(np.hypot(*placed.motion.shift)) > _SHIFT_M or abs(level.height_m) > _HEIGHT_M


def _as_placed(real: Frame, placed: _Placed, level: _Level) -> Frame:
    """Return the real frame after its placement, with its sensor if that is known."""

    def moved(points: Array) -> Array:
        plan = placed.motion.apply(points[:, :2])
        return np.column_stack([plan, points[:, 2] - level.height_m])

    places = real.sensor_places
    if real.ring is not None or places.any():
        places = moved(places)
    return replace(real, points=moved(real.points), sensor_places=places)
