"""Samples made different: turned, flipped, scaled, fewer beams, objects of other frames."""

from urbantwin.learn.augmentation.beams import thinned
from urbantwin.learn.augmentation.pasting import ObjectBank, bank_of, pasted, read_bank, write_bank
from urbantwin.learn.augmentation.placement import Placement, drawn_placement

__all__ = [
    "ObjectBank",
    "Placement",
    "bank_of",
    "drawn_placement",
    "pasted",
    "read_bank",
    "thinned",
    "write_bank",
]
