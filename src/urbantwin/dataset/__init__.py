"""Datasets: parallel recording with resume, and the layouts of OpenPCDet and SemanticKITTI."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.dataset.description import describe, parts_of
    from urbantwin.dataset.provenance import asked_of
    from urbantwin.dataset.recording import record
    from urbantwin.dataset.split import SplitAsked
    from urbantwin.interface.dataset_card import Card, card
    from urbantwin.interface.dataset_split import DatasetSplit, split
    from urbantwin.interface.reproduction import Reproduction, reproduce
    from urbantwin.interface.sequence import SequenceFiles, sequence
    from urbantwin.interface.verification import Verification, verify

__all__ = [
    "Card",
    "DatasetSplit",
    "Reproduction",
    "SequenceFiles",
    "SplitAsked",
    "Verification",
    "asked_of",
    "card",
    "describe",
    "parts_of",
    "record",
    "reproduce",
    "sequence",
    "split",
    "verify",
]

names_on_demand(__name__)
