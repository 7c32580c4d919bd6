"""Grids of recordings, counterfactuals and suites of scenarios."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.interface.campaign_folder import Campaign
    from urbantwin.interface.curriculum import Curriculum
    from urbantwin.interface.experiment import run
    from urbantwin.interface.explanation import Explanation, explain
    from urbantwin.interface.study import Study
    from urbantwin.interface.suite import Suite, suite
    from urbantwin.interface.variation import Variation, vary

__all__ = [
    "Campaign",
    "Curriculum",
    "Explanation",
    "Study",
    "Suite",
    "Variation",
    "explain",
    "run",
    "suite",
    "vary",
]

names_on_demand(__name__)
