"""Association of detections to tracks, frame by frame, by likelihood.

Like S. Weng et al., "3D Multi-Object Tracking: A Baseline and New Evaluation Metrics", IROS 2020,
but with likelihoods instead of overlaps, so that frames may be far apart. Detections with low
scores continue confirmed tracks, but begin none (Y. Zhang et al., "ByteTrack: Multi-Object Tracking
by Associating Every Detection Box", ECCV 2022). Tracks are confirmed by the probability accumulated
from scores (N. Benbarka, J. Schröder, A. Zell, "Score refinement for confidence-based 3D
multi-object tracking", IROS 2021).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from urbantwin.detections import Detections
from urbantwin.tracking.kalman import SEEN, STATE, begun, corrected, innovation, measured, predicted
from urbantwin.tracking.road_user import RoadUser

__all__ = ["Linking", "linked"]

#: Squared Mahalanobis distance of the gate: five standard deviations.
_GATE = 25.0
#: Maximum total cost of a pair: position, axis, size, class, and uncertainty.
_MAX_COST = 32.0
#: Standard deviation of detected sizes, logarithm of length and width; cost of another class.
_SIZE_SIGMA, _CLASS_COST = 0.25, 4.0
#: Factor on a detection's score as probability of an object.
_SCORE_FACTOR = 0.75
#: Time constant of the decay of the probability without detections, seconds.
_FORGETTING_TIME_S = 0.7
#: Probability from which a track is confirmed; maximum gap of unconfirmed tracks, seconds.
_CONFIRMED_PROBABILITY, _MAX_UNCONFIRMED_GAP_S = 0.9, 0.35
#: Distance that every object may jump, metres: errors of both detections.
_DETECTION_ERROR_M = 1.5

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Linking:
    """Parameters of the association.

    Attributes:
        birth: least score of a detection that begins a track.
        lowest: least score of a detection that is used at all.
        gap_s: maximum time without detections, seconds.
    """

    birth: float = 0.3
    lowest: float = 0.1
    gap_s: float = 2.0


class _LiveTracks:
    """Active tracks of one group, a row each."""

    def __init__(self, user: RoadUser) -> None:
        self.user = user
        self.state = np.zeros((0, STATE))
        self.covariance = np.zeros((0, STATE, STATE))
        self.size = np.zeros((0, 3))
        self.last_s = np.zeros(0)
        self.last_xy = np.zeros((0, 2))
        self.belief = np.zeros(0)
        self.sure = np.zeros(0, np.bool_)
        self.kind = np.zeros(0, np.int64)
        self.number = np.zeros(0, np.int64)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep the selected tracks."""
        for name, values in vars(self).items():
            if name != "user":
                setattr(self, name, values[kept])

    def predict(self, seconds: float) -> None:
        """Predict to the next frame."""
        if len(self.number):
            later = np.full(len(self.number), seconds)
            self.state, self.covariance, _ = predicted(
                self.state, self.covariance, later, self.user
            )

    def begin(
        self, seen: Floats, size: Floats, score: Floats, kind: Rows, time_s: float, first: int
    ) -> None:
        """Add a track for each detection."""
        state, covariance = begun(seen, self.user)
        belief = _SCORE_FACTOR * score
        self.state = np.concatenate([self.state, state])
        self.covariance = np.concatenate([self.covariance, covariance])
        self.size = np.concatenate([self.size, size])
        self.last_s = np.concatenate([self.last_s, np.full(len(seen), time_s)])
        self.last_xy = np.concatenate([self.last_xy, seen[:, :2]])
        self.belief = np.concatenate([self.belief, belief])
        self.sure = np.concatenate([self.sure, belief >= _CONFIRMED_PROBABILITY])
        self.kind = np.concatenate([self.kind, kind])
        self.number = np.concatenate([self.number, first + np.arange(len(seen), dtype=np.int64)])

    def go_on(
        self, mine: Rows, seen: Floats, size: Floats, score: Floats, kind: Rows, time_s: float
    ) -> None:
        """Update each of some tracks by a detection."""
        self.state[mine], self.covariance[mine] = corrected(
            self.state[mine], self.covariance[mine], seen, self.user
        )
        self.size[mine] += 0.3 * (size - self.size[mine])
        self.last_s[mine], self.last_xy[mine] = time_s, seen[:, :2]
        self.belief[mine] = 1.0 - (1.0 - self.belief[mine]) * (1.0 - _SCORE_FACTOR * score)
        self.sure[mine] |= self.belief[mine] >= _CONFIRMED_PROBABILITY
        self.kind[mine] = np.where(score >= 0.5, kind, self.kind[mine])


def linked(
    found: Detections,
    users: Sequence[RoadUser],
    time_s: Floats,
    how: Linking,
    tell: Callable[[float], None] = lambda share: None,
) -> list[Rows]:
    """Return the rows of each track in the order of its frames; tracks sorted by their first row.

    Args:
        found: detections in a fixed frame of reference.
        users: motion model of each detection (N,).
        time_s: (frames,) time of every frame, ascending.
        how: scores and gaps.
        tell: called with the fraction done.
    """
    group = np.array([user.name for user in users], dtype=object)
    names = {user.name: user for user in users}
    kind = np.unique(np.array(found.class_names, dtype=object).astype(str), return_inverse=True)[1]
    tracks: list[Rows] = []
    for done, (name, user) in enumerate(sorted(names.items())):
        rows_of_user = np.flatnonzero((group == name) & (found.score >= how.lowest))
        tracks += _linked_group(found, rows_of_user, kind, user, time_s, how)
        tell((done + 1) / len(names))
    return sorted(tracks, key=lambda rows: int(rows[0]))


def _linked_group(
    found: Detections,
    mine: Rows,
    kind: Rows,
    user: RoadUser,
    time_s: Floats,
    how: Linking,
) -> list[Rows]:
    usual = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    gap_s, unsure_s = max(how.gap_s, 1.5 * usual), max(_MAX_UNCONFIRMED_GAP_S, 1.5 * usual)
    live, tracks, sure = _LiveTracks(user), list[list[int]](), list[bool]()
    by_frame = np.split(mine, np.searchsorted(found.frame[mine], np.arange(1, len(time_s))))
    for frame, all_rows in enumerate(by_frame):
        now = float(time_s[frame])
        if frame:
            seconds = now - float(time_s[frame - 1])
            live.predict(seconds)
            live.belief = np.where(
                live.last_s < time_s[frame - 1],
                live.belief * np.exp(-seconds / _FORGETTING_TIME_S),
                live.belief,
            )
            unseen = now - live.last_s
            alive = unseen <= np.where(live.sure, gap_s, unsure_s) + 1e-6
            live.keep(alive)
        rows = _without_duplicates(found, all_rows, user)
        strong = found.score[rows] >= how.birth
        free = np.ones(len(live.number), np.bool_)
        left = []
        for chosen, eligible in ((rows[strong], free), (rows[~strong], live.sure)):
            open_tracks = np.flatnonzero(free & eligible)
            a, b = _pairs(live, open_tracks, found, chosen, kind, now)
            if len(a):
                matched, row = open_tracks[a], chosen[b]
                live.go_on(matched, *_measurements_of(found, row, kind), now)
                for number, detection in zip(live.number[matched], row, strict=True):
                    tracks[number].append(int(detection))
                for number, certain in zip(live.number[matched], live.sure[matched], strict=True):
                    sure[number] |= bool(certain)
                free[matched] = False
            left.append(np.delete(chosen, b))
        new = left[0][~_inside_tracks(live, found.box[left[0]])]
        if len(new):
            live.begin(*_measurements_of(found, new, kind), now, len(tracks))
            tracks += [[int(detection)] for detection in new]
            sure += live.sure[-len(new) :].tolist()
    return [np.array(rows) for rows, is_sure in zip(tracks, sure, strict=True) if is_sure]


def _measurements_of(
    found: Detections, rows: Rows, kind: Rows
) -> tuple[Floats, Floats, Floats, Rows]:
    """Return measurements (n, 4), sizes (n, 3), scores (n,) and classes (n,) of rows."""
    box = found.box[rows]
    return underside(box), box[:, 3:6], found.score[rows], kind[rows]


def underside(box: Floats) -> Floats:
    """Return x, y, height of the underside, and yaw (n, 4) of boxes (n, 7)."""
    return np.column_stack([box[:, :2], box[:, 2] - box[:, 5] / 2, box[:, 6]])


def _inside_tracks(live: _LiveTracks, box: Floats) -> NDArray[np.bool_]:
    """Return which boxes (n, 7) have their centre in an existing track."""
    away = np.linalg.norm(box[:, None, :2] - live.state[None, :, :2], axis=2)
    narrow = np.minimum(box[:, None, 3:5], live.size[None, :, :2]).min(axis=2)
    return np.asarray((away < narrow / 2).any(axis=1))


def _without_duplicates(found: Detections, rows: Rows, user: RoadUser) -> Rows:
    """Return rows of a frame without those whose centre is in a box with a higher score."""
    rows = rows[np.argsort(-found.score[rows], kind="stable")]
    box = found.box[rows]
    away = np.linalg.norm(box[:, None, :2] - box[None, :, :2], axis=2)
    narrow = np.minimum(box[:, 3], box[:, 4])
    overlapping = away < np.minimum(narrow[:, None], narrow[None]) / 2
    is_kept = np.ones(len(rows), np.bool_)
    for index in range(len(rows)):
        is_kept[index] = not (overlapping[index, :index] & is_kept[:index]).any()
    return rows[is_kept]


def _pairs(
    live: _LiveTracks, tracks: Rows, found: Detections, rows: Rows, kind: Rows, now: float
) -> tuple[Rows, Rows]:
    """Return the assignment of some tracks to some detections."""
    if not len(tracks) or not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    seen, size, _, kinds = _measurements_of(found, rows, kind)
    off = innovation(live.state[tracks][:, None], seen[None])
    noise = measured(live.user)
    spread = live.covariance[tracks][:, :SEEN, :SEEN] + np.diag(noise)
    place = np.linalg.inv(spread[:, :2, :2])
    far = np.einsum("tni,tij,tnj->tn", off[..., :2], place, off[..., :2])
    askew = np.minimum(off[..., 3] ** 2 / spread[:, None, 3, 3], 9.0)
    grown = np.log(size[None, :, :2] / live.size[tracks][:, None, :2]) / _SIZE_SIGMA
    other = _CLASS_COST * (live.kind[tracks][:, None] != kinds[None])
    unknown = np.log(np.linalg.det(spread[:, :2, :2]) / (noise[0] * noise[1]))
    # Uncertainty adds to the cost, but by a limited amount: an uncontested pair stays possible.
    cost = far + askew / 2 + np.minimum((grown**2).sum(axis=-1), 9.0) / 2 + other
    cost = cost + np.minimum(unknown, 8.0)[:, None] / 2
    leap = np.linalg.norm(live.last_xy[tracks][:, None] - seen[None, :, :2], axis=2)
    seconds = now - live.last_s[tracks]
    never = (far > _GATE) | (leap > (_DETECTION_ERROR_M + live.user.fastest_m_s * seconds)[:, None])
    gain = np.where(never, 0.0, np.maximum(_MAX_COST - cost, 0.0))
    a, b = linear_sum_assignment(gain, maximize=True)
    good = gain[a, b] > 0
    return np.asarray(a[good], np.int64), np.asarray(b[good], np.int64)
