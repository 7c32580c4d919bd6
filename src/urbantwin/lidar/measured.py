"""The static world as a real sensor measured it, beam by beam, in place of the modelled one."""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.lidar.returns.draws import LEVELS
from urbantwin.lidar.static import StaticLayers

if TYPE_CHECKING:
    from urbantwin.lidar.mounted import Rig
    from urbantwin.lidar.returns import ReturnModel
    from urbantwin.site.rig import Effects

__all__ = ["MeasuredBackground", "with_background"]

_NAMES = ("range_m", "sigma_m", "returned", "intensity")
#: Of what nothing says how bright it is: a middling street.
_BACKSCATTER = 0.1
#: A modelled surface this near to the measured range is what was measured, metres.
_SAME_M = 1.0


@dataclass(frozen=True, eq=False)
class MeasuredBackground:
    """What each beam of a fixed sensor finds when nothing moves before it.

    Attributes:
        range_m: (C, K) float32, metres; 0 where nothing came back.
        sigma_m: (C, K) float32, standard deviation of the range, metres.
        returned: (C, K) float32, share of the unobstructed looks that came back from there.
        intensity: (C, K) float32, 0 to 1; nan where nobody knows.
        fused: beams without a measured range see the modelled scene, in place of nothing.
    """

    range_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    returned: NDArray[np.float32]
    intensity: NDArray[np.float32]
    fused: bool = False

    def save(self, path: Path) -> None:
        """Write it as an ``.npz``; the file appears whole or not at all."""
        scratch = path.with_name(f".{path.name}.part.npz")
        np.savez_compressed(scratch, **{name: getattr(self, name) for name in _NAMES})
        scratch.replace(path)

    @classmethod
    def load(cls, path: Path, *, fused: bool = False) -> MeasuredBackground:
        """Read it.

        Raises:
            InputError: missing, damaged, or not four images of one size with values in bounds.
        """
        expected = "a background that urbantwin measured"
        try:
            with np.load(path, allow_pickle=False) as file:
                images = [np.asarray(file[name], np.float32) for name in _NAMES]
        except FileNotFoundError:
            raise InputError("not found", file=path, expected=expected) from None
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(f"is not readable ({error})", file=path, expected=expected) from None
        range_m, sigma_m, returned, intensity = images
        if range_m.ndim != 2 or any(one.shape != range_m.shape for one in images):
            raise InputError("holds images of different sizes", file=path, expected=expected)
        for name, values, most in (
            ("range_m", range_m, 2000.0),
            ("sigma_m", sigma_m, 100.0),
            ("returned", returned, 1.0),
        ):
            if not ((values >= 0) & (values <= most)).all():
                raise InputError(
                    "has a value out of bounds",
                    file=path,
                    place=name,
                    expected=f"0 to {most:g}",
                )
        return cls(range_m, sigma_m, returned, intensity, fused)

    @property
    def sha256(self) -> str:
        """The hash of all its values: what a recipe knows it by."""
        digest = hashlib.sha256(repr((self.range_m.shape, self.fused)).encode())
        for name in _NAMES:
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        return digest.hexdigest()

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which beams (N,) have a measured range."""
        return ((self.range_m > 0) & (self.returned > 0)).ravel()

    def layers(self, modelled: StaticLayers, model: ReturnModel, rays: int) -> StaticLayers:
        """Return what beams meet: one surface at the measured range, or as the model says.

        Its class is that of the modelled surface within a metre, else unlabelled; its backscatter
        what gives the measured intensity, else the modelled surface's.

        Args:
            modelled: what they meet in the modelled scene.
            model: what the sensor makes of echoes.
            rays: how many a beam is made of.
        """
        known, count = self.known, len(modelled.start) - 1
        beam = np.repeat(np.arange(count), np.diff(modelled.start))
        kept = ~known[beam] if self.fused else np.zeros(len(beam), np.bool_)
        mine = np.flatnonzero(known)
        # What this unit adds to every range is in the measured ones already.
        range_m = np.maximum(self.range_m.ravel()[mine] - model.offset_m, 1e-3)
        semantic, back = _beside(modelled, beam, mine, range_m)
        intensity = self.intensity.ravel()[mine]
        told = np.isfinite(intensity)
        amplitude = np.geomspace(1e-4, 100.0, 2000).astype(np.float32)
        reported = np.maximum.accumulate(model.intensity(amplitude))
        back[told] = np.interp(intensity[told], reported, amplitude)
        # It did come back, however weak the model takes it for.
        one = model.strength(np.ones(len(mine), np.float32), range_m)
        back = np.maximum(back, (1.0 / np.maximum(one, 1e-6)).astype(np.float32))
        order = np.argsort(np.concatenate([beam[kept], mine]), kind="stable")
        number = np.concatenate([beam[kept], mine])
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
            share = np.minimum(self.returned.ravel() / max(1.0 - missing, 1e-6), 1.0)
            share = np.rint(share * LEVELS).astype(np.int32)
            level = np.where(known, share, level)
        if effects.noise:
            sigma = np.where(known, self.sigma_m.ravel(), sigma)
        told = known & np.isfinite(self.intensity.ravel())
        intensity = np.where(told, self.intensity.ravel(), intensity)
        return level, range_m, sigma, intensity, amplitude


def with_background(
    rig: Rig, measured: MeasuredBackground, *, file: str | Path | None = None
) -> Rig:
    """Return a rig of one standing sensor that sees a measured background.

    Raises:
        InputError: it has several sensors, rides or sways, its pattern does not repeat, or the
            background is another sensor's.
    """
    (one, *more) = rig.sensors
    channels, columns = measured.range_m.shape
    if more or rig.ride is not None or one.sway is not None or one.sensor.pattern is not None:
        raise InputError(
            "is of one sensor that stands still, and the rig is not",
            file=file,
            expected="a rig of one sensor without ride or sway, whose beams repeat",
        )
    if (channels, columns) != (one.sensor.channels, one.columns):
        raise InputError(
            f"has {channels} channels by {columns} columns",
            file=file,
            expected=f"{one.sensor.channels} by {one.columns}, as {one.name} has",
        )
    return replace(rig, sensors=(replace(one, measured=measured),))


def _beside(
    modelled: StaticLayers,
    beam: NDArray[np.int64],
    mine: NDArray[np.int64],
    range_m: NDArray[np.float32],
) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Return class and backscatter of the modelled surfaces nearest to measured ranges."""
    at = np.zeros(len(modelled.start) - 1, np.float32)
    at[mine] = range_m
    away = np.abs(modelled.range_m - at[beam])
    order = np.lexsort((away, beam))
    first = order[np.unique(beam[order], return_index=True)[1]]
    near = first[away[first] < _SAME_M]
    semantic = np.zeros(len(at), np.uint16)
    back = np.full(len(at), _BACKSCATTER, np.float32)
    semantic[beam[near]] = modelled.semantic[near]
    back[beam[near]] = modelled.backscatter[near]
    return semantic[mine], back[mine]
