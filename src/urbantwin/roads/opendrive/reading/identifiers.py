"""Assigning ids of the lane model to areas, signals and controllers of a file."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace

from urbantwin.roads.model import ModelRoad, RoadArea, RoadSignal, SignalController
from urbantwin.roads.opendrive.reading.objects import Outline
from urbantwin.roads.opendrive.reading.parsing import Log, id_number
from urbantwin.roads.opendrive.reading.signals import Program, Sign

__all__ = ["with_model_ids"]


class _Ids:
    """Gives ids: the file's where they are free whole numbers, else new ones."""

    def __init__(self, texts: Sequence[str]) -> None:
        known = [id_number(text) for text in texts]
        self.free = 1 + max((k for k in known if k is not None), default=0)
        self.used: set[int] = set()

    def give(self, text: str) -> int:
        wanted = id_number(text)
        if wanted is None or wanted in self.used:
            wanted = self.free
            self.free += 1
        self.used.add(wanted)
        return wanted


def with_model_ids(
    roads: Mapping[str, ModelRoad],
    outlines: Sequence[tuple[str, Outline]],
    signs: Sequence[tuple[str, Sign]],
    programs: Mapping[str, Program],
    junctions: Mapping[str, tuple[int, ...]],
    log: Log,
    *,
    gone: Collection[str] = (),
) -> tuple[tuple[RoadArea, ...], tuple[RoadSignal, ...], tuple[SignalController, ...]]:
    """Return areas, signals and controllers.

    Args:
        roads: id in the file -> road.
        outlines: road and area.
        signs: road and signal.
        programs: id in the file -> controller.
        junctions: controller -> the junctions that name it.
        log: the file.
        gone: ids of signals that were dropped with their roads.

    Signals that a controller switches and that do not exist are dropped from it, and noted.
    """
    ids = _Ids([*(e.id for _, e in signs), *programs, *(e.id for _, e in outlines)])
    number: dict[str, int] = {}
    program_of = {signal: p.name for p in programs.values() for signal in p.signals}
    signals = []
    for road, sign in signs:
        spot = log.at(f"road {road}, signal {sign.id}")
        if sign.id in number:
            if sign.id in program_of:
                spot.drop("is there twice, and is switched by a controller: the first one is used")
                continue
            spot.remark("signals of the same id: they are numbered")
        number[sign.id] = ids.give(sign.id)
        values = {**asdict(sign), "id": number[sign.id], "road": roads[road].id}
        del values["turned"]
        signals.append(RoadSignal(**values, program=program_of.get(sign.id, "")))
    controllers: list[SignalController] = []
    for key, written in programs.items():
        spot = log.at(f"controller {key}")
        for signal in written.signals:
            if signal not in number and signal not in gone:
                spot.drop(f"switches signal {signal}, which does not exist")
        present = tuple(signal for signal in written.signals if signal in number)
        if written.signals and not present:
            continue
        program = replace(written, signals=present)
        known = next((k for k, one in enumerate(controllers) if _same(one, program)), None)
        if known is not None:
            signals_of = {*controllers[known].signals, *(number[s] for s in program.signals)}
            controllers[known] = replace(controllers[known], signals=tuple(sorted(signals_of)))
            continue
        controllers.append(
            SignalController(
                ids.give(key),
                program.name,
                tuple(number[signal] for signal in program.signals),
                junctions.get(key, ()),
                program.offset,
                program.phases,
            )
        )
    for key in junctions:
        if key not in programs:
            log.at(f"controller {key}").remark("controllers of junctions that do not exist")
    areas = tuple(
        RoadArea(
            ids.give(e.id),
            roads[road].id,
            e.kind,
            e.name,
            e.s,
            e.corners,
            e.height,
            marking=e.marking,
        )
        for road, e in outlines
    )
    return areas, tuple(signals), tuple(controllers)


def _same(known: SignalController, program: Program) -> bool:
    """Return whether a program is one that is known: what we write for CARLA is cut into stages."""
    return bool(program.phases) and (known.name, known.offset, known.phases) == (
        program.name,
        program.offset,
        program.phases,
    )
