"""Campaigns: sites, seeds, rigs, weather and scenarios, all of them recorded with each other."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.campaigns.course import Course, Outcome
    from urbantwin.campaigns.grid_file import CampaignFile, load_campaign
    from urbantwin.campaigns.index import KIND, read_index, write_index
    from urbantwin.campaigns.steps import Step, Steps, steps_of

__all__ = [
    "KIND",
    "CampaignFile",
    "Course",
    "Outcome",
    "Step",
    "Steps",
    "load_campaign",
    "read_index",
    "steps_of",
    "write_index",
]

names_on_demand(__name__)
