"""The report: figures per frame and in aggregate, beside their anchors, and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.measure import MEASURES

__all__ = ["Aggregate", "FrameFigures", "Report", "aggregate", "reduction_percent"]

_RESAMPLES = 1000


@dataclass(frozen=True)
class Aggregate:
    """A figure over frames.

    Attributes:
        mean, median, p95: over the frames in which it is defined.
        mean_ci95: 95 % interval of the mean by bootstrap over frames (percentiles of 1000
            resamples, Efron 1979); None for fewer than two frames. Frames of one recording
            resemble each other, so the interval is narrower than that of another recording.
        frames: in how many frames the figure is defined.
    """

    mean: float
    median: float
    p95: float
    mean_ci95: tuple[float, float] | None
    frames: int


@dataclass(frozen=True)
class FrameFigures:
    """One pair of frames: names of the files, their points, and figures by ``MEASURES``."""

    real: str
    synthetic: str
    arbitrary: str | None
    points: dict[str, dict[str, int]]
    twin_figures: dict[str, float | None]
    arbitrary_figures: dict[str, float | None] | None
    real_figures: dict[str, float | None] | None
    rebuild: dict[str, Any]


@dataclass(frozen=True)
class Report:
    """What ``compare`` found.

    Attributes:
        folders: names of the folders, and how many clouds each holds.
        frames: figures of each pair.
        twin: aggregate of the synthetic against the real frames; None where never defined.
        real_against_real: each real frame against the next; None for fewer than two.
        arbitrary: the control against the real frames; None without a control.
        reduction_percent: ``(1 - twin / arbitrary) * 100`` of the means over the frames that
            both have; None without a control.
        parameters: bins, thresholds and scales that the figures depend on.
        notes: what a reader must know about the input.
    """

    folders: dict[str, dict[str, Any]]
    frames: list[FrameFigures]
    twin: dict[str, Aggregate | None]
    real_against_real: dict[str, Aggregate | None] | None
    arbitrary: dict[str, Aggregate | None] | None
    reduction_percent: dict[str, float | None] | None
    parameters: dict[str, Any]
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return the content of ``report.json``: finite numbers, or null where undefined."""
        return {
            "kind": "report",
            "version": 1,
            "folders": self.folders,
            "notes": self.notes,
            "aggregate": _plain(self.twin),
            "anchors": {
                "real_against_real": _plain(self.real_against_real),
                "arbitrary": _plain(self.arbitrary),
                "reduction_percent": self.reduction_percent,
            },
            "definitions": {
                name: {"unit": m.unit or "1", "definition": m.definition, "source": m.source}
                for name, m in MEASURES.items()
            },
            "parameters": self.parameters,
            "frames": [asdict(frame) for frame in self.frames],
        }


def aggregate(figures: Sequence[Mapping[str, float | None]]) -> dict[str, Aggregate | None]:
    """Return the aggregate over frames of every measure; None where no frame defines it."""
    found: dict[str, Aggregate | None] = {}
    for name in MEASURES:
        values = np.array([f[name] for f in figures if f.get(name) is not None], np.float64)
        if not len(values):
            found[name] = None
            continue
        median, p95 = np.percentile(values, [50, 95])
        found[name] = Aggregate(
            mean=float(values.mean()),
            median=float(median),
            p95=float(p95),
            mean_ci95=_interval(values),
            frames=len(values),
        )
    return found


def reduction_percent(
    twin: Sequence[Mapping[str, float | None]], arbitrary: Sequence[Mapping[str, float | None]]
) -> dict[str, float | None]:
    """Return ``(1 - twin / arbitrary) * 100`` of the means over the frames that both have.

    None where either is undefined, or where the control itself is 0.
    """
    common = min(len(twin), len(arbitrary))
    ours, control = aggregate(twin[:common]), aggregate(arbitrary[:common])
    found: dict[str, float | None] = {}
    for name in MEASURES:
        a, b = ours[name], control[name]
        found[name] = (1 - a.mean / b.mean) * 100 if a and b and b.mean > 0 else None
    return found


def _interval(values: NDArray[np.float64]) -> tuple[float, float] | None:
    if len(values) < 2:
        return None
    generator = np.random.Generator(np.random.Philox(key=0))
    means = values[generator.integers(0, len(values), (_RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def _plain(found: Mapping[str, Aggregate | None] | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {name: None if value is None else asdict(value) for name, value in found.items()}
