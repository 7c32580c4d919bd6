"""The static world as a real sensor measured it, beam by beam, in place of the modelled one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.returns.draws import LEVELS
from urbantwin.lidar.static import StaticLayers

if TYPE_CHECKING:
    from urbantwin.lidar.returns import ReturnModel
    from urbantwin.site.rig import Effects

__all__ = ["IMAGES", "MeasuredBackground", "SeveralRanges"]

#: The images of a background by their names.
IMAGES = ("range_m", "sigma_m", "share", "intensity")
#: Of what nothing says how bright it is: a middling street.
_BACKSCATTER = 0.1
#: A modelled surface this near to the measured range is what was measured, metres.
_SAME_M = 1.0
#: A modelled surface is refuted where so many looks would all miss it with less than this chance.
_MISSED_ALL = 0.01


def _no_looks() -> NDArray[np.int32]:
    return np.zeros((0, 0), np.int32)


@dataclass(frozen=True, eq=False)
class MeasuredBackground:
    """What each beam of a fixed sensor finds when nothing moves before it.

    A beam has up to M ranges, the most frequent first: an edge, a fence, a tree.

    Attributes:
        range_m: (M, C, K) float32, metres; 0 where there is none.
        sigma_m: (M, C, K) float32, standard deviation of the range, metres; nan: not known.
        share: (M, C, K) float32, of the unobstructed looks, those that came back from there; nan:
            not known, of a beam with one range.
        intensity: (M, C, K) float32, 0 to 1; nan where nobody knows.
        looks: (C, K) int32, how many were unobstructed; 0 where nobody counted.
        model: of the sensor; empty: any that has as many channels and columns.
        turns_per_second: of it; nan: not known.
        name: of the sensor in its rig.
        fused: beams without a measured range see the modelled scene, in place of nothing.
    """

    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    share: NDArray[np.float32]
    intensity: NDArray[np.float32]
    looks: NDArray[np.int32] = field(default_factory=_no_looks)
    model: str = ""
    turns_per_second: float = float("nan")
    name: str = ""
    fused: bool = False

    @property
    def shape(self) -> tuple[int, int]:
        """Channels and columns."""
        return self.range_m.shape[1], self.range_m.shape[2]

    @property
    def sha256(self) -> str:
        """The hash of all its values: what a recipe knows it by."""
        digest = hashlib.sha256(repr((self.range_m.shape, self.fused)).encode())
        for name in (*IMAGES, "looks"):
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        return digest.hexdigest()

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which beams (N,) have a measured range."""
        return np.asarray(self.range_m[0].ravel() > 0)

    @property
    def returned(self) -> NDArray[np.float32]:
        """Share (N,) of the unobstructed looks that came back; nan: not known."""
        total = self.share.sum(axis=0, dtype=np.float32).ravel()
        return np.asarray(np.where(self.known, np.minimum(total, 1), 0), np.float32)

    def layers(
        self,
        modelled: StaticLayers,
        model: ReturnModel,
        rays: int,
        level: NDArray[np.int32] | None = None,
    ) -> StaticLayers:
        """Return what beams meet: one surface at their most frequent range, or as the model says.

        Args:
            modelled: what they meet in the modelled scene.
            model: what the sensor makes of echoes.
            rays: how many a beam is made of.
            level: (N,) of 65,536 below which a draw means a return of the modelled scene. With
                it, surfaces that measured looks refute are left out: they would have seen them.
        """
        known, count = self.known, len(modelled.start) - 1
        beam = np.repeat(np.arange(count), np.diff(modelled.start))
        kept = ~known[beam] if self.fused else np.zeros(len(beam), np.bool_)
        if level is not None and self.looks.size:
            missed = (1 - level / LEVELS) ** self.looks.ravel()
            kept &= (missed >= _MISSED_ALL)[beam]
        mine = np.flatnonzero(known)
        range_m, back, semantic = self._surfaces(0, mine, modelled, model)
        number = np.concatenate([beam[kept], mine])
        order = np.argsort(number, kind="stable")
        full = np.full(len(mine), (1 << rays) - 1, np.uint8)
        start = np.zeros(count + 1, np.int64)
        np.cumsum(np.bincount(number, minlength=count), out=start[1:])
        return StaticLayers(
            start,
            np.concatenate([modelled.range_m[kept], range_m])[order],
            np.concatenate([modelled.backscatter[kept], back])[order],
            np.concatenate([modelled.through[kept], np.zeros(len(mine), np.float32)])[order],
            np.concatenate([modelled.mask[kept], full])[order],
            np.concatenate([modelled.semantic[kept], semantic])[order],
        )

    def reported(
        self,
        report: tuple[NDArray[Any], ...],
        has: NDArray[np.bool_],
        effects: Effects,
        missing: float = 0.0,
    ) -> tuple[NDArray[Any], ...]:
        """Return what beams report with the measured drop-out, noise and intensity.

        Args:
            report: level (N,) below which a draw means a return, range, sigma, intensity and
                amplitude of the modelled answer to `layers`.
            has: which beams (N,) have an echo.
            effects: the sensor's: what is off is not measured either.
            missing: share of beams that the sensor loses besides: the measured share has it too.
        """
        level, range_m, sigma, intensity, amplitude = report
        known = self.known & has
        if effects.dropout:
            share = np.minimum(self.returned / max(1.0 - missing, 1e-6), 1.0)
            told = known & np.isfinite(share)
            level = np.where(told, np.rint(np.nan_to_num(share) * LEVELS).astype(np.int32), level)
        if effects.noise:
            told = known & np.isfinite(self.sigma_m[0].ravel())
            sigma = np.where(told, self.sigma_m[0].ravel(), sigma)
        told = known & np.isfinite(self.intensity[0].ravel())
        intensity = np.where(told, self.intensity[0].ravel(), intensity)
        return level, range_m, sigma, intensity, amplitude

    def several(
        self, modelled: StaticLayers, model: ReturnModel, effects: Effects
    ) -> SeveralRanges | None:
        """Return what beams with more than one range see now and then; ``None``: there are none.

        Without drop-out nothing is left to chance: they see their most frequent range.
        """
        beam = np.flatnonzero((self.share > 0).sum(axis=0).ravel() > 1)
        if not len(beam) or not effects.dropout:
            return None
        modes = range(len(self.range_m))
        share = self.share.reshape(len(modes), -1)[:, beam].astype(np.float64)
        below = np.rint(np.cumsum(share, axis=0) / share.sum(axis=0) * LEVELS).astype(np.int64)
        found = [self._surfaces(n, beam, modelled, model) for n in modes]
        sigma, intensity = (
            image.reshape(len(modes), -1)[:, beam] for image in (self.sigma_m, self.intensity)
        )
        if not effects.noise:
            sigma = np.zeros_like(sigma)
        range_m, back, semantic = (np.stack(parts) for parts in zip(*found, strict=True))
        return SeveralRanges(beam, below, range_m, sigma, intensity, back, semantic)

    def _surfaces(
        self, mode: int, mine: NDArray[np.int64], modelled: StaticLayers, model: ReturnModel
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint16]]:
        """Return range, backscatter and class of what beams meet at one of their ranges.

        Its class is that of the modelled surface within a metre, else unlabelled; its backscatter
        what gives the measured intensity, else the modelled surface's.
        """
        # What this unit adds to every range is in the measured ones already.
        range_m = np.maximum(self.range_m[mode].ravel()[mine] - model.offset_m, 1e-3)
        semantic, back = _beside(modelled, mine, range_m)
        intensity = self.intensity[mode].ravel()[mine]
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
    """What B beams see that meet now one and now another surface: M of them.

    Attributes:
        beam: (B,) int64.
        below: (M, B) int64, the level of 65,536 below which a draw means this surface or one
            before it.
        range_m: (M, B) float32, metres.
        sigma_m: (M, B) float32, metres.
        intensity: (M, B) float32; nan: as the first's.
        backscatter: (M, B) float32.
        semantic: (M, B) uint16.
    """

    beam: NDArray[np.int64]
    below: NDArray[np.int64]
    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    backscatter: NDArray[np.float32]
    semantic: NDArray[np.uint16]

    def drawn(
        self,
        draws: NDArray[np.uint16],
        layers: StaticLayers,
        report: tuple[NDArray[Any], ...],
    ) -> tuple[StaticLayers, tuple[NDArray[Any], ...]]:
        """Return layers and report of one turn.

        Args:
            draws: (N,) of the beams.
            layers: what beams meet, at their most frequent range.
            report: level, range, sigma, intensity and class (N,) of what they report of it.
        """
        which = (draws[self.beam] >= self.below[:-1]).sum(axis=0)
        (other,) = np.nonzero(which)
        beam, chosen = self.beam[other], (which[other], other)
        at = layers.start[beam]
        level, *values = report
        values = [one.copy() for one in values]
        bright = self.intensity[chosen]
        told = np.isfinite(bright)
        values[0][beam], values[1][beam] = self.range_m[chosen], self.sigma_m[chosen]
        values[2][beam[told]] = bright[told]
        values[3][beam] = self.semantic[chosen]
        range_m, back = layers.range_m.copy(), layers.backscatter.copy()
        semantic = layers.semantic.copy()
        range_m[at], back[at] = self.range_m[chosen], self.backscatter[chosen]
        semantic[at] = self.semantic[chosen]
        seen = StaticLayers(layers.start, range_m, back, layers.through, layers.mask, semantic)
        return seen, (level, *values)


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
