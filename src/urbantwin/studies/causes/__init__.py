"""Causes: objects found in a recording but missed in one that differs in one factor, and why."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.studies.causes.changes import Change, changes_between
    from urbantwin.studies.causes.reasons import REASONS
    from urbantwin.studies.causes.report import KIND, write_explanation
    from urbantwin.studies.causes.side import Side, read_side, thresholds_of

__all__ = [
    "KIND",
    "REASONS",
    "Change",
    "Side",
    "changes_between",
    "read_side",
    "thresholds_of",
    "write_explanation",
]

names_on_demand(__name__)
