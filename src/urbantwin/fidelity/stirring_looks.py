"""Moving foliage in frames of fixed sensors: leaves, hedges, fidgeting people.

A beam that sometimes hits a leaf has no static range, but the location is known: most frames have
returns near it, though rarely of the same beam. Passing traffic occupies a location for few frames,
and waiting traffic arrives once and leaves once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.beam_assignment import BeamsOf
from urbantwin.geometry import row_keys
from urbantwin.lidar.background import Stirring
from urbantwin.reconstruct.recording.range_modes import ALTERNATES, RangeModes

__all__ = ["MOST_FRAMES", "Looks", "stirring_before"]

#: Maximum number of frames used; more are sampled evenly.
MOST_FRAMES = 16
#: A return is at a static range within the largest of this distance (metres) and three standard
#: deviations, plus this share of the range.
_NEAR_M, _NEAR_SHARE = 0.2, 0.003
#: Foliage is detected in cubes of three cells of this size (metres) per side. A cube has foliage if
#: this share of the frames have returns there, as randomly as by chance or in all but this share of
#: the frames.
_CELL_M, _LEAST_SHARE, _RARELY = 0.3, 0.5, 0.1
#: A return nearer by this than all foliage of its beam hides the foliage, metres.
_BEFORE_M = 0.25
#: Size of a patch of foliage that moves together, metres: returns 0.2 m apart come and go with a
#: correlation of 0.4, 0.6 m apart of 0.13 and 1.2 m apart of 0.03 (LUMPI, frames 1 to 12, above 0.5
#: m).
_PATCH_M = 1.5
#: Beams within this angle hit the same object if their ranges are similar, radians.
_BESIDE_RAD = 0.03


@dataclass(frozen=True, eq=False)
class Looks:
    """The returns of one sensor in F frames.

    Attributes:
        beams: the sensor's N beams.
        range_m: (F, N) float32, metres; 0: no return.
        intensity: (F, N) float32, on the recording's scale; nan: unknown.
        modes: static ranges of the beams, without waiting traffic.
        waits: returns the mask of the positions (K, 3), in the sensor frame, of waiting traffic.
    """

    beams: BeamsOf
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    modes: RangeModes
    waits: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None

    @classmethod
    def of(
        cls,
        beams: BeamsOf,
        frames: Sequence[tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]],
        modes: RangeModes,
        waits: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None,
    ) -> Looks:
        """Build from frames, each given as beams (M,), ranges (M,) and intensities (M,)."""
        range_m = np.zeros((len(frames), beams.count), np.float32)
        intensity = np.full(range_m.shape, np.nan, np.float32)
        for row, light, (beam, far, bright) in zip(range_m, intensity, frames, strict=True):
            row[beam], light[beam] = far, bright
        return cls(beams, range_m, intensity, modes, waits)

    def passing(self) -> NDArray[np.bool_]:
        """Return the mask (F, N) of the returns that are not at a static range."""
        found = self.range_m > 0
        for mode in range(self.modes.range_m.shape[1]):
            at = self.modes.range_m[:, mode]
            reach = np.maximum(_NEAR_M, 3 * self.modes.sigma_m[:, mode]) + _NEAR_SHARE * at
            found &= (self.modes.share[:, mode] == 0) | (np.abs(self.range_m - at) > reach)
        return found

    def places(self, looks: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the points (K, 3) of the masked returns (F, N), in the sensor frame."""
        _, beam = np.nonzero(looks)
        aim: NDArray[np.float64] = self.beams.directions.reshape(-1, 3)[beam]
        return aim * self.range_m[looks][:, None]


def stirring_before(sensors: Sequence[Looks], *, interval_s: float) -> list[Stirring | None]:
    """Return the moving foliage in the view of each sensor; ``None``: there is none.

    Args:
        sensors: returns of the sensors in the same frames.
        interval_s: time between these frames, seconds.
    """
    passing = [one.passing() for one in sensors]
    stirs, places = [], []
    for one, looks in zip(sensors, passing, strict=True):
        at, mine = one.places(looks), looks.copy()
        if one.waits is not None:
            keeps = ~one.waits(at)
            mine[looks], at = keeps, at[keeps]
        stirs.append(mine)
        places.append(one.beams.points_SE3_sensor.apply(at))
    frame = np.concatenate([np.nonzero(mine)[0] for mine in stirs])
    kept = _stirring(np.concatenate(places), frame, len(passing[0]))
    of_sensor = np.split(kept, np.cumsum([len(at) for at in places])[:-1])
    for mine, keeps in zip(stirs, of_sensor, strict=True):
        mine[mine] = keeps
    lasts_s = interval_s * _lasts(stirs)
    middle = [_middles(one, mine) for one, mine in zip(sensors, stirs, strict=True)]
    cells = np.floor(np.concatenate(middle)[:, :2] / _PATCH_M).astype(np.int64)
    patch = np.unique(row_keys(cells), axis=0, return_inverse=True)[1].astype(np.int32).ravel()
    of_beams = np.split(patch, np.cumsum([len(one) for one in middle])[:-1])
    return [
        _of_sensor(one, looks, mine, each, lasts_s) if len(each) else None
        for one, looks, mine, each in zip(sensors, passing, stirs, of_beams, strict=True)
    ]


def _stirring(
    places: NDArray[np.float64], frame: NDArray[np.int64], frames: int
) -> NDArray[np.bool_]:
    """Return the mask (K,) of the returns at locations that are hit again and again."""
    cell = np.floor(places / _CELL_M).astype(np.int64)
    cell -= cell.min(axis=0, initial=0) - 1
    size = cell.max(axis=0, initial=0) + 2
    name = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    names, at = np.unique(name, return_inverse=True)
    met = np.zeros((len(names), frames), np.bool_)
    met[at, frame] = True
    around = met.copy()
    for x, y, z in product((-1, 0, 1), repeat=3):
        beside = names + (x * size[1] + y) * size[2] + z
        row = np.searchsorted(names, beside).clip(0, max(len(names) - 1, 0))
        there = names[row] == beside
        around[there] |= met[row[there]]
    hits = around.sum(axis=1)
    changes = (np.diff(around.astype(np.int8), axis=1) != 0).sum(axis=1)
    missed = frames - hits
    by_chance = changes >= ALTERNATES * 2.0 * hits * missed / frames
    stays = (hits >= _LEAST_SHARE * frames) & ((missed <= _RARELY * frames) | by_chance)
    return np.asarray(stays[at])


def _lasts(stirs: Sequence[NDArray[np.bool_]]) -> float:
    """Return the number of frames for which the state of foliage persists.

    A state that persists for T frames, with changes at random times, has a correlation of 1 - 1 / T
    from one frame to the next. The correlation of F frames about their own mean is too low by 1 /
    (F - 1).
    """
    product_, variance = 0.0, 0.0
    for mine in stirs:
        off = mine[:, mine.any(axis=0)].astype(np.float64)
        off -= off.mean(axis=0)
        product_ += float((off[:-1] * off[1:]).mean(axis=0).sum())
        variance += float((off**2).mean(axis=0).sum())
    bias = 1 / (len(stirs[0]) - 1)
    same = (product_ / max(variance, 1e-9) + bias) / (1 + bias)
    return 1 / (1 - min(max(same, 0.0), 0.99))


def _middles(one: Looks, stirs: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the mean position (B, 3) of the foliage around each beam that has any.

    The few returns of one beam lie anywhere within a plant: neighbouring beams are averaged.
    """
    places = one.places(stirs)
    at = np.unique(np.nonzero(stirs)[1], return_inverse=True)[1]
    middle = _means(places, at)
    far = np.round(np.log2(np.maximum(np.linalg.norm(middle, axis=1), 1e-3)))
    around = np.floor(np.arctan2(middle[:, 1], middle[:, 0]) / _BESIDE_RAD)
    beside = np.unique(np.column_stack([far, around]), axis=0, return_inverse=True)[1].ravel()
    return one.beams.points_SE3_sensor.apply(_means(places, beside[at])[beside])


def _means(places: NDArray[np.float64], group: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the mean (G, 3) of the positions (K, 3) of each group (K,), numbered from 0."""
    sums = np.stack([np.bincount(group, places[:, n]) for n in range(3)], axis=1)
    return sums / np.bincount(group)[:, None]


def _of_sensor(
    one: Looks,
    passing: NDArray[np.bool_],
    stirs: NDArray[np.bool_],
    patch: NDArray[np.int32],
    lasts_s: float,
) -> Stirring:
    """Return the foliage of a sensor per frame; hidden frames copy the nearest frame in time.

    Args:
        one: the sensor's returns.
        passing: (F, N) mask of returns that are not at a static range.
        stirs: (F, N) mask of those on foliage.
        patch: (B,) patch of each beam with foliage.
        lasts_s: time for which a state persists, seconds.
    """
    beam = np.flatnonzero(stirs.any(axis=0))
    stirs, range_m = stirs[:, beam], one.range_m[:, beam]
    nearest = np.where(stirs, range_m, np.inf).min(axis=0)
    hidden = passing[:, beam] & ~stirs & (range_m < nearest - _BEFORE_M)
    frames = np.arange(len(stirs))
    away = np.abs(frames[:, None] - frames)[:, :, None] + np.where(hidden, len(frames), 0)
    source = away.argmin(axis=1)
    seen = np.where(stirs, range_m, 0)
    light = np.where(stirs, one.intensity[:, beam], np.nan)
    return Stirring(
        beam.astype(np.int32),
        patch,
        np.take_along_axis(seen, source, axis=0),
        np.take_along_axis(light, source, axis=0).astype(np.float32),
        lasts_s,
    )
