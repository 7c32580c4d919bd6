"""Estimating the pose of a sensor in the twin from one real frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment.frame_features import FrameFeatures
from urbantwin.fidelity.alignment.ground_plane import GroundPlane, ground_plane
from urbantwin.fidelity.alignment.pose_search import Found, PoseSearch, SearchSpan
from urbantwin.fidelity.alignment.registration import Registered, registered
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials, ypr_from_rotation
from urbantwin.progress import Progress, untold

__all__ = ["Alignment", "Guess", "align"]


#: Points farther from the sensor than this are left out, metres.
_REACH_M = 50.0
#: The points that decide, and those that only tell candidates apart: one per cell, metres.
_THINNED_M, _SPARSE_M = 0.4, 0.7
_LEAST_POINTS = 200
#: A second place that explains as much as this share of the first makes it a guess.
AMBIGUOUS = 0.9
#: A place less certain than this is not found, metres and degrees (standard deviations).
_MOST_SIGMA_M, _MOST_SIGMA_DEG = 0.5, 2.0
_CANDIDATES = 4
#: With fewer curbs and fewer points off the ground explained, only heights of the ground would
#: hold the place, and they fit somewhere whatever the frame shows.
_FEWEST_CURBS, _FEWEST_RAISED = 4, 50


@dataclass(frozen=True)
class Guess:
    """An initial guess of where the sensor is.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        yaw_deg: heading of the frame's x axis, counter-clockwise from east.
        within_m: how far off the place may be, east and north.
        within_deg: how far off the heading may be.
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
        pose: ``site_SE3_frame``: takes the frame's points to the site.
        found: the registration: residual, standard deviations.
        second: what the next best place explains as a share of the best; 0 where there is none.
        plane: the ground in the frame.
        score: of the search, 0 to 1.
        start: where the search began; None where it was anywhere.
        frames: how many frames the pose is the mean of.
        scatter_m: of these frames' places (root mean square).
        left_out: frames that were not found.
    """

    pose: Pose
    found: Registered
    second: float
    plane: GroundPlane
    score: float
    start: Pose | None = None
    frames: int = 1
    scatter_m: float = 0.0
    left_out: int = 0

    @property
    def confidence(self) -> float:
        """1 less what the next best place explains as a share of the best."""
        return 1.0 - self.second

    def report(self) -> dict[str, Any]:
        """Return everything as JSON holds it."""
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
            "confidence": round(self.confidence, 4),
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
    """Find where in the twin a real frame was measured.

    1. The ground plane of the frame gives the sensor's height above it, pitch and roll.
    2. Places and headings are tried in which the sensor stands on the twin's ground as it does on
       its own; the points must lie on the scene's surfaces (a field of distances).
    3. The best few are registered to the surfaces that can be seen from there; the one that
       explains most points wins.

    Points that labels give to objects are left out: objects move, the twin does not.

    Args:
        frame: one real frame, z roughly upward.
        mesh: the static world, site frame.
        guess: roughly where it is; else the whole region is searched, with any heading.
        region: where it can be, site frame, if there is no guess.
        surface: paint on the twin's roads.
        seed: of the ground planes that are tried.
        file: where the frame is from, for errors.
        progress: called with the fraction done (0..1) and what is being done.

    Raises:
        InputError: no ground in the frame, or at the guess in the twin; nothing that holds the
            place (a bare plane looks alike everywhere); or two places that are nearly as good.
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
    span = _span(guess, region, mesh)
    tell(0.1, "reading the scene")
    scene = ScenePoints(mesh, span.middle, span.reach_m + _REACH_M, surface)
    if not len(scene.points):
        raise _no_ground(guess, file)
    tell(0.3, "searching the place")
    search = PoseSearch(scene, features, plane)
    candidates = search.run(span, _CANDIDATES)
    if not candidates:
        raise _no_ground(guess, file)
    tell(0.6, "registering")
    best, second = _best(scene, features.thinned(_SPARSE_M), candidates)
    tell(0.8, "registering")
    found = None if best is None else registered(scene, features.thinned(_THINNED_M), best[1].pose)
    if best is None or found is None:
        raise InputError(
            "does not fit the twin anywhere there",
            file=file,
            expected="a frame of this site, or another guess",
        )
    if found.sigma_m.max() > _MOST_SIGMA_M or found.sigma_deg.max() > _MOST_SIGMA_DEG:
        raise InputError(
            f"determines the pose to no better than {found.sigma_m.max():.2f} m and "
            f"{found.sigma_deg.max():.1f} degrees (standard deviation)",
            file=file,
            expected="a twin with walls, poles or curbs that the sensor sees",
        )
    curbs = found.curbs_explained * len(features.curbs)
    raised = found.explained * features.thinned(_THINNED_M).raised.sum()
    if curbs < _FEWEST_CURBS and raised < _FEWEST_RAISED:
        raise InputError(
            f"shows nothing of the twin but ground ({curbs:.0f} curbs, {raised:.0f} other points)",
            file=file,
            expected="a frame of this site in which walls, poles or curbs of the twin are seen",
        )
    if second is not None and second[1].support > AMBIGUOUS * best[1].support:
        apart = np.hypot(*(second[1].pose.translation - found.pose.translation)[:2])
        raise InputError(
            f"fits two places {apart:.1f} m apart nearly as well "
            f"({second[1].support / best[1].support:.0%} of what the better one explains)",
            file=file,
            expected="a guess nearer to the right one",
        )
    share = 0.0 if second is None else second[1].support / max(best[1].support, 1e-9)
    pose = _of_frame(found.pose, sensor)
    start = None if guess is None else _of_frame(search.standing(span.middle, span.yaw), sensor)
    if start is not None and not np.isfinite(start.translation).all():
        start = None
    return Alignment(pose, replace(found, pose=pose), share, plane, best[0].score, start)


def _of_frame(pose: Pose, sensor: NDArray[np.float64]) -> Pose:
    """Return the pose of the points' frame by that of the middle of its sensors."""
    return Pose(pose.rotation, pose.apply(-sensor[None])[0])


def _best(
    scene: ScenePoints, features: FrameFeatures, candidates: list[Found]
) -> tuple[tuple[Found, Registered] | None, tuple[Found, Registered] | None]:
    """Register the candidates; return the best, and the best that is another place."""
    done = [(one, registered(scene, features, one.pose, rough=True)) for one in candidates]
    fits = [(one, found) for one, found in done if found is not None]
    if not fits:
        return None, None
    fits.sort(key=lambda pair: -pair[1].support)
    first = fits[0]
    for other in fits[1:]:
        apart = np.linalg.norm(other[1].pose.translation - first[1].pose.translation)
        turned = other[1].pose.rotation.T @ first[1].pose.rotation
        angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
        if apart > 0.5 or angle > 3.0:
            return first, other
    return first, None


def _span(guess: Guess | None, region: shapely.Polygon | None, mesh: LabelledMesh) -> SearchSpan:
    if guess is not None:
        middle = np.array([guess.east_m, guess.north_m])
        return SearchSpan(
            middle, guess.within_m, np.radians(guess.yaw_deg), np.radians(guess.within_deg)
        )
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
