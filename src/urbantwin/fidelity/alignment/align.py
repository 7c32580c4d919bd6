"""Estimation of a sensor's pose in the twin from one real frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.frame_features import FrameFeatures
from urbantwin.fidelity.alignment.ground_plane import GroundPlane, ground_plane, leveling
from urbantwin.fidelity.alignment.pose_belief import Belief, beliefs
from urbantwin.fidelity.alignment.pose_search import Found, PoseSearch
from urbantwin.fidelity.alignment.registration import Registered, registered
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.fidelity.alignment.search_span import SearchSpan
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials, wrapped, ypr_from_rotation
from urbantwin.progress import Progress, untold

__all__ = ["Alignment", "Guess", "align"]


#: Maximum distance of points from the sensor, metres.
_REACH_M = 50.0
#: Cell size with one point each for the final registration, and for comparing candidates, metres.
_THINNED_M, _SPARSE_M = 0.4, 0.7
_LEAST_POINTS = 200
#: The pose is ambiguous if another place has more than this share of the best one's probability, or
#: if the root of p d^2 exceeds this distance (metres), for a place of share p at a distance d.
_AMBIGUOUS, _MOST_ELSEWHERE_M = 0.1, 0.75
#: Maximum standard deviations of a valid pose, metres and degrees.
_MOST_SIGMA_M, _MOST_SIGMA_DEG = 0.5, 2.0
#: Log likelihood ratio against chance below which a frame may fit by chance: the second value, as
#: some hundred distinct places are tested. In a narrow span with n distinct poses, log n plus the
#: first value suffices.
_LEAST_BEYOND_CHANCE, _LEAST_EVIDENCE = 2.0, 8.0
#: Maximum excess of a pose over the bounds of the guess, in standard deviations.
_BEYOND = 2.0
_CANDIDATES = 6
#: Margins beyond the span, metres and radians, in which a place ten times as likely as the best
#: within is reported: the guess is wrong then.
_JUST_BEYOND_M, _JUST_BEYOND_RAD = 1.5, np.radians(5.0)
#: Differences up to which two poses are the same, metres and degrees.
_SAME_M, _SAME_DEG = 0.5, 3.0
#: With fewer curbs and fewer points above the ground, only ground heights would constrain the
#: position, and they fit somewhere for any frame.
_FEWEST_CURBS, _FEWEST_RAISED = 4, 50
_HOLDING = "a twin with walls, curbs or three posts that the sensor sees"


@dataclass(frozen=True)
class Guess:
    """An initial guess of the pose of a frame.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        yaw_deg: heading of the frame's x axis, counter-clockwise from east.
        within_m: maximum error of the position, east and north.
        within_deg: maximum error of the heading.
    """

    east_m: float
    north_m: float
    yaw_deg: float
    within_m: float = 3.0
    within_deg: float = 15.0


@dataclass(frozen=True, eq=False)
class Alignment:
    """The pose of a frame in the twin, and its uncertainty.

    Attributes:
        pose: ``site_SE3_frame``: transforms the frame's points to the site.
        found: the registration: residual, standard deviations.
        second: probability of the next best place relative to the best; 0 if there is none.
        plane: the ground in the frame.
        evidence: log likelihood ratio of the pose against chance.
        start: start of the search; None for an unrestricted one.
        frames: number of frames of which the pose is the mean.
        scatter_m: root mean square scatter of the positions of these frames.
        left_out: number of frames that were not aligned.
    """

    pose: Pose
    found: Registered
    second: float
    plane: GroundPlane
    evidence: float
    start: Pose | None = None
    frames: int = 1
    scatter_m: float = 0.0
    left_out: int = 0

    @property
    def confidence(self) -> float:
        """1 minus the probability of the next best place relative to the best."""
        return 1.0 - self.second

    def report(self) -> dict[str, Any]:
        """Return all values for JSON."""
        yaw, pitch, roll = np.degrees(ypr_from_rotation(self.pose.rotation))
        east, north, up = self.pose.translation
        return {
            "east_m": round(float(east), 4),
            "north_m": round(float(north), 4),
            "up_m": round(float(up), 4),
            "yaw_deg": round(float(yaw), 4),
            "pitch_deg": round(float(pitch), 4),
            "roll_deg": round(float(roll), 4),
            "residual_m": round(self.found.residual_m, 4),
            "sigma_m": [round(float(one), 4) for one in self.found.sigma_m],
            "sigma_yaw_deg": round(float(self.found.sigma_deg[2]), 4),
            "explained_share": round(self.found.explained, 4),
            "curbs_explained": round(self.found.curbs_explained, 4),
            "marks_explained": round(self.found.marks_explained, 4),
            "posts": self.found.posts,
            "confidence": round(self.confidence, 4),
            "evidence": round(self.evidence, 1),
            "surface_offset_m": round(self.found.surface_offset_m, 4),
            "edge_offset_m": round(self.found.edge_offset_m, 4),
            "points": self.found.points,
            "frames": self.frames,
            "frames_left_out": self.left_out,
            "frames_scatter_m": round(self.scatter_m, 4),
            "height_above_ground_m": round(self.plane.height_m, 3),
        }


def align(
    frame: Frame,
    mesh: LabelledMesh,
    *,
    guess: Guess | None = None,
    region: shapely.Polygon | None = None,
    surface: SurfaceMaterials | None = None,
    seed: int = 0,
    file: str | None = None,
    progress: Progress | None = None,
) -> Alignment:
    """Find the pose of a real frame in the twin.

    1. The ground plane of the frame gives the sensor's height above it, pitch and roll.
    2. Positions and headings are tested at that height above the twin's ground; the points must lie
      on the scene's surfaces (a distance field).
    3. The best few are registered to the surfaces visible from there; the pose with the highest
      likelihood is chosen (`pose_belief`).

    Points on labelled objects are left out, as objects move.

    Args:
        frame: one real frame, z roughly up.
        mesh: the static world, site frame.
        guess: approximate pose; without it the whole region is searched, with any heading.
        region: possible positions without a guess, site frame.
        surface: paint on the twin's roads.
        seed: seed of the tested ground planes.
        file: source of the frame, for errors.
        progress: called with the fraction done (0..1) and the current step.

    Raises:
        InputError: no ground in the frame or in the twin at the guess; nothing that constrains the
            position (as on a bare plane); or another pose is similarly likely.
    """
    tell = progress or untold
    moving = frame.foreground(margin=0.1)
    sensor = frame.sensor_places.mean(axis=0)
    away = frame.points - sensor
    kept = np.hypot(away[:, 0], away[:, 1]) < _REACH_M
    kept &= np.ones(len(away), bool) if moving is None else ~moving
    points = away[kept]
    if len(points) < _LEAST_POINTS:
        raise InputError(
            f"has {len(points)} points within {_REACH_M:g} m that belong to no object",
            file=file,
            expected=f"at least {_LEAST_POINTS}",
        )
    tell(0.0, "finding the ground")
    plane = ground_plane(points, seed)
    if plane is None:
        raise InputError(
            "shows no ground below the sensor",
            file=file,
            expected="metres, z roughly upward, and part of a street in view",
        )
    features = FrameFeatures.of(frame.only(kept), sensor, plane)
    if len(features.curbs) < _FEWEST_CURBS and features.raised.sum() < _FEWEST_RAISED:
        raise InputError(
            "shows nothing but ground",
            file=file,
            expected="a frame of this site in which walls, poles or curbs of the twin are seen",
        )
    span = _span(guess, region, mesh, sensor)
    tell(0.1, "reading the scene")
    scene = ScenePoints(mesh, span.middle, span.reach_m + _REACH_M, surface)
    if not len(scene.points):
        raise _no_ground(guess, file)
    tell(0.3, "searching the place")
    search = PoseSearch(scene, features, plane, span)
    candidates = search.run(span, _CANDIDATES)
    if not candidates:
        raise _no_ground(guess, file)
    tell(0.6, "registering")
    told = _told(scene, features.thinned(_SPARSE_M), search, candidates, span)
    tell(0.8, "registering")
    found = registered(scene, features.thinned(_THINNED_M), told[0][1]) if told else None
    held = guess is not None or (found is not None and span.holds(*_stance(found.pose, plane)))
    if found is None or not held:
        raise InputError(
            "does not fit the twin anywhere there",
            file=file,
            expected="a frame of this site, or another guess, or a wider span around it",
        )
    likely = told[0][0]
    found = replace(
        found,
        sigma_m=np.hypot(found.sigma_m, [*likely.sigma_m, 0.0]),
        sigma_deg=np.hypot(found.sigma_deg, [0.0, 0.0, np.degrees(likely.sigma_rad)]),
    )
    _certain(found, likely, span, file)
    pose = _bounded(_of_frame(found.pose, sensor), found, plane, guess, file)
    others = _elsewhere(found.pose, told, sensor, guess)
    _told_apart(found.pose, others, sensor, file)
    share = others[0][0] if others else 0.0
    if guess is not None:
        rough = features.thinned(_SPARSE_M)
        _not_just_beyond(
            found.pose, _just_beyond(scene, rough, search, found.pose, span), guess, file
        )
    start = None if guess is None else _of_frame(search.standing(span.middle, span.yaw), sensor)
    if start is not None and not np.isfinite(start.translation).all():
        start = None
    return Alignment(pose, replace(found, pose=pose), share, plane, likely.evidence, start)


def _certain(found: Registered, likely: Belief, span: SearchSpan, file: str | None) -> None:
    """Raise an error if a pose is undetermined, or may fit by chance."""
    if found.sigma_m.max() > _MOST_SIGMA_M or found.sigma_deg.max() > _MOST_SIGMA_DEG:
        raise InputError(
            f"determines the pose to no better than {found.sigma_m.max():.2f} m and "
            f"{found.sigma_deg.max():.1f} degrees (standard deviation; posts that the twin has "
            f"too: {found.posts})",
            file=file,
            expected=_HOLDING,
        )
    least = least_evidence(span)
    if likely.evidence < least:
        raise InputError(
            f"shows too little that the twin has too (evidence {likely.evidence:.1f} of "
            f"{least:.1f}; posts: {found.posts})",
            file=file,
            expected=_HOLDING,
        )


def least_evidence(span: SearchSpan) -> float:
    """Return the minimum log likelihood ratio against chance of a pose in a span."""
    differing = (2.0 * span.reach_m / _SAME_M + 1.0) ** 2
    differing *= 2.0 * np.degrees(span.reach_rad) / _SAME_DEG + 1.0
    return min(_LEAST_EVIDENCE, float(np.log(differing)) + _LEAST_BEYOND_CHANCE)


def _elsewhere(
    pose: Pose,
    told: list[tuple[Belief, Pose]],
    sensor: NDArray[np.float64],
    guess: Guess | None,
) -> list[tuple[float, Pose]]:
    """Return the relative probabilities and poses of the other places.

    Places that the guess excludes are dropped: the search includes some, as sensors stand beside
    the origin of the frame for which the guess is.
    """
    return [
        (belief.share / max(told[0][0].share, 1e-9), other)
        for belief, other in told[1:]
        if not _same(pose, other) and _off(_of_frame(other, sensor), guess) <= 0
    ]


def _told_apart(
    pose: Pose, others: list[tuple[float, Pose]], sensor: NDArray[np.float64], file: str | None
) -> None:
    """Raise an error if another pose is similarly likely."""
    for share, other in others:
        apart = float(np.hypot(*(other.translation - pose.translation)[:2]))
        if share <= _AMBIGUOUS and np.sqrt(share) * apart <= _MOST_ELSEWHERE_M:
            continue
        places = [_of_frame(one, sensor).translation for one in (pose, other)]
        there = " and ".join(f"{east:.2f} m E, {north:.2f} m N" for east, north, _ in places)
        raise InputError(
            f"fits two places {apart:.1f} m apart ({there}; the second is "
            f"{share:.0%} as likely as the first)",
            file=file,
            expected="a guess nearer to the right one",
        )


def _just_beyond(
    scene: ScenePoints,
    features: FrameFeatures,
    search: PoseSearch,
    found: Pose,
    span: SearchSpan,
) -> Pose | None:
    """Return the likeliest pose just beyond a span, if it is ten times as likely as the one within.

    Poses beyond the span cause no ambiguity. But where streets repeat and the guess excludes the
    right place, another one fits well, too.
    """
    reach_rad = min(span.reach_rad + _JUST_BEYOND_RAD, np.pi)
    wide = SearchSpan(span.middle, span.reach_m + _JUST_BEYOND_M, span.yaw, reach_rad)
    outside = [found]
    for one in search.run(wide, 2 * _CANDIDATES):
        if span.holds(one.pose.translation[:2], one.yaw):
            continue
        moved = registered(scene, features, one.pose, rough=True)
        pose = one.pose if moved is None else moved.pose
        inside = span.holds(*_stance(pose, search.plane))
        if not inside and not any(_same(pose, other) for other in outside):
            outside.append(pose)
    places = [_stance(pose, search.plane) for pose in outside]
    shares = [one.share for one in beliefs(search, places, wide)]
    best = int(np.argmax(shares))
    return outside[best] if shares[0] < _AMBIGUOUS * shares[best] else None


def _not_just_beyond(pose: Pose, other: Pose | None, guess: Guess, file: str | None) -> None:
    """Raise an error if a much likelier pose lies just beyond the span."""
    if other is None:
        return
    apart = float(np.hypot(*(other.translation - pose.translation)[:2]))
    raise InputError(
        f"fits best just beyond the guess, {apart:.1f} m from where it fits within",
        file=file,
        expected=f"up to {guess.within_m:g} m and {guess.within_deg:g} degrees from the guess, "
        "or a wider span",
    )


def _bounded(
    pose: Pose, found: Registered, plane: GroundPlane, guess: Guess | None, file: str | None
) -> Pose:
    """Return the pose of the points' frame within the bounds of a guess, or raise an error.

    If the truth lies at a bound, half of all estimates are beyond. They are moved onto the bound,
    up to two standard deviations; farther off, the guess or the place is wrong.
    """
    if guess is None:
        return pose
    away = pose.translation[:2] - [guess.east_m, guess.north_m]
    turned = wrapped(float(np.degrees(_stance(pose, plane)[1])) - guess.yaw_deg, 360.0)
    back = np.clip(away, -guess.within_m, guess.within_m) - away
    turn = float(np.clip(turned, -guess.within_deg, guess.within_deg)) - turned
    beyond = np.abs(back) > _BEYOND * found.sigma_m[:2]
    if beyond.any() or abs(turn) > _BEYOND * found.sigma_deg[2]:
        raise InputError(
            f"fits best {np.abs(away).max():.2f} m and {abs(turned):.1f} degrees from the guess",
            file=file,
            expected=f"up to {guess.within_m:g} m and {guess.within_deg:g} degrees, "
            "or a wider span",
        )
    turn_back = Pose.from_ypr(np.zeros(3), np.radians(turn)).rotation
    return Pose(turn_back @ pose.rotation, pose.translation + [*back, 0.0])


def _off(pose: Pose, guess: Guess | None) -> float:
    """Return how far the pose of the points' frame is beyond a guess, metres."""
    if guess is None:
        return -np.inf
    away = np.abs(pose.translation[:2] - [guess.east_m, guess.north_m]).max()
    return float(away - guess.within_m)


def _of_frame(pose: Pose, sensor: NDArray[np.float64]) -> Pose:
    """Return the pose of the points' frame from that of the centre of its sensors."""
    return Pose(pose.rotation, pose.apply(-sensor[None])[0])


def _told(
    scene: ScenePoints,
    features: FrameFeatures,
    search: PoseSearch,
    candidates: list[Found],
    span: SearchSpan,
) -> list[tuple[Belief, Pose]]:
    """Register the candidates; return their beliefs and poses, the likeliest first."""
    poses: list[Pose] = []
    for one in candidates:
        found = registered(scene, features, one.pose, rough=True)
        held = found is not None and span.holds(*_stance(found.pose, search.plane))
        pose = found.pose if found is not None and held else one.pose
        if not any(_same(pose, other) for other in poses):
            poses.append(pose)
    places = [_stance(pose, search.plane) for pose in poses]
    told = list(zip(beliefs(search, places, span), poses, strict=True))
    told.sort(key=lambda pair: -pair[0].share)
    return [pair for pair in told if pair[0].share > 0]


def _same(one: Pose, other: Pose) -> bool:
    """Return whether two poses are the same."""
    turned = one.rotation.T @ other.rotation
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    apart = np.linalg.norm(one.translation - other.translation)
    return bool(apart <= _SAME_M and angle <= _SAME_DEG)


def _stance(pose: Pose, plane: GroundPlane) -> tuple[NDArray[np.float64], float]:
    """Return the position (2,) and the heading, radians, of a pose."""
    ahead = pose.rotation @ leveling(plane.normal).T[:, 0]
    return pose.translation[:2], float(np.arctan2(ahead[1], ahead[0]))


def _span(
    guess: Guess | None,
    region: shapely.Polygon | None,
    mesh: LabelledMesh,
    sensor: NDArray[np.float64],
) -> SearchSpan:
    """Return the search span of the centre of the sensors; a guess is of the points' frame."""
    if guess is not None:
        yaw, turn = np.radians(guess.yaw_deg), np.radians(guess.within_deg)
        ahead = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        middle = np.array([guess.east_m, guess.north_m]) + ahead @ sensor[:2]
        beside = float(np.hypot(*sensor[:2])) * min(turn, 2.0)
        return SearchSpan(middle, guess.within_m + beside, yaw, turn)
    if region is None:
        low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    else:
        low, high = np.array(region.bounds).reshape(2, 2)
    return SearchSpan((low + high) / 2, float((high - low).max() / 2), 0.0, np.pi)


def _no_ground(guess: Guess | None, file: str | None) -> InputError:
    where = "in the region" if guess is None else f"at {guess.east_m:g} m E, {guess.north_m:g} m N"
    return InputError(
        f"the twin has no ground {where} to stand the sensor on",
        file=file,
        expected="a guess on the twin's ground",
    )
