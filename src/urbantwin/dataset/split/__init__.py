"""Training, validation and test splits without leaks: in time with gaps, or by scenario."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.split.asked import PARTS, SplitAsked, shares_of
    from urbantwin.dataset.split.document import (
        SplitDocument,
        is_split_document,
        read_split_document,
        says_split,
    )
    from urbantwin.dataset.split.image_sets import frames_of_part, image_sets
    from urbantwin.dataset.split.rewritten import split_datasets_in_time
    from urbantwin.dataset.split.scenario_split import split_by_scenario
    from urbantwin.dataset.split.sources import datasets_at
    from urbantwin.dataset.split.time_split import Split, check_split, split_in_time

__all__ = [
    "PARTS",
    "Split",
    "SplitAsked",
    "SplitDocument",
    "check_split",
    "datasets_at",
    "frames_of_part",
    "image_sets",
    "is_split_document",
    "read_split_document",
    "says_split",
    "shares_of",
    "split_by_scenario",
    "split_datasets_in_time",
    "split_in_time",
]

names_on_demand(__name__)
