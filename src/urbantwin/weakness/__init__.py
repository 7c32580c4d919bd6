"""Weak points of a site's inputs before a build: what to add, and where."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.weakness.check import InputCheck, check_inputs
    from urbantwin.weakness.finding import Finding, Spot

__all__ = [
    "Finding",
    "InputCheck",
    "Spot",
    "check_inputs",
]

names_on_demand(__name__)
