"""Robustness: faults of sensors, weather and traffic, level by level, over seeds."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.study.robustness.effects import Measured
    from urbantwin.study.robustness.factors import FACTORS, FactorAsked, rig_at
    from urbantwin.study.robustness.grid_file import StudyFile, check_rigs, load_study
    from urbantwin.study.robustness.judging import ALL, METRICS, Verdict, judged_recording
    from urbantwin.study.robustness.report import KIND, write_study

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
