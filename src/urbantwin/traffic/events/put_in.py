"""Events of actors who are put in: staged one after the other into a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from urbantwin.errors import StageError
from urbantwin.traffic.events.blocked_sensor import blocked_sensor
from urbantwin.traffic.events.crossing_paths import child_between_parked_cars, near_miss
from urbantwin.traffic.events.elsewhere import staged_near
from urbantwin.traffic.events.event_report import event_row
from urbantwin.traffic.events.reacting import Reaction, changed_from, spliced
from urbantwin.traffic.events.scenario import Debris, Event, PlacedEvent, WorkZone
from urbantwin.traffic.events.scripted import (
    Scripted,
    Setting,
    bicycle_without_light,
    crowd,
    passage,
    trajectory,
    wrong_way,
)
from urbantwin.traffic.events.surroundings import Surroundings
from urbantwin.traffic.events.things import debris, work_zone
from urbantwin.traffic.events.u_turn import u_turn
from urbantwin.traffic.events.unlit import unlit
from urbantwin.traffic.insertion import Insertion, inserted
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface
from urbantwin.twin import Twin

__all__ = ["PUT_IN", "StagedEvent", "staged_table", "with_events"]

#: Events that change nobody else, and what makes their actors.
PUT_IN: dict[str, Callable[[Any, Setting], Scripted]] = {
    "near_miss": near_miss,
    "wrong_way": wrong_way,
    "u_turn": u_turn,
    "child_between_parked_cars": child_between_parked_cars,
    "bicycle_without_light": bicycle_without_light,
    "crowd": crowd,
    "passage": passage,
    "trajectory": trajectory,
    "blocked_sensor": blocked_sensor,
}


@dataclass(frozen=True)
class StagedEvent:
    """What was staged within SUMO, its actors by their tracks.

    Attributes:
        reaction: what became of it.
        tracks: of its actors, the main one first.
        seam_m: how far anybody was moved where the motion goes over into the one with the event.
    """

    reaction: Reaction
    tracks: tuple[int, ...]
    seam_m: float


def staged_table(
    without: pa.Table,
    with_them: pa.Table,
    found: Sequence[Reaction],
    events: Sequence[tuple[int, Event]],
) -> tuple[pa.Table, list[StagedEvent]]:
    """Return the actors of a motion in which others react to events, and the events' tracks.

    Args:
        without: actors of the same traffic without the events, tracks being numbers of trips.
        with_them: the same with them.
        found: what became of the events.
        events: the events.

    Raises:
        StageError: an actor of an event is nowhere to be seen.
    """
    table, numbers, seam = spliced(without, with_them, changed_from(events))
    staged = []
    for one in found:
        tracks = tuple(numbers[trip] for trip in one.trips if trip in numbers)
        if one.trips and not tracks:
            raise StageError(
                f"{one.event.event} at {one.event.at_s:g} s cannot be staged: its actors are beside"
                " the ground"
            )
        staged.append(StagedEvent(one, tracks, seam))
    return table, staged


def with_events(
    motion: Motion, twin: Twin, events: Sequence[tuple[int, Event]], staged: Sequence[StagedEvent]
) -> Motion:
    """Return a motion with what its events put in, and a row for each event in its manifest.

    Who is put in changes nobody else. An event sees those of the events before it.

    Args:
        motion: the motion, with what was staged within SUMO.
        twin: that it is on.
        events: number of each in its scenario, and the event.
        staged: those that were staged within SUMO.

    Raises:
        StageError: an event cannot be staged; it says what is missing.
    """
    surface = TwinSurface(twin)
    rows: dict[int, dict[str, Any]] = {}
    for one in staged:
        rows[one.reaction.number], motion = _row_of(one, motion, twin, surface)
    for number, event in events:
        if event.event in PUT_IN:
            rows[number], motion = _put_in(event, number, motion, surface)
    return replace(motion, manifest={**motion.manifest, "events": [rows[n] for n in sorted(rows)]})


def _row_of(
    one: StagedEvent, motion: Motion, twin: Twin, surface: TwinSurface
) -> tuple[dict[str, Any], Motion]:
    """Return the row of an event staged within SUMO, and the motion with what marks its place."""
    reaction, tracks = one.reaction, one.tracks
    told = {**reaction.told, "seam_m": round(one.seam_m, 4)}
    bodies = _bodies_of(reaction, twin)
    if bodies:
        # Cones and what lies on a lane stand where they are told to.
        motion, tracks = inserted(motion, bodies, surface, through_walls=True)
    others = Surroundings(motion)
    row = event_row(
        reaction.event,
        others,
        staged="simulated",
        tracks=tracks,
        from_s=reaction.from_s,
        until_s=reaction.until_s,
        with_track=tracks[1] if reaction.event.event == "collision" and len(tracks) > 1 else None,
        told=told,
    )
    return row, motion


def _bodies_of(reaction: Reaction, twin: Twin) -> list[PrescribedPath]:
    """Return what stands on the lane for an event that closes it."""
    event = reaction.event
    if not isinstance(event, WorkZone | Debris):
        return []
    lane = twin.roads.lane_by_id[reaction.told["lane"]]
    times = reaction.from_s, reaction.until_s
    from_m, to_m = reaction.told["along_m"]
    if isinstance(event, WorkZone):
        return work_zone(lane, from_m, to_m, reaction.told["width_m"], times)
    return debris(lane, (from_m + to_m) / 2, times)


def _put_in(
    event: Event, number: int, motion: Motion, surface: TwinSurface
) -> tuple[dict[str, Any], Motion]:
    """Return the row of an event whose actors are put in, and the motion with them."""
    others = Surroundings(motion)
    twin = surface.solid.twin
    setting = Setting(twin, others, int(motion.manifest["seed"]), number, surface.solid)
    told: dict[str, Any] = {}

    def stage(one: Any) -> tuple[Scripted, Insertion]:  # noqa: ANN401 - of any event
        found = PUT_IN[event.event](one, setting)
        made = Insertion.of(motion, found.paths, surface)
        if met := surface.solid.met_by(made.rows, motion.step_s):
            raise StageError(f"{event.event} at {one.at_s:g} s cannot be staged: {met}")
        return found, made

    try:
        staged, made = stage(event)
    except StageError as refused:
        if not isinstance(event, PlacedEvent) or not event.within_m:
            raise
        (staged, made), told = staged_near(event, twin, motion.actors, stage, refused)
    motion, tracks = made.into(motion), made.tracks
    if staged.told.pop("unlit", False):
        motion = unlit(motion, tracks[0])
    now = Surroundings(motion)
    there = tuple(track for track in tracks if len(now.rows_of(track)))
    if not there or tracks[0] not in there:
        raise StageError(
            f"{event.event} at {event.at_s:g} s cannot be staged: its way is beside the ground"
        )
    row = event_row(
        event,
        now,
        staged="inserted",
        tracks=there,
        from_s=max(staged.from_s, 0.0),
        until_s=min(staged.until_s, setting.until_s),
        with_track=staged.with_track,
        told={**staged.told, **told},
    )
    return row, motion
