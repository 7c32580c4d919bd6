"""Datasets: recording frames with workers and resume; the OpenPCDet and SemanticKITTI layouts."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.description import describe, parts_of
    from urbantwin.dataset.provenance import asked_of
    from urbantwin.dataset.recording import record
    from urbantwin.dataset.split import SplitAsked

__all__ = ["SplitAsked", "asked_of", "describe", "parts_of", "record"]

names_on_demand(__name__)
