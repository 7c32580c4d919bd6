"""Planned signal programs in a SUMO network, and descriptions of its programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import LaneModel
from urbantwin.roads.network import SignalProgram
from urbantwin.roads.signals.controlled_links import COMPASS, Signalised, signalised_junctions
from urbantwin.roads.signals.plan import approaches, plan_phases
from urbantwin.roads.sumo_check import reading_sumo_network
from urbantwin.site.signals import SignalPlan

__all__ = ["described_signals", "set_programs", "with_programs"]

#: Maximum distance between a place in a plan and its junction, metres.
NEAREST_M = 100.0


def set_programs(net: Path, plans: Sequence[SignalPlan], frame: SiteFrame) -> int:
    """Write the planned signal programs of a site into its SUMO network.

    Args:
        net: the ``.net.xml``, rewritten if there are plans.
        plans: the plans of ``site.yaml``.
        frame: the site frame.

    Returns:
        The number of programs that were written.

    Raises:
        InputError: a junction is missing or ambiguous, or a plan cannot be used.
    """
    if not plans:
        return 0
    tree = etree.parse(net)
    junctions = signalised_junctions(tree.getroot())
    logics = {item.get("id"): item for item in tree.getroot().iter("tlLogic")}
    plan_of: dict[str, int] = {}
    for number, plan in enumerate(plans):
        junction = _junction_of_plan(plan, junctions, frame)
        if junction.program in plan_of:
            raise plan.error(
                f"is the junction of signals[{plan_of[junction.program]}] again",
                ("junction",),
                "each junction once",
            )
        plan_of[junction.program] = number
        offset, phases = plan_phases(junction, plan)
        logic = logics[junction.program]
        for phase in list(logic.iter("phase")):
            logic.remove(phase)
        logic.set("offset", f"{offset:g}")
        extended = [state.lasts for state in plan.spec.states or () if state.at_least is not None]
        logic.set("type", "actuated" if extended else "static")
        for k, (seconds, state) in enumerate(phases):
            phase = etree.SubElement(logic, "phase", duration=f"{seconds:g}", state=state)
            if extended and plan.spec.states:
                least, most = plan.spec.states[k].lasts
                phase.set("minDur", f"{least:g}")
                phase.set("maxDur", f"{most:g}")
        etree.indent(logic, space=" ", level=1)
    text = etree.tostring(tree.getroot(), xml_declaration=True, encoding="UTF-8")
    net.write_bytes(text + b"\n")
    return len(plan_of)


def with_programs(model: LaneModel, programs: Sequence[SignalProgram]) -> LaneModel:
    """Return a lane model whose controllers have the programs of the same name.

    Args:
        model: the lane model.
        programs: the programs of SUMO's network.
    """
    program_of = {program.id: program for program in programs}
    controllers = tuple(
        replace(item, offset=program_of[item.name].offset, phases=program_of[item.name].phases)
        if item.name in program_of
        else item
        for item in model.controllers
    )
    return replace(model, controllers=controllers)


def described_signals(net: Path) -> dict[str, dict[str, Any]]:
    """Return program -> its controlled movements and phases, in the terms of plans.

    Args:
        net: the ``.net.xml``.

    Raises:
        InputError: it is not a valid network.
    """
    with reading_sumo_network(net):
        root = etree.parse(net).getroot()
        logics = {item.get("id"): item for item in root.iter("tlLogic")}
        junctions = signalised_junctions(root)
        return {item.program: _described(item, logics[item.program]) for item in junctions}


def _described(junction: Signalised, logic: etree._Element) -> dict[str, Any]:
    arms = [f"{arm} ({street})" if street else arm for arm, street in approaches(junction)]
    return {
        "streets": " / ".join(junction.streets),
        "junctions": ", ".join(junction.junctions),
        "east_m": round(float(junction.xy[0]), 1),
        "north_m": round(float(junction.xy[1]), 1),
        "approaches": ", ".join(arms),
        "cycle": junction.cycle,
        "offset": junction.offset,
        "phases": [
            {
                "seconds": seconds,
                **_extended(phase),
                "shows": _state_in_words(junction, state),
                "state": state,
            }
            for (seconds, state), phase in zip(junction.phases, logic.iter("phase"), strict=True)
        ],
    }


def _extended(phase: etree._Element) -> dict[str, float]:
    """Return the minimum and maximum duration of a phase, if traffic extends it."""
    least, most = phase.get("minDur"), phase.get("maxDur")
    if least is None or most is None or least == most:
        return {}
    return {"at_least": float(least), "at_most": float(most)}


def _state_in_words(junction: Signalised, state: str) -> str:
    """Return a state in words: ``green east, west left; walk north``."""
    parts = []
    for word, letters, walk in (
        ("green", "Gg", False),
        ("yellow", "yY", False),
        ("walk", "Gg", True),
    ):
        arms = []
        for arm in COMPASS:
            links = [
                link
                for link in junction.links
                if link.arm == arm and (link.movement == "walk") == walk
            ]
            lit = [link for link in links if state[link.index] in letters]
            turns = sorted({link.movement for link in lit} - {"walk"})
            if lit and len({link.movement for link in links}) == len(
                {link.movement for link in lit}
            ):
                arms.append(arm)
            elif lit:
                arms.append(f"{arm} {'+'.join(turns)}")
        if arms:
            parts.append(f"{word} {', '.join(arms)}")
    return "; ".join(parts) or "all red"


def _junction_of_plan(
    plan: SignalPlan, there: Sequence[Signalised], frame: SiteFrame
) -> Signalised:
    """Return the junction that a plan refers to."""
    spec = plan.spec
    listed = "; ".join(map(_named, there))
    expected = f"one of {listed}" if there else "no signals: the region has no signalised junction"
    if spec.place is not None:
        xy = frame.site_from_lonlat([spec.place[::-1]])[0]
        away = [float(np.hypot(*(item.xy - xy))) for item in there]
        if not away or min(away) > NEAREST_M:
            problem = f"has no signalised junction within {NEAREST_M:g} m"
            raise plan.error(problem, ("junction",), expected)
        return there[int(np.argmin(away))]
    name = str(spec.junction).strip()
    matching = [item for item in there if name == item.program or name in item.junctions]
    if not matching:
        streets = {street.casefold() for street in spec.streets}
        matching = [
            item
            for item in there
            if streets and streets <= {street.casefold() for street in item.streets}
        ]
    if len(matching) == 1:
        return matching[0]
    problem = f"{name!r} is not a signalised junction"
    if matching:
        problem = f"{name!r} is {len(matching)} signalised junctions"
        expected = f"one of the ids {', '.join(item.program for item in matching)}"
    raise plan.error(problem, ("junction",), expected)


def _named(junction: Signalised) -> str:
    streets = " / ".join(junction.streets)
    return f"{junction.program} ({streets})" if streets else junction.program
