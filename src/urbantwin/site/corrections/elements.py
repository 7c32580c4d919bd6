"""Corrections of map elements: overridden tags, and removal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.site.corrections.kinds import Element, RemoveElement, SetTags
from urbantwin.site.corrections.read import Correction
from urbantwin.site.extract import Extract

__all__ = ["REMOVED", "Outcome", "known_element", "with_elements"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a correction.

    Attributes:
        correction: the correction.
        applied: whether it changed anything.
        told: the change, or why there is none.
        at: affected geometry in plan, site frame.
    """

    correction: Correction
    applied: bool
    told: str
    at: Sequence[shapely.Geometry] = ()

    @property
    def shapes(self) -> Sequence[shapely.Geometry]:
        """Return the geometry to show: where it was applied, or else where it was drawn."""
        return self.at or self.correction.shapes


#: Tag of a removed object, which keeps its place free of seeded objects.
REMOVED = "urbantwin:removed"
_PLACE_KEEPERS = (("highway", "street_lamp"), ("natural", "tree"))


def with_elements(
    extract: Extract,
    corrections: Sequence[Correction],
    frame: SiteFrame,
    region: shapely.Polygon,
) -> tuple[Extract, list[Outcome]]:
    """Return the map with tags overridden and elements removed, and the outcomes.

    Args:
        extract: the map.
        corrections: corrections; other kinds are ignored.
        frame: the site frame.
        region: the region, site frame.

    Raises:
        InputError: an element is missing in the map.
    """
    edited = replace(
        extract,
        node_tags=dict(extract.node_tags),
        ways=dict(extract.ways),
        relations=dict(extract.relations),
    )
    outcomes = []
    for one in corrections:
        if isinstance(one.asked, SetTags | RemoveElement):
            known_element(extract, one.asked.element, one)
            outcomes.append(_edited(edited, one, one.asked, frame, region))
    return edited, outcomes


def known_element(extract: Extract, element: Element, correction: Correction) -> None:
    """Check that the map has the element of a correction.

    Raises:
        InputError: it does not.
    """
    held: Mapping[str, Mapping[int, object]] = {
        "node": extract.nodes,
        "way": extract.ways,
        "relation": extract.relations,
    }
    if element.id in held[element.kind]:
        return
    others = [kind for kind, known in held.items() if element.id in known]
    where = "" if extract.is_whole else " around the region"
    raise correction.error(
        f"is of {element}, which is not in {extract.path.name}{where}",
        f"{others[0]}/{element.id}" if others else "an element of that map",
    )


def _edited(
    edited: Extract,
    one: Correction,
    asked: SetTags | RemoveElement,
    frame: SiteFrame,
    region: shapely.Polygon,
) -> Outcome:
    """Apply a correction to an element in place."""
    element = asked.element
    shape = _shape(edited, element, frame)
    at = () if shape is None else (shape,)
    if shape is not None and (gap := shapely.distance(shape, region)) > 0:
        return Outcome(one, False, f"{element} lies {gap:.0f} m outside the region", at)
    before = _tags(edited, element)
    if isinstance(asked, RemoveElement):
        if not before:
            return Outcome(one, False, f"{element} has no tags: nothing is built of it", at)
        holds = {key: value for key, value in _PLACE_KEEPERS if before.get(key) == value}
        _set_tags(edited, element, {**holds, REMOVED: "yes"} if holds else {})
        return Outcome(one, True, f"{element} ({_called(before)}) is left out", at)
    changed = {key: value for key, value in asked.tags.items() if before.get(key) != value}
    if not changed:
        return Outcome(one, False, f"{element} has these tags already", at)
    kept = {key: value for key, value in before.items() if key not in changed}
    new = {key: value for key, value in changed.items() if value is not None}
    _set_tags(edited, element, kept | new)
    told = ", ".join(f"{key}={'' if value is None else value}" for key, value in changed.items())
    return Outcome(one, True, f"{element}: {told}", at)


def _called(tags: Mapping[str, str]) -> str:
    """Return an element's most descriptive tag."""
    keys = ("highway", "building", "barrier", "natural", "man_made", "power", "type")
    key = next((key for key in keys if key in tags), min(tags))
    return f"{key}={tags[key]}"


def _tags(extract: Extract, element: Element) -> dict[str, str]:
    if element.kind == "node":
        return extract.node_tags.get(element.id, {})
    held = extract.ways if element.kind == "way" else extract.relations
    return held[element.id].tags


def _set_tags(edited: Extract, element: Element, tags: dict[str, str]) -> None:
    if element.kind == "node":
        edited.node_tags.pop(element.id, None)
        if tags:
            edited.node_tags[element.id] = tags
    elif element.kind == "way":
        edited.ways[element.id] = replace(edited.ways[element.id], tags=tags)
    else:
        edited.relations[element.id] = replace(edited.relations[element.id], tags=tags)


def _shape(extract: Extract, element: Element, frame: SiteFrame) -> shapely.Geometry | None:
    """Return an element's geometry; for a relation that of its ways and nodes."""
    if element.kind == "node":
        return shapely.Point(frame.site_from_lonlat([extract.nodes[element.id]])[0])
    if element.kind == "way":
        points = extract.way_line(extract.ways[element.id], frame)
        return shapely.LineString(points) if len(points) > 1 else None
    parts = [
        shape
        for kind, identity, _ in extract.relations[element.id].members
        if kind in "nw" and identity in (extract.nodes if kind == "n" else extract.ways)
        if (shape := _shape(extract, Element({"n": "node", "w": "way"}[kind], identity), frame))
        is not None
    ]
    return shapely.GeometryCollection(parts) if parts else None
