"""Events of actors who are put in: staged one after the other into a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from urbantwin.errors import StageError
from urbantwin.traffic.events.blocked_sensor import blocked_sensor
from urbantwin.traffic.events.crossing_paths import child_between_parked_cars, near_miss
from urbantwin.traffic.events.event_report import event_row
from urbantwin.traffic.events.scenario import Event
from urbantwin.traffic.events.scripted import (
    Scripted,
    Setting,
    bicycle_without_light,
    crowd,
    u_turn,
    wrong_way,
)
from urbantwin.traffic.events.surroundings import Surroundings
from urbantwin.traffic.events.unlit import unlit
from urbantwin.traffic.insertion import inserted
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.prescribed import TwinSurface
from urbantwin.twin import Twin

__all__ = ["PUT_IN", "with_events"]

#: Events that change nobody else, and what makes their actors.
PUT_IN: dict[str, Callable[[Any, Setting], Scripted]] = {
    "near_miss": near_miss,
    "wrong_way": wrong_way,
    "u_turn": u_turn,
    "child_between_parked_cars": child_between_parked_cars,
    "bicycle_without_light": bicycle_without_light,
    "crowd": crowd,
    "blocked_sensor": blocked_sensor,
}


def with_events(motion: Motion, twin: Twin, events: Sequence[tuple[int, Event]]) -> Motion:
    """Return a motion with the actors of events, and their rows in ``events`` of its manifest.

    Everybody else stays exactly as they were. An event sees those of the events before it.

    Args:
        motion: the motion.
        twin: that it is on.
        events: number of each in its scenario, and the event.

    Raises:
        StageError: an event cannot be staged; it says what is missing.
    """
    surface = TwinSurface(twin)
    rows = list(motion.manifest.get("events", []))
    for number, event in events:
        others = Surroundings(motion)
        setting = Setting(twin, others, int(motion.manifest["seed"]), number)
        staged = PUT_IN[event.event](event, setting)
        motion, tracks = inserted(motion, staged.paths, surface)
        if staged.told.pop("unlit", False):
            motion = unlit(motion, tracks[0])
        now = Surroundings(motion)
        there = tuple(track for track in tracks if len(now.rows_of(track)))
        if not there or tracks[0] not in there:
            raise StageError(
                f"{event.event} at {event.at_s:g} s cannot be staged: its way is beside the ground"
            )
        rows.append(
            event_row(
                event,
                now,
                staged="inserted",
                tracks=there,
                from_s=max(staged.from_s, 0.0),
                until_s=min(staged.until_s, setting.until_s),
                with_track=staged.with_track,
                told=staged.told,
            )
        )
        motion = replace(motion, manifest={**motion.manifest, "events": rows})
    return motion
