"""Kinds of corrections: the properties of every action, and its geometry types."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from urbantwin.site.drawn_values import Metres, Text, number_of
from urbantwin.site.yaml_document import wrong
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = [
    "ACTIONS",
    "KINDS_OF_POLES",
    "AddLane",
    "AddPole",
    "AddTree",
    "AddWall",
    "Asked",
    "Element",
    "MoveCurb",
    "RemoveElement",
    "RemoveLane",
    "RemoveThing",
    "SetTags",
]

#: ``way/123``, ``w123``; or the address of its page, or of an editor, at OpenStreetMap.
_ELEMENT = re.compile(r"(n|w|r|node|way|relation)[/ ]?(-?\d{1,18})")
_ADDRESS = re.compile(
    r"https?://(?:www\.)?openstreetmap\.org/(?:edit\?(?:[^#\s]*&)?)?"
    r"(node|way|relation)[/=](\d{1,18})(?:[/?&#]\S*)?"
)
_NAMES = {"n": "node", "w": "way", "r": "relation"}
#: Most characters of a tag's value (OSM API 0.6).
_LONGEST_TAG = 255
#: Kinds of poles: their map tags, and the range of heights, metres.
KINDS_OF_POLES: Mapping[str, tuple[Mapping[str, str], tuple[float, float]]] = {
    "pole": ({"man_made": "pole"}, (1.0, 40.0)),
    "lamp": ({"highway": "street_lamp"}, (2.0, 40.0)),
    "utility": ({"power": "pole"}, (3.0, 30.0)),
    "sign": ({"traffic_sign": "yes"}, (1.0, 6.0)),
    "bollard": ({"barrier": "bollard"}, (0.3, 1.5)),
}
_WALLS = Literal["wall", "fence", "hedge", "guard_rail"]
#: Allowed materials of a wall or a fence.
_MATERIALS = {
    "wall": ("concrete", "stone", "brick", "plaster", "wood", "metal", "glass"),
    "fence": ("wood", "metal"),
}


class Element(NamedTuple):
    """An element of OpenStreetMap: ``node``, ``way`` or ``relation``, and its id."""

    kind: str
    id: int

    def __str__(self) -> str:
        """Return the element in OpenStreetMap's notation: ``way/123``."""
        return f"{self.kind}/{self.id}"


def _element(value: Any) -> Any:  # noqa: ANN401
    text = value.strip() if isinstance(value, str) else ""
    match = _ELEMENT.fullmatch(text) or _ADDRESS.fullmatch(text)
    if match is None:
        raise wrong(f"is {value!r:.60}", "an element of the map, such as way/123 or node/45")
    return Element(_NAMES[match[1][0]], int(match[2]))


def _tags(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, str):  # attribute tables of GIS hold text only
        try:
            value = parse_json(value)
        except NotJsonError:
            raise wrong("is text that is not JSON", '{"lanes": "3", "maxspeed": null}') from None
    if not isinstance(value, Mapping) or not value:
        raise wrong("names no tags", '{"lanes": "3", "maxspeed": null}')
    found: dict[str, str | None] = {}
    for key, one in value.items():
        text = "yes" if one is True else "no" if one is False else one
        if isinstance(text, int | float):
            text = f"{text:.10g}"
        plain = text is None or (isinstance(text, str) and 0 < len(text) <= _LONGEST_TAG)
        if not plain or not 0 < len(key) <= _LONGEST_TAG:
            raise wrong(
                f"gives {key!r:.40} a value that is no tag's", "text, a number, or null to drop it"
            )
        found[key] = text
    return found


ElementField = Annotated[Element, BeforeValidator(_element)]
Side = Literal["left", "right"]
LaneKind = Literal["driving", "bus", "bicycle", "parking", "shoulder", "sidewalk"]


class Asked(BaseModel):
    """An action; subclasses define its properties and geometry types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    action: str
    what: str = ""
    name: Text | None = None

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry; empty if no geometry is needed."""
        return ()

    @property
    def must_be_drawn(self) -> bool:
        """Return whether a geometry is required."""
        return True


class SetTags(Asked):
    """Overridden tags of an element; ``None`` removes a tag."""

    element: ElementField
    tags: Annotated[dict[str, str | None], BeforeValidator(_tags)] = Field(
        description='tags, such as {"lanes": "3", "maxspeed": null}'
    )

    @property
    def must_be_drawn(self) -> bool:
        """Return whether a geometry is required."""
        return False


class AddPole(Asked):
    """A pole at a point."""

    kind: Literal["pole", "lamp", "utility", "sign", "bollard"] = "pole"
    height_m: Metres | None = None

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("Point",)

    @model_validator(mode="after")
    def _is_possible(self) -> AddPole:
        low, high = KINDS_OF_POLES[self.kind][1]
        if self.height_m is not None and not low <= self.height_m <= high:
            raise wrong(
                f"has height_m: {self.height_m:g}, as a {self.kind}", f"{low:g} to {high:g} m"
            )
        return self

    def tags(self) -> dict[str, str]:
        """Return the correction as map tags."""
        return {**KINDS_OF_POLES[self.kind][0], **_height(self.height_m)}


class AddWall(Asked):
    """A wall, fence, hedge or guard rail along a line."""

    kind: _WALLS = "wall"
    height_m: Annotated[float, BeforeValidator(number_of), Field(ge=0.2, le=15)] | None = None
    thickness_m: Annotated[float, BeforeValidator(number_of), Field(ge=0.05, le=3)] | None = None
    material: Text | None = None

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("LineString",)

    @model_validator(mode="after")
    def _is_possible(self) -> AddWall:
        known = _MATERIALS.get(self.kind, ())
        if self.material is not None and self.material not in known:
            expected = f"one of {', '.join(known)}" if known else "none: it is always the same"
            raise wrong(f"has material: {self.material!r:.40}, as a {self.kind}", expected)
        if self.thickness_m is not None and self.kind not in ("wall", "hedge"):
            raise wrong(f"has thickness_m, as a {self.kind}", "the thickness of walls and hedges")
        return self

    def tags(self) -> dict[str, str]:
        """Return the correction as map tags."""
        tags = {"barrier": self.kind, **_height(self.height_m)}
        if self.thickness_m is not None:
            tags["width"] = f"{self.thickness_m:.10g}"
        return tags | ({"material": self.material} if self.material is not None else {})


class AddTree(Asked):
    """A tree at a point."""

    height_m: Annotated[float, BeforeValidator(number_of), Field(ge=1.5, le=80)] | None = None
    crown_m: Annotated[float, BeforeValidator(number_of), Field(ge=0.5, le=35)] | None = None
    leaves: Literal["broadleaved", "needleleaved"] | None = None

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("Point",)

    def tags(self) -> dict[str, str]:
        """Return the correction as map tags."""
        tags = {"natural": "tree", **_height(self.height_m)}
        if self.crown_m is not None:
            tags["diameter_crown"] = f"{self.crown_m:.10g}"
        return tags | ({"leaf_type": self.leaves} if self.leaves is not None else {})


class _Lane(Asked):
    """A lane on one side of a street: along a whole way, or along a drawn line."""

    element: ElementField | None = None
    side: Side = Field(description="left or right, as seen along the line, else along the way")
    kind: LaneKind = Field(description="driving, bus, bicycle, parking, shoulder or sidewalk")

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("LineString",)

    @property
    def must_be_drawn(self) -> bool:
        """Return whether a geometry is required."""
        return self.element is None

    @model_validator(mode="after")
    def _is_of_a_way(self) -> _Lane:
        if self.element is not None and self.element.kind != "way":
            raise wrong(f"is of {self.element}", "a way, such as way/123")
        return self


class AddLane(_Lane):
    """An additional lane, at the outer side of the existing ones."""

    width_m: Annotated[float, BeforeValidator(number_of), Field(gt=0, le=15)] | None = None

    @model_validator(mode="after")
    def _is_possible(self) -> AddLane:
        low, high = LANE_WIDTHS_M[self.kind]
        if self.width_m is not None and not low <= self.width_m <= high:
            raise wrong(
                f"has width_m: {self.width_m:g}, as a lane of kind {self.kind}",
                f"{low:g} to {high:g} m",
            )
        return self


#: Widths of lanes that can be built, metres.
LANE_WIDTHS_M = {
    "driving": (2.0, 8.0),
    "bus": (2.0, 8.0),
    "bicycle": (0.8, 5.0),
    "parking": (1.5, 7.0),
    "shoulder": (0.3, 5.0),
    "sidewalk": (0.8, 15.0),
}


class RemoveLane(_Lane):
    """Removal of the outermost lane of a kind."""


class RemoveElement(Asked):
    """Removal of an element of the map."""

    element: ElementField

    @property
    def must_be_drawn(self) -> bool:
        """Return whether a geometry is required."""
        return False


class RemoveThing(Asked):
    """Removal of trees, poles or walls: the nearest to a point, or all in an area."""

    what: Literal["tree", "pole", "wall"]
    radius_m: Annotated[float, BeforeValidator(number_of), Field(gt=0, le=100)] | None = None

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("Point", "Polygon")


class MoveCurb(Asked):
    """The true position of a street's curb, as a line."""

    @property
    def drawn_as(self) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("LineString",)


#: Class of each action and object; the empty text for actions without an object.
ACTIONS: Mapping[str, Mapping[str, type[Asked]]] = {
    "tag": {"": SetTags},
    "add": {"pole": AddPole, "wall": AddWall, "tree": AddTree, "lane": AddLane},
    "remove": {
        "": RemoveElement,
        **dict.fromkeys(("tree", "pole", "wall"), RemoveThing),
        "lane": RemoveLane,
    },
    "move": {"curb": MoveCurb},
}


def _height(height_m: float | None) -> dict[str, str]:
    return {} if height_m is None else {"height": f"{height_m:.10g}"}
