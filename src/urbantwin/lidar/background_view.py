"""The static world from a measured background."""

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

#: Backscatter where the intensity is unknown: a typical street surface.
_BACKSCATTER = 0.1
#: A modelled surface within this distance of the measured range is the same, metres.
_SAME_M = 1.0
#: A modelled surface is rejected if the chance that no observation returned from it is smaller.
_MISSED_ALL = 0.01
#: Placeholder range of beams that return only in some turns: beyond every sensor, metres.
_NOWHERE_M = 1e5
#: Keys of random numbers of patches, in place of a sensor: change times, and chosen frames.
_CHANGES, _LOOKS = 1, 0


def measured_layers(
    background: MeasuredBackground,
    modelled: StaticLayers,
    model: ReturnModel,
    rays: int,
    level: NDArray[np.int32] | None = None,
    several: SeveralRanges | None = None,
) -> StaticLayers:
    """Return the static layers with measured surfaces at their most frequent range.

    Args:
        background: the measured background.
        modelled: layers of the modelled scene.
        model: return model of the sensor.
        rays: number of rays per beam.
        level: (N,) detection level (of 65,536) of the modelled scene; if given, surfaces that the
            measured observations contradict are left out.
        several: beams with several ranges; each gets a layer, at a placeholder range if need be.
    """
    known, beam = background.known, modelled.beam
    kept = ~known[beam] if background.fused else np.zeros(len(beam), np.bool_)
    if level is not None and background.looks.size:
        missed = (1 - level / LEVELS) ** background.looks.ravel()
        kept &= (missed >= _MISSED_ALL)[beam]
    measured = np.flatnonzero(known)
    range_m, back, semantic = _surfaces(
        background.range_m[0].ravel()[measured],
        background.intensity[0].ravel()[measured],
        measured,
        modelled,
        model,
    )
    if several is not None:
        bare = np.setdiff1d(several.beam, np.concatenate([beam[kept], measured]))
        measured = np.concatenate([measured, bare])
        range_m = np.concatenate([range_m, np.full(len(bare), _NOWHERE_M, np.float32)])
        back = np.concatenate([back, np.zeros(len(bare), np.float32)])
        semantic = np.concatenate([semantic, np.zeros(len(bare), np.uint16)])
    # A measured intensity already includes pulse stretching; modelled surfaces are treated alike.
    faced = modelled._replace(peak=np.ones_like(modelled.peak))
    return faced.filled(kept, measured, range_m, back, semantic, rays)


def measured_answers(
    background: MeasuredBackground,
    modelled: Answers,
    has: NDArray[np.bool_],
    effects: Effects,
    missing: float = 0.0,
) -> Answers:
    """Replace modelled drop-out, noise and intensity by the measured ones.

    Args:
        background: the measured background.
        modelled: responses to `measured_layers`.
        has: (N,) beams with an echo.
        effects: effects of the sensor; an effect that is off stays off.
        missing: share of beams that the sensor loses anyway, which the measured share includes.
    """
    level, sigma, intensity = modelled.level, modelled.sigma, modelled.intensity
    known = background.known & has
    if effects.dropout:
        share = np.minimum(background.returned / max(1.0 - missing, 1e-6), 1.0)
        use = known & np.isfinite(share)
        level = np.where(use, np.rint(np.nan_to_num(share) * LEVELS).astype(np.int32), level)
    if effects.noise:
        use = known & np.isfinite(background.sigma_m[0].ravel())
        sigma = np.where(use, background.sigma_m[0].ravel(), sigma)
    use = known & np.isfinite(background.intensity[0].ravel())
    intensity = np.where(use, background.intensity[0].ravel(), intensity)
    return modelled._replace(level=level, sigma=sigma, intensity=intensity)


def several_ranges(
    background: MeasuredBackground, modelled: StaticLayers, model: ReturnModel, effects: Effects
) -> SeveralRanges | None:
    """Return the beams with several ranges; ``None`` if there are none.

    Without the drop-out effect nothing is random: beams keep their most frequent range.
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
    # A beam without measured shares keeps its first range.
    below = np.rint(np.where(total[-1] > 0, total / whole, 1.0) * LEVELS).astype(np.int64)
    if stirring is not None:
        column = np.searchsorted(beam, stirring.beam)
        seen = np.zeros((2, len(stirring.range_m), len(beam)))
        seen[0][:, column], seen[1][:, column] = stirring.range_m, stirring.intensity
        range_m, intensity = (
            np.concatenate(parts) for parts in zip((range_m, intensity), seen, strict=True)
        )
        # A replayed observation already includes noise.
        sigma = np.concatenate([sigma, np.zeros_like(seen[0])])
    if not effects.noise:
        sigma = np.zeros_like(sigma)
    surfaces = [
        _surfaces(*images, beam, modelled, model) for images in zip(range_m, intensity, strict=True)
    ]
    present = range_m > 0
    range_m, back, semantic = (np.stack(parts) for parts in zip(*surfaces, strict=True))
    return SeveralRanges(
        beam,
        below,
        np.where(present, range_m, 0).astype(np.float32),
        sigma.astype(np.float32),
        intensity.astype(np.float32),
        back,
        semantic,
        stirring,
    )


def _surfaces(
    range_m: NDArray[np.floating],
    intensity: NDArray[np.floating],
    beam: NDArray[np.int64],
    modelled: StaticLayers,
    model: ReturnModel,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint16]]:
    """Return range, backscatter and semantic class of beams (B,) at measured ranges (B,).

    The class is that of a modelled surface within a metre, else unlabelled. The backscatter
    reproduces the measured intensity; without one it is that of the modelled surface.
    """
    # Measured ranges include the unit's range offset.
    range_m = np.maximum(range_m - model.offset_m, 1e-3).astype(np.float32)
    semantic, back = _beside(modelled, beam, range_m)
    known = np.isfinite(intensity)
    amplitude = np.geomspace(1e-4, 100.0, 2000).astype(np.float32)
    codes = np.maximum.accumulate(model.intensity(amplitude))
    back[known] = np.interp(intensity[known], codes, amplitude)
    # The measured surface did return, however weak the model predicts.
    unit = model.strength(np.ones(len(beam), np.float32), range_m)
    back = np.maximum(back, (1.0 / np.maximum(unit, 1e-6)).astype(np.float32))
    return range_m, back, semantic


@dataclass(frozen=True, eq=False)
class SeveralRanges:
    """B beams with one of several ranges: M static ones, or Q frames of moving vegetation.

    Attributes:
        beam: (B,) int64, ascending.
        below: (M, B) int64, cumulative probability of the M ranges, of 65,536.
        range_m: (M + Q, B) float32, metres; 0 for none.
        sigma_m: (M + Q, B) float32, metres.
        intensity: (M + Q, B) float32; nan: as the first range's.
        backscatter: (M + Q, B) float32.
        semantic: (M + Q, B) uint16.
        stirring: the moving vegetation of the Q frames.
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
        """Draw one of the M + Q surfaces for each beam (B,) in a turn.

        Args:
            seed: random seed.
            turn: number of the turn.
            time_s: start of the turn.
            draws: (N,) uniform draws of the beams.
        """
        which: NDArray[np.int64] = (draws[self.beam] >= self.below[:-1]).sum(axis=0)
        if self.stirring is not None:
            column = np.searchsorted(self.beam, self.stirring.beam)
            other = len(self.below) + _frames_seen(self.stirring, seed, turn, time_s)
            hit = self.range_m[other, column] > 0
            which[column[hit]] = other[hit]
        return which

    def seen(
        self, which: NDArray[np.int64], layers: StaticLayers, answers: Answers
    ) -> tuple[StaticLayers, Answers, NDArray[np.int64]]:
        """Return layers and responses of one turn, and the beams that hit vegetation.

        Args:
            which: (B,) drawn surface of each beam.
            layers: static layers at the most frequent ranges.
            answers: responses to these.
        """
        (other,) = np.nonzero(which)
        beam, chosen = self.beam[other], (which[other], other)
        layer = layers.start[beam]
        bright = self.intensity[chosen]
        known = np.isfinite(bright)
        seen = Answers._make(values.copy() for values in answers)
        seen.range_m[beam], seen.sigma[beam] = self.range_m[chosen], self.sigma_m[chosen]
        seen.intensity[beam[known]] = bright[known]
        seen.semantic[beam] = self.semantic[chosen]
        stirred = self.beam[which >= len(self.below)]
        seen.level[stirred] = LEVELS  # Lost observations are not among the replayed frames.
        changed = layers._replace(
            range_m=layers.range_m.copy(),
            backscatter=layers.backscatter.copy(),
            semantic=layers.semantic.copy(),
        )
        changed.range_m[layer], changed.backscatter[layer] = (
            self.range_m[chosen],
            self.backscatter[chosen],
        )
        changed.semantic[layer] = self.semantic[chosen]
        return changed, seen, stirred


def _frames_seen(stirring: Stirring, seed: int, turn: int, time_s: float) -> NDArray[np.int64]:
    """Draw the recorded frame (of Q) that each beam (B,) replays in a turn."""
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
    modelled: StaticLayers, chosen: NDArray[np.int64], range_m: NDArray[np.float32]
) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return semantic class and backscatter of the modelled surfaces nearest to measured ranges."""
    count = len(modelled.start) - 1
    beam = np.repeat(np.arange(count), np.diff(modelled.start))
    measured_m = np.zeros(count, np.float32)
    measured_m[chosen] = range_m
    away = np.abs(modelled.range_m - measured_m[beam])
    order = np.lexsort((away, beam))
    first = order[np.unique(beam[order], return_index=True)[1]]
    nearest = first[away[first] < _SAME_M]
    semantic = np.zeros(count, np.uint16)
    back = np.full(count, _BACKSCATTER, np.float32)
    semantic[beam[nearest]] = modelled.semantic[nearest]
    back[beam[nearest]] = modelled.backscatter[nearest]
    return semantic[chosen], back[chosen]
