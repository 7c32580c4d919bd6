"""Attributes of lanelets: kind of lane, users, speed limit, and the lines on its bounds."""

from __future__ import annotations

from collections.abc import Callable

from urbantwin.roads.lanelet2.document import Document
from urbantwin.roads.lanelet2.group import Member
from urbantwin.roads.lanelet2.lane_sections import Row
from urbantwin.roads.lanelet2.traffic_rules import default_speed, speed_of

__all__ = ["attributes_of"]


def attributes_of(document: Document) -> Callable[[Member], Row]:
    """Return a function that gives the attributes of a lanelet, seen along its road.

    The speed limit is that of its tag ``speed_limit``, else of its regulatory element, else of a
    tag ``maxspeed`` as street maps have it, else that of its subtype and location.
    """
    limits: dict[int, float | None] = {}
    for identity, relation in document.relations.items():
        if relation.tags.get("subtype") == "speed_limit":
            signs = [
                document.ways[way].tags.get("subtype", "")
                for way in relation.of_role("refers")
                if way in document.ways
            ]
            limits[identity] = speed_of([relation.tags.get("sign_type", ""), *signs])

    def row(member: Member) -> Row:
        lanelet = member.lanelet
        tags = lanelet.tags
        regulated = next((limits[i] for i in lanelet.regulations if limits.get(i)), None)
        speed = (
            speed_of([tags.get("speed_limit", "")])
            or regulated
            or speed_of([tags.get("maxspeed", "")])
            or default_speed(tags)
        )
        left, right = (
            (way, turned == member.forward)
            for way, turned in zip(lanelet.ways, lanelet.turned, strict=True)
        )
        if not member.forward:
            left, right = right, left
        return Row(
            lanelet.kind,
            member.forward,
            speed if lanelet.drives else 0.0,
            lanelet.allowed,
            (left, right),
        )

    return row
