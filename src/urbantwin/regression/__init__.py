"""Regression suites: scenarios with seeds that are driven again, and what became different."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.regression.changes import changes_between
    from urbantwin.regression.motion_print import MotionPrint
    from urbantwin.regression.stored import Stored
    from urbantwin.regression.suite_file import Case, SuiteFile, load_suite
    from urbantwin.regression.table import table_of

__all__ = [
    "Case",
    "MotionPrint",
    "Stored",
    "SuiteFile",
    "changes_between",
    "load_suite",
    "table_of",
]

names_on_demand(__name__)
