"""Points that stand on nothing: echoes of the air and of stray light, among those of surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.echoes import Echoes
from urbantwin.lidar.mounted import MountedSensor
from urbantwin.lidar.returns import Purpose, ReturnModel, draw, standard_noise
from urbantwin.lidar.returns.added import inserted, strongest_of
from urbantwin.lidar.returns.strays import Stray, blooms, crosstalks, is_bright
from urbantwin.lidar.static_view import StaticView
from urbantwin.taxonomy import semantic_id

__all__ = ["Reported", "Spurious"]

#: Points of rain, snow, fog and stray light are nobody's: SemanticKITTI's class for them.
_CLASS = semantic_id("outlier")


class Reported(NamedTuple):
    """M reported points in the order of their beams.

    Attributes:
        beam: (M,) int32.
        echo: (M,) uint8, number among those of its beam.
        source: (M,) int32: -1 for the static world, else the number of the echo.
        semantic: (M,) uint16.
        range_m: (M,) float32, as measured.
        intensity: (M,) float32.
        actor: (M,) int32, -1 for none.
    """

    beam: NDArray[np.int32]
    echo: NDArray[np.uint8]
    source: NDArray[np.int32]
    semantic: NDArray[np.uint16]
    range_m: NDArray[np.float32]
    intensity: NDArray[np.float32]
    actor: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Spurious:
    """What one sensor reports in one turn besides surfaces.

    Attributes:
        mounted: the sensor.
        model: what it makes of echoes.
        view: the static world as it sees it.
        echoes: of beams that touch actors; ``None``: none does.
        ring_time_s: (C,) when each channel fires within its column.
        key: seed, sensor, turn and number of beams: of the random numbers.
        dead: (N,) beams that report nothing; or none at all.
    """

    mounted: MountedSensor
    model: ReturnModel
    view: StaticView
    echoes: Echoes | None
    ring_time_s: NDArray[np.float64]
    key: tuple[int, int, int, int]
    dead: NDArray[np.bool_]

    def among(self, reported: Reported) -> Reported:
        """Return the points of surfaces with these among them, where they win."""
        strays = [*self._air(), *self._stray_light()]
        strays = [self._working(one) for one in strays]
        if not sum(len(one.beam) for one in strays):
            return reported
        strength = [self.model.strength(one.amplitude, one.range_m) for one in strays]
        added, strong = strongest_of(strays, strength)
        out = inserted(
            reported.beam,
            reported.range_m,
            self._strength_of(reported, added.beam),
            added,
            strong,
            self.mounted.returns,
        )
        _, sigma, intensity = self.model.answers(added.amplitude, added.range_m)
        noise = standard_noise(draw(*self.key[:3], len(added.beam), Purpose.ADDED).noise)
        range_m = self.model.quantised(added.range_m + sigma * noise)
        count = len(added.beam)
        none = np.full(count, -1, np.int32)
        rows = (
            np.concatenate([reported.beam, added.beam]),
            np.concatenate([reported.source, none]),
            np.concatenate([reported.semantic, np.full(count, _CLASS, np.uint16)]),
            np.concatenate([reported.range_m, range_m]),
            np.concatenate([reported.intensity, intensity]),
            np.concatenate([reported.actor, none]),
        )
        beam, source, semantic, range_m, intensity, actor = (row.take(out.order) for row in rows)
        return Reported(beam, out.echo, source, semantic, range_m, intensity, actor)

    def _air(self) -> list[Stray]:
        clutter = self.model.clutter
        if clutter is None:
            return []
        # What is hit ends a beam; where nothing is, its range is 0.
        at = self.view.report[1]
        limit = np.where(at > 0, at, np.float32(np.inf))
        if self.echoes is not None:
            start = self.echoes.start
            has = start[1:] > start[:-1]
            limit[self.echoes.beam[has]] = self.echoes.range_m[start[1:][has] - 1]
        return [Stray(*clutter.draw(draw(*self.key, Purpose.CLUTTER), limit))]

    def _stray_light(self) -> list[Stray]:
        """Return what bright echoes cause in other beams, where it is noticed."""
        effects = self.mounted.effects
        if not (effects.blooming or effects.crosstalk):
            return []
        source = self._bright()
        if not len(source[0]):
            return []
        beams, found = self.view.beams, []
        if effects.blooming and beams.rings is not None:
            lie = beams.rings
            own = np.argsort(lie.order)
            rings = (lie.elevation[own], lie.azimuth[own], lie.turn * lie.step, beams.columns)
            halo = blooms(self.model, self.mounted.sensor, beams.directions, rings, source)
            found.append(self._noticed(halo, Purpose.BLOOMING))
        if effects.crosstalk:
            ghosts = crosstalks(self.model, self.ring_time_s, beams.columns, source)
            found.append(self._noticed(ghosts, Purpose.CROSSTALK))
        return found

    def _bright(self) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
        """Return beam, range and amplitude of echoes that can cause others."""
        view = self.view
        beam, amplitude = view.bright, view.amplitude
        if self.echoes is None:
            return beam, view.report[1][beam], amplitude[beam]
        touched = np.zeros(len(amplitude), np.bool_)
        touched[self.echoes.beam] = True
        beam = beam[~touched[beam]]
        echo = np.flatnonzero(is_bright(self.echoes.amplitude))
        place = np.searchsorted(self.echoes.start, echo, "right") - 1
        return (
            np.concatenate([beam, self.echoes.beam[place]]),
            np.concatenate([view.report[1][beam], self.echoes.range_m[echo]]),
            np.concatenate([amplitude[beam], self.echoes.amplitude[echo]]),
        )

    def _noticed(self, stray: Stray, purpose: Purpose) -> Stray:
        if not len(stray.beam):
            return stray
        level = self.model.noticed_level(stray.amplitude, stray.range_m)
        drawn = draw(*self.key[:3], len(stray.beam), purpose).detection
        return stray.only(drawn < level)

    def _working(self, stray: Stray) -> Stray:
        if not len(self.dead):
            return stray
        return stray.only(~self.dead[stray.beam])

    def _strength_of(self, reported: Reported, where: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return strengths (M,) of what is reported; 0 but along the beams asked for."""
        asked = np.zeros(len(self.view.amplitude), np.bool_)
        asked[where] = True
        row = np.flatnonzero(asked[reported.beam])
        amplitude = self.view.amplitude.take(reported.beam[row])
        if self.echoes is not None:
            source = reported.source[row]
            amplitude[source >= 0] = self.echoes.amplitude[source[source >= 0]]
        strength = np.zeros(len(reported.beam), np.float32)
        strength[row] = self.model.strength(amplitude, reported.range_m[row])
        return strength
