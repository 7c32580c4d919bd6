"""Drawn corrections of a twin, without editing the map."""

from urbantwin.site.corrections.elements import REMOVED, Outcome, known_element, with_elements
from urbantwin.site.corrections.kinds import (
    AddLane,
    AddPole,
    AddTree,
    AddWall,
    MoveCurb,
    RemoveElement,
    RemoveLane,
    RemoveThing,
    SetTags,
)
from urbantwin.site.corrections.read import CORRECTIONS, Correction, read_corrections

__all__ = [
    "CORRECTIONS",
    "REMOVED",
    "AddLane",
    "AddPole",
    "AddTree",
    "AddWall",
    "Correction",
    "MoveCurb",
    "Outcome",
    "RemoveElement",
    "RemoveLane",
    "RemoveThing",
    "SetTags",
    "known_element",
    "read_corrections",
    "with_elements",
]
