"""The static world as a sensor with a measured background sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.background import MeasuredBackground, Stirring
from urbantwin.lidar.echoes import Answers
from urbantwin.lidar.returns import LEVELS, Purpose, ReturnModel, draw
from urbantwin.lidar.static_world import StaticLayers
from urbantwin.site.rig import Effects

__all__ = ["SeveralRanges", "measured_answers", "measured_layers", "several_ranges"]

#: Of what nothing says how bright it is: a middling street.
_BACKSCATTER = 0.1
#: A modelled surface this near to the measured range is what was measured, metres.
_SAME_M = 1.0
#: A modelled surface is refuted where so many looks would all miss it with less than this chance.
_MISSED_ALL = 0.01
#: Where beams meet what they see in other turns alone: out of every sensor's reach, metres.
_NOWHERE_M = 1e5
#: What random numbers of patches are keyed with in a sensor's place: when one changes, to what.
_CHANGES, _LOOKS = 1, 0


def measured_layers(
    background: MeasuredBackground,
    modelled: StaticLayers,
    model: ReturnModel,
    rays: int,
    level: NDArray[np.int32] | None = None,
    several: SeveralRanges | None = None,
) -> StaticLayers:
    """Return what beams meet: one surface at their most frequent range, or as the model says.

    Args:
        background: what was measured.
        modelled: what they meet in the modelled scene.
        model: what the sensor makes of echoes.
        rays: how many a beam is made of.
        level: (N,) of 65,536 below which a draw means a return of the modelled scene. With
            it, surfaces that measured looks refute are left out: they would have seen them.
        several: what beams see now and then: each of these meets something, if out of reach.
    """
    known, beam = background.known, modelled.beam
    kept = ~known[beam] if background.fused else np.zeros(len(beam), np.bool_)
    if level is not None and background.looks.size:
        missed = (1 - level / LEVELS) ** background.looks.ravel()
        kept &= (missed >= _MISSED_ALL)[beam]
    mine = np.flatnonzero(known)
    range_m, back, semantic = _surfaces(
        background.range_m[0].ravel()[mine],
        background.intensity[0].ravel()[mine],
        mine,
        modelled,
        model,
    )
    if several is not None:
        bare = np.setdiff1d(several.beam, np.concatenate([beam[kept], mine]))
        mine = np.concatenate([mine, bare])
        range_m = np.concatenate([range_m, np.full(len(bare), _NOWHERE_M, np.float32)])
        back = np.concatenate([back, np.zeros(len(bare), np.float32)])
        semantic = np.concatenate([semantic, np.zeros(len(bare), np.uint16)])
    # What was measured is what it sends back as it stands, and so is what is modelled beside it.
    faced = modelled._replace(peak=np.ones_like(modelled.peak))
    return faced.filled(kept, mine, range_m, back, semantic, rays)


def measured_answers(
    background: MeasuredBackground,
    modelled: Answers,
    has: NDArray[np.bool_],
    effects: Effects,
    missing: float = 0.0,
) -> Answers:
    """Return what beams report with the measured drop-out, noise and intensity.

    Args:
        background: what was measured.
        modelled: the modelled answers to `measured_layers`.
        has: which beams (N,) have an echo.
        effects: the sensor's: what is off is not measured either.
        missing: share of beams that the sensor loses besides: the measured share has it too.
    """
    level, sigma, intensity = modelled.level, modelled.sigma, modelled.intensity
    known = background.known & has
    if effects.dropout:
        share = np.minimum(background.returned / max(1.0 - missing, 1e-6), 1.0)
        told = known & np.isfinite(share)
        level = np.where(told, np.rint(np.nan_to_num(share) * LEVELS).astype(np.int32), level)
    if effects.noise:
        told = known & np.isfinite(background.sigma_m[0].ravel())
        sigma = np.where(told, background.sigma_m[0].ravel(), sigma)
    told = known & np.isfinite(background.intensity[0].ravel())
    intensity = np.where(told, background.intensity[0].ravel(), intensity)
    return modelled._replace(level=level, sigma=sigma, intensity=intensity)


def several_ranges(
    background: MeasuredBackground, modelled: StaticLayers, model: ReturnModel, effects: Effects
) -> SeveralRanges | None:
    """Return what beams see now and then that have several ranges; ``None``: there are none.

    Without drop-out nothing is left to chance: they see their most frequent range.
    """
    stirring, modes = background.stirring, len(background.range_m)
    several = (background.share > 0).sum(axis=0).ravel() > 1
    if stirring is not None:
        several[stirring.beam] = True
    beam = np.flatnonzero(several)
    if not len(beam) or not effects.dropout:
        return None
    share, range_m, sigma, intensity = (
        image.reshape(modes, -1)[:, beam].astype(np.float64)
        for image in (
            background.share,
            background.range_m,
            background.sigma_m,
            background.intensity,
        )
    )
    total = np.cumsum(share, axis=0)
    whole = np.where(total[-1] > 0, total[-1], 1.0)
    # What nothing is measured of sees its first surface.
    below = np.rint(np.where(total[-1] > 0, total / whole, 1.0) * LEVELS).astype(np.int64)
    if stirring is not None:
        at = np.searchsorted(beam, stirring.beam)
        seen = np.zeros((2, len(stirring.range_m), len(beam)))
        seen[0][:, at], seen[1][:, at] = stirring.range_m, stirring.intensity
        range_m, intensity = (
            np.concatenate(parts) for parts in zip((range_m, intensity), seen, strict=True)
        )
        # A look as it was measured has its noise.
        sigma = np.concatenate([sigma, np.zeros_like(seen[0])])
    if not effects.noise:
        sigma = np.zeros_like(sigma)
    found = [_surfaces(*one, beam, modelled, model) for one in zip(range_m, intensity, strict=True)]
    there = range_m > 0
    range_m, back, semantic = (np.stack(parts) for parts in zip(*found, strict=True))
    return SeveralRanges(
        beam,
        below,
        np.where(there, range_m, 0).astype(np.float32),
        sigma.astype(np.float32),
        intensity.astype(np.float32),
        back,
        semantic,
        stirring,
    )


def _surfaces(
    range_m: NDArray[np.floating],
    intensity: NDArray[np.floating],
    mine: NDArray[np.int64],
    modelled: StaticLayers,
    model: ReturnModel,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint16]]:
    """Return range, backscatter and class of what beams (B,) meet at measured ranges (B,).

    Its class is that of the modelled surface within a metre, else unlabelled; its backscatter
    what gives the measured intensity, else the modelled surface's.
    """
    # What this unit adds to every range is in the measured ones already.
    range_m = np.maximum(range_m - model.offset_m, 1e-3).astype(np.float32)
    semantic, back = _beside(modelled, mine, range_m)
    told = np.isfinite(intensity)
    amplitude = np.geomspace(1e-4, 100.0, 2000).astype(np.float32)
    codes = np.maximum.accumulate(model.intensity(amplitude))
    back[told] = np.interp(intensity[told], codes, amplitude)
    # It did come back, however weak the model takes it for.
    one = model.strength(np.ones(len(mine), np.float32), range_m)
    back = np.maximum(back, (1.0 / np.maximum(one, 1e-6)).astype(np.float32))
    return range_m, back, semantic


@dataclass(frozen=True, eq=False)
class SeveralRanges:
    """What B beams see that meet now one and now another surface: M always there, Q that stir.

    Attributes:
        beam: (B,) int64, ascending.
        below: (M, B) int64, the level of 65,536 below which a draw means this surface or one
            before it.
        range_m: (M + Q, B) float32, metres; 0: none.
        sigma_m: (M + Q, B) float32, metres.
        intensity: (M + Q, B) float32; nan: as the first's.
        backscatter: (M + Q, B) float32.
        semantic: (M + Q, B) uint16.
        stirring: what stirs; the Q are its frames.
    """

    beam: NDArray[np.int64]
    below: NDArray[np.int64]
    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    semantic: NDArray[np.uint16]
    stirring: Stirring | None = None

    def drawn(
        self, seed: int, turn: int, time_s: float, draws: NDArray[np.uint16]
    ) -> NDArray[np.int64]:
        """Return which of the M + Q surfaces each beam (B,) sees in one turn.

        Args:
            seed: of all random numbers.
            turn: its number.
            time_s: when it begins.
            draws: (N,) of the beams.
        """
        which: NDArray[np.int64] = (draws[self.beam] >= self.below[:-1]).sum(axis=0)
        if self.stirring is not None:
            at = np.searchsorted(self.beam, self.stirring.beam)
            other = len(self.below) + _frames_seen(self.stirring, seed, turn, time_s)
            met = self.range_m[other, at] > 0
            which[at[met]] = other[met]
        return which

    def seen(
        self, which: NDArray[np.int64], layers: StaticLayers, answers: Answers
    ) -> tuple[StaticLayers, Answers, NDArray[np.int64]]:
        """Return layers and answers of one turn, and the beams that see what stirs.

        Args:
            which: (B,) surface that each of them sees.
            layers: what beams meet, at their most frequent range.
            answers: what they report of it.
        """
        (other,) = np.nonzero(which)
        beam, chosen = self.beam[other], (which[other], other)
        at = layers.start[beam]
        bright = self.intensity[chosen]
        told = np.isfinite(bright)
        seen = Answers._make(values.copy() for values in answers)
        seen.range_m[beam], seen.sigma[beam] = self.range_m[chosen], self.sigma_m[chosen]
        seen.intensity[beam[told]] = bright[told]
        seen.semantic[beam] = self.semantic[chosen]
        stirred = self.beam[which >= len(self.below)]
        seen.level[stirred] = LEVELS  # A look that was lost is none of these.
        met = layers._replace(
            range_m=layers.range_m.copy(),
            backscatter=layers.backscatter.copy(),
            semantic=layers.semantic.copy(),
        )
        met.range_m[at], met.backscatter[at] = self.range_m[chosen], self.backscatter[chosen]
        met.semantic[at] = self.semantic[chosen]
        return met, seen, stirred


def _frames_seen(stirring: Stirring, seed: int, turn: int, time_s: float) -> NDArray[np.int64]:
    """Return which of the Q frames each beam (B,) sees in a turn."""
    patches = int(stirring.patch.max(initial=-1)) + 1
    if stirring.lasts_s <= 0:
        drawn = draw(seed, _LOOKS, turn, patches, Purpose.STIRRING).detection
    else:
        ends = draw(seed, _CHANGES, 0, patches, Purpose.STIRRING).detection / LEVELS
        elapsed = max(time_s, 0.0) / stirring.lasts_s
        first = int(elapsed)
        now, then = (
            draw(seed, _LOOKS, first + n, patches, Purpose.STIRRING).detection for n in (0, 1)
        )
        drawn = np.where(elapsed - first + ends < 1, now, then)
    level: NDArray[np.int64] = drawn[stirring.patch].astype(np.int64)
    return level * len(stirring.range_m) // LEVELS


def _beside(
    modelled: StaticLayers, mine: NDArray[np.int64], range_m: NDArray[np.float32]
) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return class and backscatter of the modelled surfaces nearest to measured ranges."""
    count = len(modelled.start) - 1
    beam = np.repeat(np.arange(count), np.diff(modelled.start))
    at = np.zeros(count, np.float32)
    at[mine] = range_m
    away = np.abs(modelled.range_m - at[beam])
    order = np.lexsort((away, beam))
    first = order[np.unique(beam[order], return_index=True)[1]]
    near = first[away[first] < _SAME_M]
    semantic = np.zeros(count, np.uint16)
    back = np.full(count, _BACKSCATTER, np.float32)
    semantic[beam[near]] = modelled.semantic[near]
    back[beam[near]] = modelled.backscatter[near]
    return semantic[mine], back[mine]
