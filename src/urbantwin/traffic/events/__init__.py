"""Events: rare situations staged at a requested time and place, and their outcomes."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.traffic.events.measures import Conflict, Passage, conflict
    from urbantwin.traffic.events.put_in import PUT_IN, with_events
    from urbantwin.traffic.events.scenario import (
        EVENTS,
        load_scenario,
        one_passage,
        scenario_events,
    )

__all__ = [
    "EVENTS",
    "PUT_IN",
    "Conflict",
    "Passage",
    "conflict",
    "load_scenario",
    "one_passage",
    "scenario_events",
    "with_events",
]

names_on_demand(__name__)
