"""Blooming and crosstalk: stray echoes of retroreflectors.

A retroreflector returns hundreds of times as much light as white paper; a small part of it,
scattered by the optics, is enough for a detection:

- **Blooming**: around a sign or a plate neighbouring beams report a halo at its distance. Scatter
  of polished optics falls with a power of the angle, of 1 to 3 (Harvey and Shack; Fest 2013, Stray
  Light Analysis and Control, SPIE PM229, chapter 4). No maker publishes power or level: we take 3,
  and `SKIRT` of the light at one beam width, which makes halos of half a degree around a sign at 15
  m for an OS1.
- **Crosstalk**: channels that fire at the same time see `ISOLATION` of each other's light (40 dB);
  an assumption too, and off by default.

Only echoes brighter than white, and strong enough, cause either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.beams import Beams, Rings
from urbantwin.lidar.compiled.response import strengths
from urbantwin.lidar.compiled.strays import crosstalk, spill
from urbantwin.lidar.returns.clutter import CELL_M
from urbantwin.lidar.returns.model import ReturnModel
from urbantwin.lidar.sensor import Sensor

__all__ = [
    "ISOLATION",
    "SKIRT",
    "Source",
    "Spill",
    "Stray",
    "blooms",
    "crosstalks",
    "is_bright",
    "spilled",
    "strongest_of",
]


def strongest_of(strays: list[Stray], strength: list[Floats]) -> tuple[Stray, Floats]:
    """Return the strongest spurious echo of every beam with any, and its strength.

    Args:
        strays: echoes, possibly several per beam.
        strength: their strengths.
    """
    beam = np.concatenate([stray.beam for stray in strays])
    strong = np.concatenate(strength)
    range_m = np.concatenate([stray.range_m for stray in strays])
    amplitude = np.concatenate([stray.amplitude for stray in strays])
    order = np.argsort(beam, kind="stable")
    own = np.flatnonzero(np.diff(beam[order], prepend=-1) > 0)
    if len(own) < len(beam):
        best = np.repeat(np.maximum.reduceat(strong[order], own), np.diff(own, append=len(beam)))
        order = order[strong[order] == best]
        order = order[np.diff(beam[order], prepend=-1) > 0]  # of equals the first
    return Stray(beam[order], range_m[order], amplitude[order]), strong[order]


#: Share of the light in a beam one beam width away.
SKIRT = 3e-4
#: Share of the light between channels that fire together.
ISOLATION = 1e-4
#: Strength below which stray light is neglected: ten such shares are detected once in a thousand
#: echoes.
_FLOOR = 0.02

Floats = NDArray[np.float32]
Whole = NDArray[np.int32]


class Source(NamedTuple):
    """B bright echoes.

    Attributes:
        beam: (B,) int32.
        range_m: (B,) float32.
        amplitude: (B,) float32.
    """

    beam: Whole
    range_m: Floats
    amplitude: Floats


class Spill(NamedTuple):
    """Stray light of bright echoes in other beams, grouped by source.

    Attributes:
        beam: (S,) int32, receiving beam.
        source: (S,) int32, index of the bright echo.
        amplitude: (S,) float32.
    """

    beam: Whole
    source: Whole
    amplitude: Floats

    def only(self, sources: NDArray[np.bool_]) -> Spill:
        """Return the stray light of some of the sources (B,)."""
        which = sources.take(self.source)
        return Spill(self.beam[which], self.source[which], self.amplitude[which])


class Stray(NamedTuple):
    """S echoes caused by stray light.

    Attributes:
        beam: (S,) int32, receiving beam.
        range_m: (S,) float32.
        amplitude: (S,) float32.
    """

    beam: Whole
    range_m: Floats
    amplitude: Floats

    def only(self, which: NDArray[np.bool_]) -> Stray:
        """Return a subset."""
        return Stray(self.beam[which], self.range_m[which], self.amplitude[which])


def is_bright(amplitude: Floats) -> NDArray[np.bool_]:
    """Return which echoes (N,) can cause stray ones."""
    return amplitude > 1.0


def spilled(
    model: ReturnModel,
    sensor: Sensor,
    beams: Beams,
    rings: Rings,
    source: Source,
) -> Spill:
    """Return the stray light of bright echoes in the beams around them.

    Args:
        model: return model of the sensor.
        sensor: a spinning sensor.
        beams: its beams.
        rings: its channels by elevation.
        source: bright echoes.
    """
    width = float(np.sqrt(np.prod(np.radians(sensor.assumed_divergence_deg))))
    strength = _strengths(model, source)
    by_channel = np.argsort(rings.order)
    ordered = rings._replace(
        elevation=rings.elevation[by_channel], azimuth=rings.azimuth[by_channel]
    )
    skirt = (SKIRT, width)
    return _written(
        lambda out: spill(
            source, strength, beams.directions, ordered, beams.columns, skirt, _FLOOR, out
        )
    )


def blooms(spills: Sequence[tuple[Spill, Source]]) -> Stray:
    """Return the halo of bright echoes, from the stray light of each."""
    return _added_up(
        np.concatenate([spill.beam for spill, _ in spills]),
        np.concatenate([source.range_m.take(spill.source) for spill, source in spills]),
        np.concatenate([spill.amplitude for spill, _ in spills]),
    )


def crosstalks(
    model: ReturnModel,
    ring_time_s: NDArray[np.float64],
    columns: int,
    source: Source,
) -> Stray:
    """Return the stray echoes of bright ones in channels that fire at the same time.

    Args:
        model: return model of the sensor.
        ring_time_s: (C,) firing time of each channel within its column.
        columns: columns per turn.
        source: bright echoes.
    """
    strength = _strengths(model, source)
    spill_out = _written(
        lambda out: crosstalk(source, strength, ring_time_s, columns, ISOLATION, _FLOOR, out)
    )
    return _added_up(spill_out.beam, source.range_m.take(spill_out.source), spill_out.amplitude)


def _strengths(model: ReturnModel, source: Source) -> Floats:
    """Return strengths (B,) without sunlight: other channels look elsewhere."""
    strength = np.empty(len(source.beam), np.float32)
    dark = np.zeros(1, np.float32)
    strengths(model.response, source.amplitude, source.range_m, dark, strength)
    return strength


def _written(write: Callable[[Spill], int]) -> Spill:
    """Call a function that fills an output, again with more room if it asks for it."""
    room = 1 << 16
    while True:
        out = Spill(np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.float32))
        used = write(out)
        if used <= room:
            return Spill._make(part[:used] for part in out)
        room = used


def _added_up(beam: Whole, range_m: Floats, amplitude: Floats) -> Stray:
    """Sum what arrives in a beam within a pulse length."""
    if not len(beam):
        return Stray(beam, range_m, amplitude)
    order = np.lexsort((range_m, beam))
    beam, range_m, amplitude = beam[order], range_m[order], amplitude[order]
    apart = (np.diff(beam) > 0) | (np.diff(range_m) > CELL_M)
    first = np.concatenate([[0], np.flatnonzero(apart) + 1])
    total = np.add.reduceat(amplitude, first)
    mean = np.add.reduceat(amplitude * range_m, first) / total
    return Stray(beam[first], mean.astype(np.float32), total)
