"""Warnings about a built twin, from the notes of its build."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from urbantwin.result_warning import ResultWarning
from urbantwin.roads import BuiltRoads, RoadNetwork
from urbantwin.scene.signal_pole import NO_PLACE
from urbantwin.twin.found_of_mapped import FoundOfMapped

__all__ = ["warnings_of_build"]

#: Share of mapped objects in the twin below which there is a warning.
ENOUGH = 0.95
#: Share of the region within the map's bounds below which there is a warning.
KNOWN = 0.9
#: Length below which left-out parts of roads are not reported, metres.
LONG_M = 50.0
_REASONS = {
    "streets": "no lanes lie along the others",
    "crossings": "no lanes run there, or walkers have nowhere to stand at their ends",
    "signals": "no junction or crossing of the lanes has a signal there",
}


def warnings_of_build(
    roads: BuiltRoads,
    mapped: Mapping[str, FoundOfMapped],
    geometry: Mapping[str, Any],
    *,
    scene: Mapping[str, Any],
    known: float = 1.0,
    open_at_times: Sequence[str] = (),
) -> Iterator[ResultWarning]:
    """Yield the warnings about a twin.

    Args:
        roads: its roads.
        mapped: completeness of mapped objects.
        geometry: name of each source of geometry -> its outcome, see `reconstruct.outcome`.
        scene: notes of the scene.
        known: share of the region within the map's bounds.
        open_at_times: temporary restrictions that were ignored.
    """
    if known < KNOWN:
        yield ResultWarning(
            "map",
            f"{1 - known:.0%} of the region lies beyond the extract",
            "beyond its bounds it has no more than what sticks out",
            "take a larger extract, or a smaller region",
        )
    if open_at_times:
        yield ResultWarning(
            "roads",
            f"{len(open_at_times)} restrictions are not heeded ({open_at_times[0]:.80})",
            "they hold only at times",
            "set traffic.time_of_day; conditions other than weekdays and hours are not read",
        )
    yield from roads.warnings
    dropped: Any = roads.notes.get("map", {}).get("dropped", [])  # type: ignore[attr-defined]
    if dropped:
        yield ResultWarning(
            "map",
            f"{len(dropped)} of its elements {'is' if len(dropped) == 1 else 'are'} dropped",
            f"{dropped[0]:.160}",
            "urbantwin info TWIN lists " + ("it" if len(dropped) == 1 else "all"),
        )
    otherwise: Any = [
        *roads.notes.get("reinterpreted", []),  # type: ignore[misc]
        *roads.notes.get("map", {}).get("reinterpreted", []),  # type: ignore[attr-defined]
    ]
    if otherwise:
        elements = len({words.partition(": ")[0] for words in otherwise})
        yield ResultWarning(
            "roads",
            f"tags of {elements} of the map's elements are taken otherwise than they say",
            f"{otherwise[0]:.160}",
            "urbantwin info TWIN lists " + ("it" if len(otherwise) == 1 else "all"),
        )
    left_out: Any = roads.notes.get("left_out", [])
    parts = [part for part in left_out if part["metres"] >= LONG_M]
    for kind, counts in mapped.items():
        if kind == "streets" and parts:
            continue  # reported below, by name
        if counts.found < ENOUGH * counts.mapped:
            x, y = counts.missing[0]
            yield ResultWarning(
                kind,
                f"{counts.found} of {counts.mapped} mapped ones are in the twin",
                _REASONS[kind],
                f"one is {_from_anchor(x, y)} of the anchor: look there in plan.png and in the map",
            )
    bare = _without_heads(roads) + scene.get("signals", {}).get(NO_PLACE, 0)
    if bare:
        yield ResultWarning(
            "signals",
            f"{bare} heads are missing",
            "there is no free place for their poles",
            "sensors will not see these poles",
        )
    if parts:
        names = ", ".join(dict.fromkeys(str(part["names"]) for part in parts))
        yield ResultWarning(
            "roads",
            f"{sum(part['metres'] for part in parts):.0f} m are left out ({names:.80})",
            "nothing joins them to the rest within the region",
            "make the region larger, or join them in the map",
        )
    for name, report in geometry.items():
        for problem in report.get("problems", []):
            yield ResultWarning(f"geometry {name}", str(problem), "", "see geometry.json")


def _from_anchor(x: float, y: float) -> str:
    """Return a position in the site frame in words, metres."""
    return (
        f"{abs(x):.0f} m {'west' if x < 0 else 'east'}, {abs(y):.0f} m "
        f"{'south' if y < 0 else 'north'}"
    )


def _without_heads(roads: BuiltRoads) -> int:
    """Return the number of lanes stopped by a signal without any head."""
    network: RoadNetwork = roads.network
    stopped = {
        head.lane
        for head in network.signals
        if network.lane_by_id[head.lane].kind not in ("crossing", "walkingarea")
        and network.lane_by_id[head.lane].allowed
    }
    shown = {
        strip for signal in roads.model.signals if signal.dynamic for strip in signal.strip.split()
    }
    return len(stopped - shown) if shown else 0
