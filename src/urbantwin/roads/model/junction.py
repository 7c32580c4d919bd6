"""Junctions of the lane model: their connections and connecting roads."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from urbantwin.artefact.typed_document import Pairs

__all__ = ["Connection", "ModelJunction"]


@dataclass(frozen=True)
class Connection:
    """A way through a junction.

    Attributes:
        incoming: the road that traffic comes from.
        connecting: the road that leads through the junction.
        contact: the end of the connecting road that meets the incoming one: ``start`` or ``end``.
        links: pairs of lanes: of the incoming road, of the connecting road.
    """

    incoming: int
    connecting: int
    contact: str
    links: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class ModelJunction:
    """Where roads meet.

    Attributes:
        id: its id, unique among junctions.
        name: id of the junction in the SUMO network and in ``RoadNetwork``; empty if none yet.
        connections: every way through.
        outline: (M, 2) its border in plan; empty where unknown.
        level: 0 on the ground, 1, 2, ... above other roads.
        members: ids of all junctions of the SUMO network that are one here, with ``name``.
    """

    id: int
    name: str
    connections: tuple[Connection, ...]
    outline: Pairs = field(default_factory=lambda: np.zeros((0, 2)))
    level: int = 0
    members: tuple[str, ...] = ()
