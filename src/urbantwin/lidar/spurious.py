"""Spurious returns: echoes of precipitation, fog and stray light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.compiled.return_mode import MODES, settle
from urbantwin.lidar.detections import Detections, Slots, Touching
from urbantwin.lidar.echoes import Echoes
from urbantwin.lidar.returns import Purpose, ReturnModel, draw, standard_noise
from urbantwin.lidar.returns.strays import (
    Source,
    Spill,
    Stray,
    blooms,
    crosstalks,
    is_bright,
    spilled,
    strongest_of,
)
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.static_view import StaticView

__all__ = ["Spurious"]


@dataclass(frozen=True, eq=False)
class Spurious:
    """The spurious returns of one sensor in one turn.

    Attributes:
        mounted: the sensor.
        model: its return model.
        view: the static world as it sees it.
        echoes: echoes in beams that touch actors.
        ring_time_s: (C,) firing time of each channel within its column.
        key: key of the random numbers: seed, sensor, turn and number of beams.
        dead: (N,) beams in an outage; (0,) for none.
    """

    mounted: MountedSensor
    model: ReturnModel
    view: StaticView
    echoes: Echoes
    ring_time_s: NDArray[np.float64]
    key: tuple[int, int, int, int]
    dead: NDArray[np.bool_]

    def added(self) -> tuple[Stray, NDArray[np.float32]]:
        """Return the strongest spurious echo of each beam that has any (A,), and its strength."""
        strays = [self._working(stray) for stray in (*self._air(), *self._stray_light())]
        if not sum(len(stray.beam) for stray in strays):
            nothing = np.zeros(0, np.float32)
            return Stray(np.zeros(0, np.int32), nothing, nothing), nothing
        return strongest_of(
            strays, [self.model.strength(stray.amplitude, stray.range_m) for stray in strays]
        )

    def settle(
        self,
        added: Stray,
        strength: NDArray[np.float32],
        detections: Detections,
        touching: Touching,
        slots: Slots,
    ) -> None:
        """Insert spurious echoes into the detections where the return mode selects them.

        Args:
            added: spurious echoes.
            strength: (A,) their strengths.
            detections: detections of surfaces; changed in place.
            touching: detections in beams that touch actors.
            slots: positions reserved for the echoes.
        """
        if not len(added.beam):
            return
        _, sigma, intensity, _ = self.model.answers(added.amplitude, added.range_m)
        noise = standard_noise(draw(*self.key[:3], len(added.beam), Purpose.ADDED).noise)
        reported = np.zeros(len(added.beam), np.float32)
        met = np.flatnonzero(slots.had)
        reported[met] = self._strength_of(detections, touching, slots.row[met])
        settle(
            detections,
            slots,
            added.range_m,
            strength,
            self.model.quantised(added.range_m + sigma * noise),
            intensity,
            reported,
            MODES.index(self.mounted.returns),
        )

    def _air(self) -> list[Stray]:
        clutter = self.model.clutter
        if clutter is None:
            return []
        # A surface ends the beam; without one its range is 0.
        range_m, start = self.view.answers.first.range_m, self.echoes.start
        limit = np.where(range_m > 0, range_m, np.float32(np.inf))
        has = start[1:] > start[:-1]
        limit[self.echoes.beam[has]] = self.echoes.range_m[start[1:][has] - 1]
        return [Stray(*clutter.draw(draw(*self.key, Purpose.CLUTTER), limit))]

    def _stray_light(self) -> list[Stray]:
        """Return the detected echoes that bright echoes cause in other beams."""
        effects = self.mounted.effects
        if not (effects.blooming or effects.crosstalk):
            return []
        world, own = self._of_world(), self._of_echoes()
        open_ = self.echoes.place[self.view.bright] < 0
        if not (open_.any() or len(own.beam)):
            return []
        beams, strays = self.view.beams, []
        if effects.blooming and beams.rings is not None:
            halo = blooms(
                [
                    (self._spilled(world, self.view.halo).only(open_), world),
                    (self._spilled(own), own),
                ]
            )
            strays.append(self._noticed(halo, Purpose.BLOOMING))
        if effects.crosstalk:
            parts = zip(world, own, strict=True)
            source = Source._make(
                np.concatenate([world_part[open_], own_part]) for world_part, own_part in parts
            )
            ghosts = crosstalks(self.model, self.ring_time_s, beams.columns, source)
            strays.append(self._noticed(ghosts, Purpose.CROSSTALK))
        return strays

    def _spilled(self, source: Source, known: Spill | None = None) -> Spill:
        """Return the stray light of bright echoes, cached for the static world."""
        if known is not None:
            return known
        rings = self.view.beams.rings
        assert rings is not None
        return spilled(self.model, self.mounted.sensor, self.view.beams, rings, source)

    def _of_world(self) -> Source:
        """Return the bright echoes of the static world in all beams."""
        view = self.view
        first = view.answers.first
        return Source(view.bright, first.range_m[view.bright], view.amplitude[view.bright])

    def _of_echoes(self) -> Source:
        """Return the bright echoes in beams that touch actors."""
        echoes = self.echoes
        bright = np.flatnonzero(is_bright(echoes.amplitude))
        place = np.searchsorted(echoes.start, bright, "right") - 1
        return Source(echoes.beam[place], echoes.range_m[bright], echoes.amplitude[bright])

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

    def _strength_of(
        self, detections: Detections, touching: Touching, rows: NDArray[np.int32]
    ) -> NDArray[np.float32]:
        """Return the strengths (K,) of the detections in some rows (K,)."""
        amplitude = self.view.amplitude.take(detections.beam[rows])
        at = np.searchsorted(touching.row, rows)
        touches = at < len(touching.row)
        touches[touches] = touching.row[at[touches]] == rows[touches]
        amplitude[touches] = touching.amplitude[at[touches]]
        return self.model.strength(amplitude, detections.range_m[rows])
