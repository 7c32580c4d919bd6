"""Fusion between nodes: messages, their bit rate, and the gain for a detector."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.studies.fusion.judging import Judge, rows_of, rows_of_failure
    from urbantwin.studies.fusion.nodes import Nodes, open_nodes
    from urbantwin.studies.fusion.report import KIND, write_report
    from urbantwin.studies.fusion.setting import STUDIES, settings_of
    from urbantwin.studies.fusion.study import (
        Plan,
        chosen_moments,
        outcomes_of,
        places_of,
        seconds_needed,
    )

__all__ = [
    "KIND",
    "STUDIES",
    "Judge",
    "Nodes",
    "Plan",
    "chosen_moments",
    "open_nodes",
    "outcomes_of",
    "places_of",
    "rows_of",
    "rows_of_failure",
    "seconds_needed",
    "settings_of",
    "write_report",
]

names_on_demand(__name__)
