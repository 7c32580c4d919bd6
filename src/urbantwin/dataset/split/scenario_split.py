"""Assignment of whole scenarios to training, validation and test."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from urbantwin.dataset.split.asked import PARTS
from urbantwin.dataset.split.scenarios import Scenario, parked_places
from urbantwin.dataset.split.sources import Source
from urbantwin.dataset.split.time_split import thinned
from urbantwin.errors import InputError
from urbantwin.result_warning import ResultWarning, rows_of

__all__ = ["split_by_scenario"]


def split_by_scenario(
    scenarios: Sequence[Scenario],
    shares: Sequence[float],
    *,
    moved_m: float | None,
    seed: int,
) -> dict[str, Any]:
    """Assign each scenario to one part, and return the content of ``split.json``.

    The longest are assigned first, each to the part that lacks most of its share of the frames;
    equally long ones in random order. Paths are as given.

    Args:
        scenarios: see `scenarios_of`.
        shares: shares of training, validation and test.
        moved_m: see `SplitAsked`.
        seed: seed of the order.

    Raises:
        InputError: there is a single scenario.
    """
    wanted = {part: share for part, share in zip(PARTS, shares, strict=True) if share > 0}
    if len(scenarios) < 2 <= len(wanted):
        sources = scenarios[0].sources
        why = f" ({', '.join(scenarios[0].because)})" if scenarios[0].because else ""
        single = (
            "is one scenario"
            if len(sources) == 1
            else f"and {len(sources) - 1} more are one scenario"
        )
        raise InputError(
            single + why, file=sources[0].folder,
            expected="recordings of several motions, or --by time",
        )  # fmt: skip
    part_of = _assigned([one.frames for one in scenarios], wanted, seed)
    chosen = {
        part: [one for one, mine in zip(scenarios, part_of, strict=True) if mine == part]
        for part in PARTS
    }
    rows, groups = [], []
    for number, (one, part) in enumerate(zip(scenarios, part_of, strict=True), start=1):
        groups.append({"scenario": number, "part": part, "frames": one.frames,
                       "together_because": list(one.because)})  # fmt: skip
        rows += [_row(source, part, number, moved_m) for source in one.sources]
    places = {part: set(parked_places(mine)) for part, mine in chosen.items()}
    parked = {part: len(mine) for part, mine in places.items()}
    sites = {part: _sites(mine) for part, mine in chosen.items()}
    for first, second in (("train", "val"), ("train", "test"), ("val", "test")):
        parked[f"in {first} and {second}"] = len(places[first] & places[second])
    total = sum(one.frames for one in scenarios)
    told: dict[str, Any] = {
        "kind": "split",
        "schema": 1,
        "by": "scenario",
        "shares": dict(zip(PARTS, (round(one, 6) for one in shares), strict=True)),
        "seed": seed,
        "why": "No actor's way is in two parts: recordings of one motion, in any weather, by any "
        "rig, and with one factor varied, are one scenario, and a scenario is in one part.",
        "parts": {
            part: {
                "scenarios": len(mine),
                "datasets": sum(len(one.sources) for one in mine),
                "frames": sum(row["frames"] for row in rows if row["part"] == part),
                "share_of_frames": round(sum(one.frames for one in mine) / total, 4),
            }
            for part, mine in chosen.items()
        },
        "thinned": None if moved_m is None else {"moved_m": moved_m},
        "parked": parked,
        "sites_in_several_parts": len(
            set().union(*(sites[a] & sites[b] for a, b in (PARTS[:2], PARTS[1:], PARTS[::2])))
        ),
        "scenarios": groups,
        "datasets": rows,
    }
    told["warnings"] = rows_of(_warnings(told))
    return told


def _assigned(frames: Sequence[int], wanted: Mapping[str, float], seed: int) -> list[str]:
    """Return the part of each scenario."""
    total = sum(wanted.values())
    lacks = {part: share / total * sum(frames) for part, share in wanted.items()}
    drawn = np.random.default_rng(seed).permutation(len(frames))
    order = sorted(drawn.tolist(), key=lambda one: -frames[one])
    found = [""] * len(frames)
    for left, one in zip(range(len(order), 0, -1), order, strict=True):
        empty = [part for part in lacks if part not in found]
        # As many scenarios remain as empty parts: each part gets one.
        choice = empty if left <= len(empty) else list(lacks)
        found[one] = max(choice, key=lambda part: lacks[part])
        lacks[found[one]] -= frames[one]
    return found


def _row(source: Source, part: str, scenario: int, moved_m: float | None) -> dict[str, Any]:
    named = source.frame_names()
    row: dict[str, Any] = {
        "path": str(source.folder),
        "part": part,
        "scenario": scenario,
        "motion_sha256": source.manifest.get("motion_sha256"),
        "frames": len(named),
    }
    if moved_m is not None:
        places = source.places
        kept = thinned(places, np.arange(len(places.times_s)), moved_m)
        times = set(np.round(places.times_s[kept], 6).tolist())
        row["kept"] = [name for name, time_s in named if round(time_s, 6) in times]
        row |= {"frames": len(row["kept"]), "frames_left_out": len(named) - len(row["kept"])}
    return row


def _sites(scenarios: Sequence[Scenario]) -> set[tuple[float, ...]]:
    return {
        (round(float(anchor["latitude"]), 6), round(float(anchor["longitude"]), 6))
        for one in scenarios
        for source in one.sources
        if isinstance(anchor := source.parts[0][1].get("anchor"), dict)
        and {"latitude", "longitude"} <= anchor.keys()
    }


def _warnings(told: Mapping[str, Any]) -> Iterator[ResultWarning]:
    empty = [
        part for part in PARTS if told["shares"][part] and not told["parts"][part]["scenarios"]
    ]
    if empty:
        yield ResultWarning(
            "split",
            f"no scenario for {' and '.join(empty)}",
            f"there are {len(told['scenarios'])}",
            "record motions of other seeds",
        )
    if told["sites_in_several_parts"]:
        yield ResultWarning(
            "split",
            "parts show the same place",
            "its streets, buildings and parked vehicles are in several parts",
            "to judge how a model does elsewhere, test on a twin of another place",
        )
