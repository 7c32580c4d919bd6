"""The rows of a study's table: what each setting costs, and what its detections are worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.studies.fusion.judging import Judge, Verdict
from urbantwin.studies.fusion.setting import Setting
from urbantwin.studies.fusion.trial import Outcome

__all__ = ["Result", "results_of", "rows_of_failure"]

#: Parts of the time in which a node that falls silent is shown.
_WINDOWS = 8
_PER_CENT = 100.0


@dataclass(frozen=True, eq=False)
class Result:
    """A setting, its detections judged, and what it cost.

    Attributes:
        setting: what was tried.
        verdict: how good it is.
        alone: how good the receiver is alone.
        kbit_s: of all nodes' messages, thousand bits a second.
        kbit_frame: of one frame of all nodes, thousand bits.
        packets: of one frame of all nodes.
        age_s: of what was used, mean; NaN where nothing was.
    """

    setting: Setting
    verdict: Verdict
    alone: Verdict
    kbit_s: float
    kbit_frame: float
    packets: float
    age_s: float

    def row(self) -> dict[str, Any]:
        """Return the row of the table: average precisions in per cent."""
        setting, verdict = self.setting, self.verdict
        gain, gain_sure = verdict.gain(self.alone)
        channel = setting.channel
        return {
            "study": setting.study,
            "way": setting.how.name,
            "told": setting.how.told,
            "value": setting.value,
            "unit": setting.unit or None,
            "aligned": setting.aligned,
            "nodes": setting.nodes,
            "latency_s": channel.latency_s,
            "clock_error_s": channel.clock_error_s,
            "place_error_m": channel.place_error_m,
            "yaw_error_deg": channel.yaw_error_deg,
            "loss": channel.loss,
            "silent_from_s": channel.silent_from_s if channel.silent >= 0 else None,
            "kbit_s": self.kbit_s,
            "kbit_frame": self.kbit_frame,
            "packets_frame": self.packets,
            "age_s": None if np.isnan(self.age_s) else self.age_s,
            **_figures(verdict),
            "gain": _PER_CENT * gain,
            **_ends("gain", gain_sure),
        }


def results_of(
    settings: Sequence[Setting],
    outcomes: Sequence[Sequence[Outcome]],
    judge: Judge,
) -> list[Result]:
    """Return the results of settings.

    Args:
        settings: the receiver alone is among them.
        outcomes: of each setting at each moment.
        judge: of these moments.
    """
    known: dict[tuple[object, ...], Verdict] = {}
    for one, found in zip(settings, outcomes, strict=True):
        if one.work not in known:
            known[one.work] = judge.verdict([(k.box, k.kind, k.score) for k in found])
    alone = next(known[one.work] for one in settings if one.how.name == "alone")
    made = []
    for one, found in zip(settings, outcomes, strict=True):
        bits = float(np.mean([k.bits for k in found]))
        ages = [k.age_s for k in found if not np.isnan(k.age_s)]
        made.append(
            Result(
                setting=one,
                verdict=known[one.work],
                alone=alone,
                kbit_s=float(np.mean([k.bits_s for k in found])) / 1e3,
                kbit_frame=bits / 1e3,
                packets=float(np.mean([k.packets for k in found])),
                age_s=float(np.mean(ages)) if ages else float("nan"),
            )
        )
    return made


def rows_of_failure(
    settings: Sequence[Setting],
    outcomes: Sequence[Sequence[Outcome]],
    judge: Judge,
    time_s: NDArray[np.float64],
) -> list[dict[str, Any]]:
    """Return how good detections are in parts of the time, where a node falls silent.

    Args:
        settings: all of the study.
        outcomes: of each setting at each moment.
        judge: of these moments.
        time_s: (M,) of the moments.
    """
    windows = min(_WINDOWS, len(time_s))
    part = np.arange(len(time_s)) * windows // max(len(time_s), 1)
    rows = []
    for one, found in zip(settings, outcomes, strict=True):
        if one.study != "failure":
            continue
        boxes = [(k.box, k.kind, k.score) for k in found]
        for number in range(windows):
            chosen = part == number
            verdict = judge.verdict(boxes, chosen)
            silent = one.channel.silent >= 0
            rows.append(
                {
                    "way": one.how.name,
                    "silent_from_s": one.channel.silent_from_s if silent else None,
                    "from_s": float(time_s[chosen].min()),
                    "to_s": float(time_s[chosen].max()),
                    "frames": int(chosen.sum()),
                    **_figures(verdict),
                }
            )
    return rows


def _figures(verdict: Verdict) -> dict[str, Any]:
    return {
        "map": _percent(verdict.mean),
        **_ends("map", verdict.sure),
        "map_bev_iou_0.5": _percent(verdict.mean_iou),
        **{f"ap_{name}": _percent(one) for name, one in verdict.by_class.items()},
        "objects": verdict.objects,
    }


def _percent(value: float) -> float | None:
    return None if np.isnan(value) else _PER_CENT * value


def _ends(name: str, sure: tuple[float, float] | None) -> dict[str, float | None]:
    low, high = (None, None) if sure is None else (_PER_CENT * sure[0], _PER_CENT * sure[1])
    return {f"{name}_low": low, f"{name}_high": high}
