"""Kinds of features in a sketch: their properties, and the tags that they are converted to.

The tags are OpenStreetMap's, so that sketches and maps are processed alike.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from urbantwin.site.access import CYCLE_TRACK
from urbantwin.site.drawn_values import Count, Metres, Text, Truth, number_of
from urbantwin.site.yaml_document import nearest, wrong

__all__ = [
    "KINDS",
    "POINTS_LINES_AREAS",
    "Crossing",
    "Drawn",
    "Junction",
    "StopLine",
    "Street",
    "Turn",
]

#: Default widths of a lane and of a cycle track's lane, metres.
LANE_M, CYCLE_LANE_M = 3.25, 1.5
#: Smallest widths of a lane and of a cycle track's lane, metres.
NARROWEST_M, NARROWEST_CYCLE_M = 2.0, 1.0
POINTS_LINES_AREAS = ("Point", "LineString", "Polygon")
#: Arrows on a lane (OSM wiki, "Key:turn").
TURNS = (
    "left", "slight_left", "sharp_left", "through", "right", "slight_right", "sharp_right",
    "reverse", "merge_to_left", "merge_to_right", "none",
)  # fmt: skip
STREETS = (
    "motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential",
    "living_street", "service", CYCLE_TRACK,
)  # fmt: skip


class Drawn(BaseModel):
    """A kind of feature; subclasses define its properties and geometry types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    kind: str
    name: Text | None = None

    @classmethod
    def drawn_as(cls) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("LineString",)

    @abstractmethod
    def tags(self) -> dict[str, str]:
        """Return the feature as map tags."""


def _each(text: str, lanes: int, what: str) -> list[str]:
    found = [one.strip() for one in text.split("|")]
    if len(found) != lanes:
        raise wrong(f"is {text!r}, for {len(found)} lanes", f"{what} of {lanes} lanes, as a|b|c")
    return found


class Street(Drawn):
    """A carriageway along its centre line, in driving direction if one-way."""

    lanes: Count = 1
    lanes_back: Count = 0
    lane_width_m: Text = ""
    lane_width_back_m: Text = ""
    turns: Text = ""
    turns_back: Text = ""
    speed_kmh: Annotated[float, BeforeValidator(number_of), Field(gt=0, le=250)] | None = None
    road_class: Text = Field("secondary", alias="class")
    sidewalk: Literal["left", "right", "both", "none"] | None = None
    cycle_lane: Literal["left", "right", "both", "none"] | None = None
    layer: Annotated[int, BeforeValidator(number_of), Field(ge=-5, le=5)] = 0
    surface: Text | None = None

    @model_validator(mode="after")
    def _lanes_agree(self) -> Street:
        if self.lanes < 1:
            raise wrong(f"has {self.lanes} lanes", "1 to 9, drawn the way that they are driven")
        if self.road_class not in STREETS:
            raise wrong(f"is of class {self.road_class!r}", nearest(self.road_class, STREETS))
        if self.is_cycle_track and (self.cycle_lane, self.sidewalk) != (None, None):
            raise wrong(
                "is a cycle track with a cycle lane or a sidewalk",
                "neither; kind: footway beside it, for people on foot",
            )
        self.tags()
        return self

    @property
    def is_cycle_track(self) -> bool:
        """Whether it is for bicycles only."""
        return self.road_class == CYCLE_TRACK

    @property
    def half_width_m(self) -> float:
        """Half the width of its lanes, metres."""
        text, usual = self.lane_width_m, CYCLE_LANE_M if self.is_cycle_track else LANE_M
        if "|" in text:
            wide = sum(float(part) for part in text.split("|"))
        else:
            wide = self.lanes * float(text or usual)
        return (wide + self.lanes_back * float(self.lane_width_back_m or usual)) / 2

    def tags(self) -> dict[str, str]:
        """Return the feature as map tags."""
        tags = {"highway": self.road_class, "lanes": str(self.lanes + self.lanes_back)}
        least = NARROWEST_CYCLE_M if self.is_cycle_track else NARROWEST_M
        if not self.lanes_back:
            if self.turns_back or self.lane_width_back_m:
                raise wrong("has no lanes back, and says what they are", "lanes_back: 1 or more")
            tags |= {
                "oneway": "yes",
                **_lane_tags(self.lanes, self.lane_width_m, self.turns, "", least),
            }
        else:
            same = "" if "|" in self.lane_width_m else self.lane_width_m
            back = self.lane_width_back_m or same
            tags |= {
                "oneway": "no",
                "lanes:forward": str(self.lanes),
                "lanes:backward": str(self.lanes_back),
                **_lane_tags(self.lanes, self.lane_width_m, self.turns, ":forward", least),
                **_lane_tags(self.lanes_back, back, self.turns_back, ":backward", least),
            }
        if self.speed_kmh is not None:
            tags["maxspeed"] = f"{self.speed_kmh:g}"
        if self.sidewalk is not None:
            tags["sidewalk"] = "no" if self.sidewalk == "none" else self.sidewalk
        if self.cycle_lane not in (None, "none"):
            side = "" if self.cycle_lane == "both" else f":{self.cycle_lane}"
            tags[f"cycleway{side}"] = "lane"
        if self.layer:
            tags["layer"] = str(self.layer)
            tags["bridge" if self.layer > 0 else "covered"] = "yes"
        optional = {"surface": self.surface, "name": self.name}
        return tags | {key: value for key, value in optional.items() if value}


def _lane_tags(lanes: int, width: str, turns: str, way: str, least: float) -> dict[str, str]:
    """Return the tags of the lanes of one direction, from left to right in driving direction.

    ``least``: smallest width of a lane, metres.
    """
    tags = {}
    if width:
        widths = _each(width, lanes, "widths") if "|" in width else [width] * lanes
        for one in widths:
            if not _is_lane_width(one, least):
                raise wrong(f"has a lane of {one!r} m", f"{least:g} to 8 m")
        tags[f"width:lanes{way}"] = "|".join(widths)
    if turns:
        arrows = _each(turns, lanes, "turns")
        for one in {turn for lane in arrows for turn in lane.split(";") if turn}:
            if one not in TURNS:
                raise wrong(f"has a lane that turns {one!r}", nearest(one, TURNS))
        tags[f"turn:lanes{way}"] = "|".join(arrows)
    return tags


def _is_lane_width(text: str, least: float) -> bool:
    value = number_of(text)
    return isinstance(value, int | float) and least <= value <= 8.0


class Turn(Street):
    """A path through a junction, from the end of a street to the start of another.

    It connects with other lines at its ends only, so that no turn arises where two of them cross.
    """

    @model_validator(mode="after")
    def _is_one_way(self) -> Turn:
        if self.lanes_back:
            raise wrong(f"has {self.lanes_back} lanes back", "a turn of its own for each direction")
        return self

    def tags(self) -> dict[str, str]:
        """Return the feature as map tags (OSM wiki, "Tag:junction=yes")."""
        return super().tags() | {"junction": "yes", "sidewalk": "no"}


class StopLine(Drawn):
    """Stop line of a street's lanes: a line across them, or a point on the street."""

    signals: Truth = True
    sign: Literal["stop", "give_way"] | None = None

    @classmethod
    def drawn_as(cls) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("LineString", "Point")

    def tags(self) -> dict[str, str]:
        """Return the tags of a map node, without direction."""
        if self.sign is not None:
            return {"highway": self.sign}
        return {"highway": "traffic_signals"} if self.signals else {}


class Crossing(Drawn):
    """A crossing: a line along the walking direction, over all streets that it crosses."""

    signals: Truth = False
    markings: Literal["zebra", "lines", "dashes", "dots", "none"] | None = None
    width_m: Metres | None = None
    island: Truth = False

    def tags(self) -> dict[str, str]:
        """Return the tags of a map node."""
        kind = "traffic_signals" if self.signals else "marked"
        tags = {"highway": "crossing", "crossing": kind}
        if self.markings is not None:
            tags["crossing:markings"] = "no" if self.markings == "none" else self.markings
        elif not self.signals:
            tags["crossing"] = "unmarked"
        if self.width_m is not None:
            tags["crossing:width"] = f"{self.width_m:g}"
        return tags | ({"crossing:island": "yes"} if self.island else {})


class Junction(Drawn):
    """An area in which streets form one junction."""

    signals: Truth = False

    @classmethod
    def drawn_as(cls) -> tuple[str, ...]:
        """Return the allowed types of geometry."""
        return ("Polygon",)

    def tags(self) -> dict[str, str]:
        """Return the tags of every node in the area where streets meet."""
        return {"highway": "traffic_signals"} if self.signals else {}


class Footway(Drawn):
    """A path for pedestrians."""

    width_m: Metres | None = None

    def tags(self) -> dict[str, str]:
        """Return the feature as map tags."""
        wide = {"width": f"{self.width_m:g}"} if self.width_m is not None else {}
        return {"highway": "footway", **wide}


#: Tags of simple objects, which have a height only, and their types of geometry.
THINGS: Mapping[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "building": (("Polygon",), {"building": "yes"}),
    "wall": (("LineString",), {"barrier": "wall"}),
    "fence": (("LineString",), {"barrier": "fence"}),
    "hedge": (("LineString",), {"barrier": "hedge"}),
    "tree": (("Point",), {"natural": "tree"}),
    "tree_row": (("LineString",), {"natural": "tree_row"}),
    "wood": (("Polygon",), {"natural": "wood"}),
    "grass": (("Polygon",), {"landuse": "grass"}),
    "island": (("Polygon",), {"area:highway": "traffic_island", "kerb": "raised"}),
    "lamp": (("Point",), {"highway": "street_lamp"}),
    "advertising_column": (("Point",), {"advertising": "column"}),
}


class Thing(Drawn):
    """An object beside streets, or a ground cover."""

    height_m: Metres | None = None
    material: Text | None = None
    surface: Text | None = None

    def tags(self) -> dict[str, str]:
        """Return the feature as map tags."""
        tags = dict(THINGS[self.kind][1])
        if self.height_m is not None:
            tags["height"] = f"{self.height_m:g}"
        optional = {"material": self.material, "surface": self.surface, "name": self.name}
        return tags | {key: value for key, value in optional.items() if value}


#: Class that parses the properties of each kind of feature; ``osm``: plain tags.
KINDS: Mapping[str, type[Drawn] | None] = {
    "street": Street,
    "turn": Turn,
    "stop_line": StopLine,
    "crossing": Crossing,
    "junction": Junction,
    "footway": Footway,
    **dict.fromkeys(THINGS, Thing),
    "osm": None,
}
