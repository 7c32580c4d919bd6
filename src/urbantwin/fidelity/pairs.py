"""Pairs of frames, measured one after the other or by several processes."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.measure import BACKGROUND, FOREGROUND, Measured, RealFrame
from urbantwin.fidelity.missing import without_surface
from urbantwin.fidelity.report import FrameFigures
from urbantwin.fidelity.sampling import evenly
from urbantwin.fidelity.sides import ANCHOR, Side
from urbantwin.processes import usable_processors, worker_pool

if TYPE_CHECKING:
    from urbantwin.reconstruct.recording.recorded_ground import RecordedGround

__all__ = ["MOST_ANCHORS", "MeasuredPair", "Pairs", "measured_pairs"]

#: Maximum number of pairs at which the controls are measured, spread evenly.
MOST_ANCHORS = 30
#: Below this number of points, one process is faster than starting workers.
_WORTH_WORKERS = 2_000_000


@dataclass(frozen=True, eq=False)
class MeasuredPair:
    """The results of one pair.

    Attributes:
        index: index of the pair.
        figures: measured values.
        binned: histograms by side ("real", "synthetic", "arbitrary") and name.
        missing: (K, 4) real points without a surface of the twin (`missing.without_surface`).
        objects: foreground objects (K, 6) by side ("real", "synthetic", "anchor"), see
            `foreground_objects.objects_of`.
    """

    index: int
    figures: FrameFigures
    binned: dict[str, dict[str, NDArray[np.float64]]]
    missing: NDArray[np.float64]
    objects: dict[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Pairs:
    """The pairs of a comparison, which can be measured independently.

    Attributes:
        sides: "real", "synthetic"; with a control, "arbitrary"; and with other real frames for real
            against real, "anchor".
        origin: (3,) position of the sensor in the frame of the points, metres.
        split_by: how foreground is separated from background (`Side.foreground`).
        ground: ground under the foreground objects; None: objects are not measured.
    """

    sides: dict[str, Side]
    origin: NDArray[np.float64]
    split_by: str | None
    ground: RecordedGround | None = None

    def __len__(self) -> int:
        """Return the number of pairs."""
        return min(self.sides["real"].count, self.sides["synthetic"].count)

    @cached_property
    def anchors(self) -> dict[int, int]:
        """Pairs at which controls are measured: index -> number of the arbitrary frame."""
        return {index: number for number, index in enumerate(evenly(len(self), MOST_ANCHORS))}

    def frames(self, index: int) -> dict[str, Frame]:
        """Return the readable frames of a pair by side."""
        number = {"real": index, "synthetic": index, "arbitrary": self.anchors.get(index)}
        found = {
            name: side.read(at)
            for name, side in self.sides.items()
            if (at := number.get(name)) is not None
        }
        return {name: frame for name, frame in found.items() if frame is not None}

    def _real_again(self, index: int) -> tuple[Side, Frame | None]:
        """Return the other real frame of a pair: of the anchor, or the next one."""
        anchor = self.sides.get(ANCHOR)
        if anchor is not None:
            return anchor, anchor.read(index % max(anchor.count, 1))
        real = self.sides["real"]
        return real, real.read(index + 1)

    def measure(self, index: int) -> MeasuredPair | None:
        """Measure a pair, with the controls if due; None if either frame is unreadable."""
        frames = self.frames(index)
        if "real" not in frames or "synthetic" not in frames:
            return None
        real = self.sides["real"]
        actors = real.foreground(frames["real"], self.split_by)
        frame = RealFrame(
            frames["real"], foreground=actors, intensity_scale=real.scale, origin=self.origin
        )

        objects: dict[str, NDArray[np.float64]] = {}

        def against(side: Side, other: Frame | None) -> Measured | None:
            if other is None:
                return None
            mask = side.foreground(other, self.split_by)
            self._look_for_objects(objects, side.name, other, mask)
            return frame.measure(other, foreground=mask, intensity_scale=side.scale)

        twin = against(self.sides["synthetic"], frames["synthetic"])
        measured = {
            "twin": twin,
            "arbitrary": against(self.sides["arbitrary"], frames["arbitrary"])
            if "arbitrary" in frames
            else None,
            "real": against(*self._real_again(index)) if index in self.anchors else None,
        }
        self._look_for_objects(objects, real.name, frames["real"], actors)
        binned = {"real": frame.histograms.binned}
        for side, name in (("synthetic", "twin"), ("arbitrary", "arbitrary")):
            one = measured[name]
            if one is not None:
                binned[side] = one.histograms.binned
        assert twin is not None
        missing = without_surface(
            frames["real"].points, twin.missing, self.origin, actors, frames["synthetic"].points
        )
        return MeasuredPair(index, _figures(frame, frames, measured), binned, missing, objects)

    def _look_for_objects(
        self,
        found: dict[str, NDArray[np.float64]],
        side: str,
        frame: Frame,
        actors: NDArray[np.bool_] | None,
    ) -> None:
        if self.ground is not None and actors is not None and side != "arbitrary":
            from urbantwin.fidelity.foreground_objects import objects_of

            found[side] = objects_of(frame.points[actors], self.ground)


def measured_pairs(pairs: Pairs, workers: int | None) -> Iterator[MeasuredPair | None]:
    """Measure all pairs and yield them in order; the results do not depend on the workers.

    Args:
        pairs: the pairs to measure.
        workers: number of processes; by default one per processor if that is faster. With 1, pairs
            are measured in this process.

    Raises:
        StageError: a worker was killed.
    """
    if workers is None:
        points = sum(side.points for side in pairs.sides.values())
        workers = usable_processors() if points >= _WORTH_WORKERS else 1
    workers = min(workers, len(pairs))
    if workers == 1:
        yield from map(pairs.measure, range(len(pairs)))
        return
    try:
        with worker_pool(workers, _start, pairs) as pool:
            for future in [pool.submit(_measure, index) for index in range(len(pairs))]:
                yield future.result()
    except BrokenProcessPool:
        raise StageError(
            "a worker was killed (out of memory?): try it with fewer workers"
        ) from None


_pairs: Pairs | None = None


def _start(pairs: Pairs) -> None:
    global _pairs  # noqa: PLW0603 - a worker's only state
    _pairs = pairs


def _measure(index: int) -> MeasuredPair | None:
    assert _pairs is not None
    return _pairs.measure(index)


def _figures(
    frame: RealFrame, shown: dict[str, Frame], measured: dict[str, Measured | None]
) -> FrameFigures:
    error = frame.surface.rebuild_error
    whole = {name: None if one is None else one.figures for name, one in measured.items()}
    return FrameFigures(
        real=shown["real"].name,
        synthetic=shown["synthetic"].name,
        arbitrary=shown["arbitrary"].name if "arbitrary" in shown else None,
        points={
            side: {
                "compared": len(one.points),
                "not_finite": one.not_finite,
                "no_return": one.no_return,
            }
            for side, one in shown.items()
        },
        twin_figures=whole["twin"] or {},
        arbitrary_figures=whole["arbitrary"],
        real_figures=whole["real"],
        rebuild={
            "triangles": frame.surface.surface.triangles,
            "covered": frame.surface.surface.covered,
            "held_out_mean_m": error.mean if error else None,
            "held_out_median_m": error.median if error else None,
            "held_out_p95_m": error.p95 if error else None,
        },
        parts={
            part: {
                name: one.parts[part]
                for name, one in measured.items()
                if one is not None and part in one.parts
            }
            for part in (FOREGROUND, BACKGROUND)
        },
    )
