"""Augmentation: rotation, reflection, scaling, fewer beams, pasted objects, clutter."""

from urbantwin.learn.augmentation.beams import thinned
from urbantwin.learn.augmentation.clutter import Obstacles, cluttered, with_obstacles
from urbantwin.learn.augmentation.pasting import ObjectBank, bank_of, pasted, read_bank, write_bank
from urbantwin.learn.augmentation.placement import Placement, drawn_placement

__all__ = [
    "ObjectBank",
    "Obstacles",
    "Placement",
    "bank_of",
    "cluttered",
    "drawn_placement",
    "pasted",
    "read_bank",
    "thinned",
    "with_obstacles",
    "write_bank",
]
