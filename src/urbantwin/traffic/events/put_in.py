"""Events with inserted actors, staged one after the other into a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from urbantwin.errors import StageError
from urbantwin.taxonomy import material_id
from urbantwin.traffic.assets.asset_name import AssetName
from urbantwin.traffic.events.blocked_sensor import blocked_sensor
from urbantwin.traffic.events.crossing_paths import child_between_parked_cars, near_miss
from urbantwin.traffic.events.elsewhere import staged_near
from urbantwin.traffic.events.measures import Conflict, conflict
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
from urbantwin.traffic.insertion import Insertion, inserted
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface
from urbantwin.twin import Twin

__all__ = [
    "PUT_IN",
    "StagedEvent",
    "conflict_with",
    "event_row",
    "staged_table",
    "unlit",
    "with_events",
]

#: Replaced materials: none is retroreflective or shiny, and clothes are as dark as rubber.
_REPLACED_MATERIALS = {
    **dict.fromkeys(
        ("retroreflector", "reflex-reflector", "lamp-lens", "paint-white"), "metal-dark"
    ),
    "cloth": "rubber",
}


def unlit(motion: Motion, track: int) -> Motion:
    """Return a motion in which one track's mesh has no reflectors, under a name of its own."""
    table = motion.actors
    tracks = table["track"].to_numpy()
    names = np.asarray(table["asset"].to_numpy(zero_copy_only=False), object).copy()
    of_track = tracks == track
    meshes = dict(motion.meshes)
    renamed = {}
    for name in sorted(set(names[of_track].tolist())):
        usual = AssetName.of(name)
        dark = usual._replace(body=f"{usual.body}-unlit")
        renamed[name] = str(dark)
        for (asset, phase), mesh in motion.meshes.items():
            if asset != usual.unsized:
                continue
            material = mesh.material.copy()
            for before, after in _REPLACED_MATERIALS.items():
                material[mesh.material == material_id(before)] = material_id(after)
            meshes[dark.unsized, phase] = replace(mesh, material=material)
    names[of_track] = [renamed[name] for name in names[of_track]]
    place = table.schema.get_field_index("asset")
    changed = table.set_column(place, table.schema.field(place), pa.array(names.tolist()))
    shown = {*names.tolist(), *motion.parked["asset"].to_pylist()}
    used = {AssetName.of(name).unsized for name in shown}
    return replace(
        motion,
        rows=as_rows(changed),
        meshes={key: mesh for key, mesh in sorted(meshes.items()) if key[0] in used},
    )


#: Maximum distance of another actor that is reported as nearest, metres.
_MAX_NEAREST_M = 30.0


def event_row(
    event: Event,
    others: Surroundings,
    *,
    staged: str,
    tracks: Sequence[int],
    from_s: float,
    until_s: float,
    with_track: int | None = None,
    told: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the manifest's entry of an event.

    Args:
        event: the requested event.
        others: all actors of the motion, including those of the event.
        staged: ``inserted`` or ``simulated``.
        tracks: the event's own actors, the main one first.
        from_s: begin of the event.
        until_s: end of the event.
        with_track: the other track of the conflict; ``None``: the nearest.
        told: further entries.
    """
    main = tracks[0] if tracks else None
    other_track, conflict = None, None
    if main is not None:
        ignoring = frozenset(tracks[1:]) - {with_track}
        other_track, conflict = conflict_with(others, main, with_track, from_s, until_s, ignoring)
    place = _place_of(others, main, from_s if conflict is None else conflict.gap_at_s)
    row: dict[str, Any] = {
        "event": event.event,
        "staged": staged,
        "asked": event.model_dump(exclude_unset=True, exclude_none=True),
        "from_s": round(from_s, 3),
        "until_s": round(until_s, 3),
        "tracks": [*tracks, *([with_track] if with_track not in (None, *tracks) else [])],
    }
    if place is not None:
        row["at"] = place
    if other_track is not None and conflict is not None:
        row["nearest"] = {
            "track": other_track,
            "class": _class_of(others, other_track),
            **conflict.told(),
        }
    extra = dict(told or {})
    extra.pop("asked", None)
    return {**row, **extra}


def conflict_with(
    others: Surroundings,
    main: int,
    with_track: int | None,
    from_s: float,
    until_s: float,
    ignoring: frozenset[int] = frozenset(),
) -> tuple[int | None, Conflict | None]:
    """Return the nearest other track to a track during an interval, and their conflict."""
    own = others.passage(main).between(from_s, until_s)
    if not len(own.time_s):
        return None, None
    if with_track is None:
        nearest = others.nearest(own, ignoring | {main})
        if nearest is None or nearest.gap_m > _MAX_NEAREST_M:
            return None, None
        with_track = nearest.track
    # The other may pass the place before or after the event.
    other = others.passage(with_track).between(from_s - 10.0, until_s + 10.0)
    return with_track, conflict(own, other)


def _place_of(others: Surroundings, track: int | None, time_s: float) -> dict[str, float] | None:
    if track is None:
        return None
    rows = others.rows_of(track)
    if not len(rows):
        return None
    row = rows[int(np.argmin(np.abs(others.time_s[rows] - time_s)))]
    x, y = others.xy[row]
    return {"x": round(float(x), 3), "y": round(float(y), 3)}


def _class_of(others: Surroundings, track: int) -> str:
    return str(others.kind[others.rows_of(track)[0]])


#: Events to which others do not react, and the functions that make their actors.
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
    """An event staged within SUMO, with the tracks of its actors.

    Attributes:
        reaction: its outcome.
        tracks: tracks of its actors, the main one first.
        seam_m: largest displacement of any actor where the motion changes into the one with the
            event, metres.
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
        without: actors of the same traffic without the events; tracks are numbers of trips.
        with_them: actors with the events; tracks are numbers of trips.
        found: outcomes of the events.
        events: the events.

    Raises:
        StageError: an actor of an event is never visible.
    """
    table, numbers, seam = spliced(without, with_them, changed_from(events))
    staged = []
    for reaction in found:
        tracks = tuple(numbers[trip] for trip in reaction.trips if trip in numbers)
        if reaction.trips and not tracks:
            raise StageError(
                f"{reaction.event.event} at {reaction.event.at_s:g} s cannot be staged: "
                "its actors are beside the ground"
            )
        staged.append(StagedEvent(reaction, tracks, seam))
    return table, staged


def with_events(
    motion: Motion, twin: Twin, events: Sequence[tuple[int, Event]], staged: Sequence[StagedEvent]
) -> Motion:
    """Return a motion with the actors that events insert, and an entry for each event.

    Other actors do not react to inserted ones. An event takes account of the actors of earlier
    ones.

    Args:
        motion: the motion, including events staged within SUMO.
        twin: the motion's twin.
        events: number of each in its scenario, and the event.
        staged: those that were staged within SUMO.

    Raises:
        StageError: an event cannot be staged; the message gives the reason.
    """
    surface = TwinSurface(twin)
    rows: dict[int, dict[str, Any]] = {}
    for staged_event in staged:
        rows[staged_event.reaction.number], motion = _row_of(staged_event, motion, twin, surface)
    for number, event in events:
        if event.event in PUT_IN:
            rows[number], motion = _put_in(event, number, motion, surface)
    return replace(motion, manifest={**motion.manifest, "events": [rows[n] for n in sorted(rows)]})


def _row_of(
    one: StagedEvent, motion: Motion, twin: Twin, surface: TwinSurface
) -> tuple[dict[str, Any], Motion]:
    """Return the entry of an event staged within SUMO, and the motion with its static objects."""
    reaction, tracks = one.reaction, one.tracks
    report = {**reaction.told, "seam_m": round(one.seam_m, 4)}
    bodies = _bodies_of(reaction, twin)
    if bodies:
        # Static objects on a lane have fixed positions.
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
        told=report,
    )
    return row, motion


def _bodies_of(reaction: Reaction, twin: Twin) -> list[PrescribedPath]:
    """Return the static objects on the lane of an event that closes it."""
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
    """Return the entry of an event with inserted actors, and the motion with them."""
    others = Surroundings(motion)
    twin = surface.solid.twin
    setting = Setting(twin, others, int(motion.manifest["seed"]), number, surface.solid)
    elsewhere: dict[str, Any] = {}

    def stage(one: Any) -> tuple[Scripted, Insertion]:  # noqa: ANN401 - any event
        scripted = PUT_IN[event.event](one, setting)
        made = Insertion.of(motion, scripted.paths, surface)
        if overlap := surface.solid.met_by(made.rows, motion.step_s):
            raise StageError(f"{event.event} at {one.at_s:g} s cannot be staged: {overlap}")
        return scripted, made

    try:
        staged, made = stage(event)
    except StageError as refused:
        if not isinstance(event, PlacedEvent) or not event.within_m:
            raise
        (staged, made), elsewhere = staged_near(event, twin, motion.actors, stage, refused)
    motion, tracks = made.into(motion), made.tracks
    if staged.told.pop("unlit", False):
        motion = unlit(motion, tracks[0])
    now = Surroundings(motion)
    present = tuple(track for track in tracks if len(now.rows_of(track)))
    if not present or tracks[0] not in present:
        raise StageError(
            f"{event.event} at {event.at_s:g} s cannot be staged: its way is beside the ground"
        )
    row = event_row(
        event,
        now,
        staged="inserted",
        tracks=present,
        from_s=max(staged.from_s, 0.0),
        until_s=min(staged.until_s, setting.until_s),
        with_track=staged.with_track,
        told={**staged.told, **elsewhere},
    )
    return row, motion
