"""Key figures of a twin, a motion and a dataset."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from urbantwin.traffic.result_warnings import place_of_count

if TYPE_CHECKING:
    from urbantwin.interface.dataset import Dataset
    from urbantwin.traffic.motion import Motion
    from urbantwin.twin import Twin

__all__ = ["outcome_of_dataset", "outcome_of_motion", "outcome_of_twin"]


def outcome_of_twin(twin: Twin) -> dict[str, Any]:
    """Return the numbers of roads and lanes, found and mapped objects, and the sensors' view."""
    notes = twin.manifest["notes"]
    found: dict[str, Any] = {"roads": len(twin.roads.roads), "lanes": len(twin.roads.lanes)}
    for kind, counts in notes.get("mapped", {}).items():
        found[f"{kind}_of_mapped"] = {key: counts[key] for key in ("found", "mapped")}
    sensors = notes.get("sensors", {})
    if "seen" in sensors:
        found["junction_seen"] = sensors["seen"]
    if "moved_m" in sensors:
        found["sensors_moved_from_their_proposal_m"] = sensors["moved_m"]
    return found


def outcome_of_motion(motion: Motion) -> dict[str, Any]:
    """Return the numbers of actors, driven against requested traffic, and overlaps."""
    told = motion.manifest
    seen = {name: row["seen"] for name, row in told.get("classes", {}).items() if row["seen"]}
    circulation, there = told.get("circulation", {}), told.get("past_sensors", {})
    met, absent = told.get("overlaps"), told.get("absent", {}).get("actors")
    counted: dict[str, Any] = {
        f"counted_{name}": round(sum(row[name] for row in told["counts"]), 1)
        for name in ("asked_per_hour", "driven_per_hour")
        if told.get("counts")
    }
    if told.get("counts"):
        counted["counts"] = [_side_by_side(row) for row in told["counts"]]
    if told.get("signals_timed_for_counts"):
        counted["signals_timed_for_counts"] = len(told["signals_timed_for_counts"])
    volumes = circulation.get("motor_traffic_per_hour")
    names = ("within_m", "asked_per_hour", "driven_per_hour", "vehicles")
    passing = {name: there[name] for name in names} if there.get("lanes_m") else None
    return {
        "actors": seen,
        **counted,
        **({"motor_traffic_per_hour": volumes} if volumes else {}),
        **({"motor_traffic_past_sensors": passing} if passing else {}),
        **({"left_out_lest_they_overlap": absent} if absent else {}),
        **({} if met is None else {"overlaps": met["actors"], "overlaps_with_scene": met["scene"]}),
    }


def _side_by_side(row: dict[str, Any]) -> dict[str, Any]:
    """Return requested and driven volumes of a count, for one line."""
    asked, driven = row["asked_per_hour"], row["driven_per_hour"]
    off = {"off": f"{driven / asked - 1:+.0%}"} if asked else {}
    why = {"held_up": row["held_up"]} if row.get("held_up") else {}
    place = place_of_count(row)
    return {"where": place, "class": row["class"], "asked": asked, "driven": driven, **off, **why}


def outcome_of_dataset(dataset: Dataset) -> dict[str, Any]:
    """Return the fraction of boxes with points, in the region and in range, by class."""
    boxes: Counter[str] = Counter()
    seen: Counter[str] = Counter()
    for one in dataset.parts.values() or [dataset]:
        boxes.update(one.manifest["counts"].get("boxes_in_reach", {}))
        seen.update(one.manifest["counts"].get("boxes_in_reach_with_points", {}))
    shares = {kind: round(seen[kind] / count, 3) for kind, count in boxes.items() if count}
    return {"objects_with_points": shares}
