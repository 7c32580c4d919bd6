"""Counterfactuals: the same recording with one factor changed, and what became of every object."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.variation.factor import Factor, read_factor
    from urbantwin.variation.fates import FATES, fates_of
    from urbantwin.variation.ladder import (
        LADDERS,
        CurriculumFile,
        Grade,
        graded_rig,
        read_curriculum,
        refuse_nobody,
        traffic_of_density,
    )
    from urbantwin.variation.proof import Proof, proof_of
    from urbantwin.variation.run_file import RunFile, load_run

__all__ = [
    "FATES",
    "LADDERS",
    "CurriculumFile",
    "Factor",
    "Grade",
    "Proof",
    "RunFile",
    "fates_of",
    "graded_rig",
    "load_run",
    "proof_of",
    "read_curriculum",
    "read_factor",
    "refuse_nobody",
    "traffic_of_density",
]

names_on_demand(__name__)
