"""Warnings about a driven motion, derived from its manifest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from urbantwin.result_warning import ResultWarning

__all__ = ["PAST_SENSORS", "place_of_count", "warnings_of_drive"]

#: Share of the requested motor traffic that is driven, or of a guess that is requested, below which
#: there is a warning.
ENOUGH = 0.9
#: Share of the requested motor traffic above which there is a warning, beyond chance.
TOO_MUCH = 1.25
_MOTOR_CLASSES = ("car", "van", "truck", "bus", "motorcycle")
#: Share of visits left out to avoid overlaps, above which there is a warning.
MANY_ABSENT = 0.02
#: Subject of warnings about too little traffic at the sensors.
PAST_SENSORS = "traffic past the sensors"
#: Expected number of vehicles from which seeing none is no chance (e^-3 = 5 %).
_SIGNIFICANT_VEHICLES = 3.0
#: Maximum number of collisions listed individually.
_MAX_LISTED = 3


def warnings_of_drive(manifest: Mapping[str, Any]) -> Iterator[ResultWarning]:
    """Yield the warnings about a motion.

    Args:
        manifest: ``motion.json``.
    """
    yield from _of_sensors(manifest)
    yield from _of_volumes(manifest.get("circulation", {}))
    for row in manifest.get("counts", []):
        requested, driven = row["asked_per_hour"], row["driven_per_hour"]
        # Tolerates the standard deviation of a random count, its square root.
        if (
            row["has_way"]
            and driven < ENOUGH * requested - (requested * 3600 / manifest["duration_s"]) ** 0.5
        ):
            yield ResultWarning(
                f"counts {place_of_count(row)}",
                f"{driven:.0f} of {requested:.0f} {row['class']} an hour are driven",
                row.get("held_up") or "the motion is short, or more jams the streets",
                "see motion.json; lengthen traffic.warmup_s, or give signal programs in site.yaml",
            )
    for row in manifest["left_out"]:
        yield ResultWarning(f"traffic {row['class']}", f"{row['count']} are left out", row["why"])
    for name, row in manifest["classes"].items():
        late = row["asked"] - row["driven"] - _count_left_out(manifest, name)
        if late > 0:
            yield ResultWarning(
                f"traffic {name}",
                f"{late} of {row['asked']} never came in",
                "the streets that they begin on are full",
                "lower traffic.per_hour, or lengthen traffic.warmup_s",
            )
    yield from _of_events(manifest.get("events", ()))
    if manifest["teleports"]:
        yield ResultWarning(
            "traffic",
            f"teleports: {manifest['teleports']}",
            "SUMO removes vehicles that are stuck in a jam",
            "lower traffic.per_hour",
        )
    if manifest["collisions"]:
        yield ResultWarning(
            "traffic",
            f"collisions: SUMO counted {manifest['collisions']}",
            "; ".join(
                f"{' and '.join(hit['who'])} at {hit['x']:g}, {hit['y']:g}, {hit['time_s']:g} s"
                for hit in manifest.get("collided", ())[:_MAX_LISTED]
            ),
            "look at the motion there; motion.json says under collided, who",
        )
    yield from _of_absent(manifest.get("absent", {"visits": 0, "of": 0}))
    overlaps = manifest.get("overlaps", {})
    for count, of, kinds, where in (
        (overlaps.get("actors", 0), "pairs of actors that pass through each other", "between",
         "motion.json says under overlaps, worst, where"),
        (overlaps.get("scene", 0), "actors that pass through things of the scene", "with",
         "motion.json says under overlaps, hits, where"),
    ):  # fmt: skip
        if count:
            yield ResultWarning(
                "overlaps",
                f"{of}: {count}",
                ", ".join(f"{number} {name}" for name, number in overlaps[kinds].items()),
                where,
            )
    if manifest["poses_outside_ground"]:
        yield ResultWarning(
            "traffic",
            f"{manifest['poses_outside_ground']} poses of actors are left out",
            "a wheel or the whole actor is beside the ground within the region",
            "look in plan.png for a lane that leaves the street",
        )
    stuck = manifest.get("circulation", {}).get("halted", [])
    if stuck:
        lanes = ", ".join(sorted({str(row["lane"]) for row in stuck})[:3])
        yield ResultWarning(
            "traffic",
            f"{len(stuck)} actors stood for more than "
            f"{manifest['circulation']['halted_longer_than_s']:.0f} s",
            f"on {lanes}",
            "look there in plan.png",
        )


def _of_absent(absent: Mapping[str, Any]) -> Iterator[ResultWarning]:
    """Yield a warning if many visits are left out, with the place of most conflicts."""
    if absent["visits"] <= MANY_ABSENT * absent["of"]:
        return
    actors = ", ".join(f"{count} {name}" for name, count in absent["actors"].items())
    reason = f"{actors} would pass through others, or through what stands"
    place = absent.get("most_at", {})
    if place.get("visits", 0) > 1:
        frequent_pair = max(absent["with"].items(), key=lambda entry: entry[1])[0]
        reason += f"; {place['visits']} of them near {place['x']:g}, {place['y']:g}"
        reason += f"; most often {frequent_pair}"
    yield ResultWarning(
        "traffic",
        f"{absent['visits']} of {absent['of']} visits are left out",
        reason,
        "motion.json says under absent, each, where",
    )


def _of_events(rows: Sequence[Mapping[str, Any]]) -> Iterator[ResultWarning]:
    """Yield warnings about events that were moved, or whose actor touches another."""
    for row in rows:
        if "moved_m" in row:
            yield ResultWarning(
                f"event {row['event']}",
                f"is {row['moved_m']:.0f} m from the requested place",
                row["moved_because"],
                "within_m: 0 in the scenario keeps it there",
            )
        nearest = row.get("nearest", {})
        if row["event"] not in ("collision", "trajectory") and nearest.get("gap_m", 1.0) <= 0.0:
            yield ResultWarning(
                f"event {row['event']}",
                f"its actor touches track {nearest['track']} at {nearest['gap_at_s']:g} s",
                "",
                "another at_s or place",
            )


def _of_sensors(manifest: Mapping[str, Any]) -> Iterator[ResultWarning]:
    """Yield a warning if the streets at the sensors have no or too little motor traffic."""
    past_sensors = manifest.get("past_sensors", {})
    wanted = sum(
        row.get("per_hour", 0.0) for n, row in manifest["classes"].items() if n in _MOTOR_CLASSES
    )
    if not (past_sensors.get("lanes_m") and wanted):
        return
    about, within = PAST_SENSORS, f"within {past_sensors['within_m']:g} m of a sensor"
    requested, driven = past_sensors["asked_per_hour"], past_sensors["driven_per_hour"]
    expected = requested * manifest["duration_s"] / 3600.0
    if requested < 1.0:
        yield ResultWarning(
            about,
            f"none of {wanted:.0f} motor vehicles an hour is planned on the streets {within}",
            "at the level of the sensors no way leads from an entry of the region over these "
            "streets and back to that entry",
            "make the region larger, add the missing links in the map, or place the sensors at "
            "other streets",
        )
    elif not past_sensors["vehicles"] and expected >= _SIGNIFICANT_VEHICLES:
        yield ResultWarning(
            about,
            f"no motor vehicle comes {within}, of {requested:.0f} an hour planned there",
            _why_fewer(manifest),
            "look at motion.json (absent, circulation) and at plan.png there",
        )
    # Tolerates the standard deviation of a random count, its square root.
    elif driven < ENOUGH * requested - requested * expected**-0.5:
        yield ResultWarning(
            about,
            f"{driven:.0f} of {requested:.0f} motor vehicles an hour drive {within}",
            _why_fewer(manifest),
            "lengthen the motion or traffic.warmup_s, or lower traffic.per_hour",
        )


def _why_fewer(manifest: Mapping[str, Any]) -> str:
    """Return the reason why fewer vehicles pass the sensors than planned."""
    absent = manifest.get("absent", {"visits": 0, "of": 0})
    if absent["visits"] > MANY_ABSENT * absent["of"]:
        return f"{absent['visits']} of {absent['of']} visits are left out of the motion"
    held_up = manifest.get("circulation", {}).get("held_up")
    return held_up or "vehicles wait at signals or beyond the region during this motion"


def _of_volumes(circulation: Mapping[str, Any]) -> Iterator[ResultWarning]:
    """Yield warnings about the motor traffic of a closed loop that differs from the request."""
    carried = circulation.get("carried_share_of_motor_traffic")
    passages = circulation.get("passages_per_hour", {})
    hours = circulation.get("counted_for_s", 0) / 3600
    passed = hours * sum(row["asked"] for name, row in passages.items() if name in _MOTOR_CLASSES)
    # Tolerates the standard deviation of a random count, its square root.
    few = 0.0 < passed < _SIGNIFICANT_VEHICLES
    if carried is not None and not few and carried < ENOUGH - (passed**-0.5 if passed else 0.0):
        yield ResultWarning(
            "traffic",
            f"{carried:.0%} of the requested motor traffic is driven",
            circulation.get("held_up") or "too few vehicles come round in time",
            "lower traffic.per_hour, lengthen traffic.warmup_s, or give counted flows and signal "
            "programs in site.yaml",
        )
    if carried is not None and passed and carried > TOO_MUCH + 2.0 * passed**-0.5:
        volumes = circulation.get("motor_traffic_per_hour", {})
        yield ResultWarning(
            "traffic",
            f"{volumes.get('driven', 0.0):.0f} motor vehicles an hour drive, of "
            f"{volumes.get('asked', 0.0):.0f} requested",
            "gates let in the queues that they need at the end of the warm-up",
            "lengthen the motion, or traffic.warmup_s",
        )
    guess = circulation.get("share_of_guess")
    if guess is not None and guess < ENOUGH:
        yield ResultWarning(
            "traffic",
            f"{guess:.0%} of the guessed motor traffic is requested",
            circulation.get("guess_lowered_because") or "more jams the streets",
            "give counted flows and signal programs in site.yaml",
        )


def place_of_count(row: Mapping[str, Any]) -> str:
    """Return the place of a row of counts as text."""
    where = ("junction", "approach", "turn", "road", "crossing")
    return " ".join(str(row[name]) for name in where if row.get(name))


def _count_left_out(manifest: Mapping[str, Any], name: str) -> int:
    return sum(row["count"] for row in manifest["left_out"] if row["class"] == name)
