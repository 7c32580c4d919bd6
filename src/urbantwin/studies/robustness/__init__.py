"""Robustness: faults of sensors, weather and traffic, level by level, over seeds."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.studies.robustness.effects import Measured
    from urbantwin.studies.robustness.factors import FACTORS, FactorAsked, rig_at
    from urbantwin.studies.robustness.grid_file import StudyFile, check_rigs, load_study
    from urbantwin.studies.robustness.judging import ALL, METRICS, Verdict, judged_recording
    from urbantwin.studies.robustness.report import KIND, write_study

__all__ = [
    "ALL",
    "FACTORS",
    "KIND",
    "METRICS",
    "FactorAsked",
    "Measured",
    "StudyFile",
    "Verdict",
    "check_rigs",
    "judged_recording",
    "load_study",
    "rig_at",
    "write_study",
]

names_on_demand(__name__)
