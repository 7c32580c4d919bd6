"""The report: values per frame and in aggregate, beside their controls, and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.definitions import HEADLINE, MEASURES, PUBLISHED

__all__ = [
    "Aggregate",
    "Anchored",
    "FrameFigures",
    "Report",
    "aggregate",
    "anchored",
    "reduction_percent",
]

_RESAMPLES = 1000
#: Names of the headline's measures in a sentence.
_WORDS = {
    "hausdorff_p95_m": "P95 Hausdorff distance",
    "js_mean": "Jensen-Shannon divergence",
    "point_to_mesh_mean_m": "distance to the real surface",
}
_Found = Mapping[str, float | None]


@dataclass(frozen=True)
class Aggregate:
    """A value over frames.

    Attributes:
        mean, median, p95: over the frames in which it is defined.
        mean_ci95: 95 % interval of the mean by bootstrap over frames (percentiles of 1000
            resamples, Efron 1979); None for fewer than two frames. Frames of one recording are
            similar, so the interval is too narrow for other recordings.
        frames: number of frames in which the value is defined.
    """

    mean: float
    median: float
    p95: float
    mean_ci95: tuple[float, float] | None
    frames: int


@dataclass(frozen=True)
class Anchored:
    """Values of the twin with their controls.

    Attributes:
        twin: aggregate of the synthetic against the real frames; None if never defined.
        real_against_real: each real frame against another; None if there is none.
        arbitrary: the control against the real frames; None without a control.
        reduction_percent: ``(1 - twin / arbitrary) * 100`` of the means over the frames that both
            have; None without a control.
        reduction_ci95: its 95 % interval by bootstrap over pairs of frames.
        ratio_to_real: twin over real against real, of the means; None without the latter, or if it
            is 0. At 1 the twin is as near as another real frame.
    """

    twin: dict[str, Aggregate | None]
    real_against_real: dict[str, Aggregate | None] | None
    arbitrary: dict[str, Aggregate | None] | None
    reduction_percent: dict[str, float | None] | None
    reduction_ci95: dict[str, tuple[float, float] | None] | None
    ratio_to_real: dict[str, float | None] | None

    def as_json(self) -> dict[str, Any]:
        """Return the values for ``report.json``."""
        return {
            "aggregate": _plain(self.twin),
            "anchors": {
                "real_against_real": _plain(self.real_against_real),
                "arbitrary": _plain(self.arbitrary),
                "reduction_percent": self.reduction_percent,
                "reduction_percent_ci95": self.reduction_ci95,
                "ratio_to_real": self.ratio_to_real,
            },
        }


@dataclass(frozen=True)
class FrameFigures:
    """One pair of frames: names, points, and values by ``MEASURES``.

    ``parts`` has the values of foreground and background, each by side ("twin", "arbitrary",
    "real").
    """

    real: str
    synthetic: str
    arbitrary: str | None
    points: dict[str, dict[str, int]]
    twin_figures: dict[str, float | None]
    arbitrary_figures: dict[str, float | None] | None
    real_figures: dict[str, float | None] | None
    rebuild: dict[str, Any]
    parts: dict[str, dict[str, dict[str, float | None]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """The results of ``compare``.

    Attributes:
        folders: names of the folders, and their numbers of clouds.
        frames: values of each pair.
        whole: values of whole frames, with their controls.
        parts: the same of foreground and background, if frames are separated.
        split_by: method of the separation: labels or a background model; None without separation.
        objects: statistics of labelled objects by side, and differences.
        foreground_objects: foreground objects of unlabelled sides, and differences
            (`foreground_objects`).
        missing: places where real points have no points of the twin nearby, worst first.
        parameters: bins, thresholds and scales of the measures.
        notes: notes about the input that qualify the values.
        doubts: those of the notes on sides that do not match.
        problems: unreadable frames with the reason.
        protocol: scores of a challenge's protocol, if requested.
    """

    folders: dict[str, dict[str, Any]]
    frames: list[FrameFigures]
    whole: Anchored
    parameters: dict[str, Any]
    parts: dict[str, Anchored] = field(default_factory=dict)
    split_by: str | None = None
    objects: dict[str, Any] | None = None
    foreground_objects: dict[str, Any] | None = None
    missing: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    protocol: dict[str, Any] | None = None

    @property
    def twin(self) -> dict[str, Aggregate | None]:
        """Aggregates of the twin against the real frames, whole."""
        return self.whole.twin

    @property
    def real_against_real(self) -> dict[str, Aggregate | None] | None:
        """Aggregates of each real frame against another, whole."""
        return self.whole.real_against_real

    @property
    def arbitrary(self) -> dict[str, Aggregate | None] | None:
        """Aggregates of the control against the real frames, whole."""
        return self.whole.arbitrary

    @property
    def reduction_percent(self) -> dict[str, float | None] | None:
        """Reduction relative to the control, whole."""
        return self.whole.reduction_percent

    def headline(self) -> dict[str, Any]:
        """Return the headline values, by part and measure."""
        return {
            name: {
                measure: {
                    "twin": _mean(found.twin, measure),
                    "arbitrary": _mean(found.arbitrary, measure),
                    "real_against_real": _mean(found.real_against_real, measure),
                    "reduction_percent": (found.reduction_percent or {}).get(measure),
                    "reduction_percent_ci95": (found.reduction_ci95 or {}).get(measure),
                    "ratio_to_real": (found.ratio_to_real or {}).get(measure),
                    "published": {
                        "twin": PUBLISHED[measure][0],
                        "arbitrary": PUBLISHED[measure][1],
                        "reduction_percent": PUBLISHED[measure][2],
                    },
                }
                for measure in HEADLINE
            }
            for name, found in {"whole": self.whole, **self.parts}.items()
        }

    def in_short(self) -> str:
        """Return the headline as one sentence: whole frames, with both controls."""
        found = self.headline()["whole"]
        given = {name: row for name, row in found.items() if row["twin"] is not None}
        less = [
            f"its {_WORDS[name]} is {_less(row['reduction_percent'])} "
            f"({_figure(name, row['twin'])} against {_figure(name, row['arbitrary'])})"
            for name, row in given.items()
            if row["reduction_percent"] is not None
        ]
        plain = [f"{_WORDS[name]} is {_figure(name, row['twin'])}" for name, row in given.items()]
        said = (
            f"The twin beside an arbitrary site: {_listed(less)}"
            if less
            else f"The twin alone: its {_listed(plain)}"
        )
        ratios = [row["ratio_to_real"] for row in given.values()]
        times = [f"{ratio:.2g}" for ratio in ratios if ratio is not None]
        if times:
            said += f"; {_listed(times)} times that of one real frame beside the next"
        return said + "."

    def worst(self, measure: str = "hausdorff_p95_m") -> list[int]:
        """Return the indices of the pairs, the one with the largest value first."""
        found = [
            (index, frame.twin_figures.get(measure)) for index, frame in enumerate(self.frames)
        ]
        given = [(-value, index) for index, value in found if value is not None]
        return [index for _, index in sorted(given)]

    def as_json(self) -> dict[str, Any]:
        """Return the content of ``report.json``: finite numbers, or null where undefined."""
        return {
            "kind": "report",
            "version": 2,
            "folders": self.folders,
            "notes": self.notes,
            "doubts": self.doubts,
            "problems": self.problems,
            "in_short": self.in_short(),
            "headline": self.headline(),
            **self.whole.as_json(),
            "split_by": self.split_by,
            "parts": {name: found.as_json() for name, found in self.parts.items()},
            "objects": self.objects,
            "foreground_objects": self.foreground_objects,
            "missing": self.missing,
            "protocol": self.protocol,
            "definitions": {
                name: {"unit": m.unit or "1", "definition": m.definition, "source": m.source}
                for name, m in MEASURES.items()
            },
            "parameters": self.parameters,
            "worst": [self.frames[index].real for index in self.worst()[:10]],
            "frames": [asdict(frame) for frame in self.frames],
        }


def anchored(
    twin: Sequence[_Found | None],
    arbitrary: Sequence[_Found | None],
    real: Sequence[_Found | None],
) -> Anchored:
    """Return aggregates of values of the same pairs, None where a pair lacks one."""
    neighbours = [found for found in real if found is not None]
    control = [found for found in arbitrary if found is not None]
    mine = aggregate([found for found in twin if found is not None])
    nearest = aggregate(neighbours) if neighbours else None
    return Anchored(
        twin=mine,
        real_against_real=nearest,
        arbitrary=aggregate(control) if control else None,
        reduction_percent=reduction_percent(twin, arbitrary) if control else None,
        reduction_ci95=_reduction_interval(twin, arbitrary) if control else None,
        ratio_to_real=_ratios(mine, nearest) if nearest else None,
    )


def aggregate(figures: Sequence[_Found]) -> dict[str, Aggregate | None]:
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
    twin: Sequence[_Found | None], arbitrary: Sequence[_Found | None]
) -> dict[str, float | None]:
    """Return ``(1 - twin / arbitrary) * 100`` of the means over the frames that both have.

    None if either is undefined, or if the control is 0.
    """
    found: dict[str, float | None] = {}
    for name in MEASURES:
        ours, control = _pairs(twin, arbitrary, name)
        some = len(ours) > 0 and control.mean() > 0
        found[name] = float(1 - ours.mean() / control.mean()) * 100 if some else None
    return found


def _pairs(
    twin: Sequence[_Found | None], arbitrary: Sequence[_Found | None], name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a measure of the twin and the control over the frames in which both have it."""
    both = [
        (a[name], b[name])
        for a, b in zip(twin, arbitrary, strict=False)
        if a is not None and b is not None
        if a.get(name) is not None and b.get(name) is not None
    ]
    ours, control = np.array(both, np.float64).reshape(-1, 2).T
    return ours, control


def _reduction_interval(
    twin: Sequence[_Found | None], arbitrary: Sequence[_Found | None]
) -> dict[str, tuple[float, float] | None]:
    found: dict[str, tuple[float, float] | None] = {}
    for name in MEASURES:
        ours, control = _pairs(twin, arbitrary, name)
        found[name] = None
        if len(ours) < 2:
            continue
        rows = _resampled(len(ours))
        below = control[rows].mean(axis=1)
        if below.min() > 0:
            reductions = (1 - ours[rows].mean(axis=1) / below) * 100
            low, high = np.percentile(reductions, [2.5, 97.5])
            found[name] = float(low), float(high)
    return found


def _ratios(
    twin: Mapping[str, Aggregate | None], real: Mapping[str, Aggregate | None]
) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name in MEASURES:
        a, b = twin[name], real[name]
        found[name] = a.mean / b.mean if a and b and b.mean > 0 else None
    return found


def _resampled(count: int) -> NDArray[np.int64]:
    generator = np.random.Generator(np.random.Philox(key=0))
    return generator.integers(0, count, (_RESAMPLES, count))


def _interval(values: NDArray[np.float64]) -> tuple[float, float] | None:
    if len(values) < 2:
        return None
    low, high = np.percentile(values[_resampled(len(values))].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def _figure(name: str, value: float) -> str:
    unit = MEASURES[name].unit
    return f"{value:.3g}" + (f" {unit}" if unit else "")


def _less(percent: float) -> str:
    # Values below 100 % are not rounded up to it.
    share = f"{min(percent, 99.9):.1f}" if 99.5 <= percent < 100 else f"{abs(percent):.0f}"
    return f"{share} % {'less' if percent >= 0 else 'more'}"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def _mean(found: Mapping[str, Aggregate | None] | None, name: str) -> float | None:
    value = found.get(name) if found else None
    return value.mean if value else None


def _plain(found: Mapping[str, Aggregate | None] | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {name: None if value is None else asdict(value) for name, value in found.items()}
