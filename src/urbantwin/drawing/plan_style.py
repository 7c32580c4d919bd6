"""Styles of a plan: dark as in all pictures, or on white paper for print."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.drawing import style

__all__ = ["DARK", "LANE_NAMES", "PAPER", "Look"]

#: Kinds of lanes in a legend, in its order.
LANE_NAMES = {
    "driving": "lane",
    "bus": "bus lane",
    "bicycle": "bicycle lane",
    "parking": "parking",
    "shoulder": "shoulder",
    "sidewalk": "sidewalk",
    "median": "median",
    "island": "island",
}


@dataclass(frozen=True)
class Look:
    """Colours in matplotlib's form.

    Attributes:
        page: area around the map.
        ground: ground of the region.
        ink: text and the map's frame.
        muted: less important text.
        halo: outline of text on the map.
        building, green: surrounding buildings and plants.
        edge: outlines of buildings.
        lanes: fill by kind of lane; ``junction`` within junctions.
        paint: markings.
        curb: curbs.
        direction: arrows that only show the direction of a lane.
        signal: heads of signals.
        sensor: sensors.
        correction: corrections by the user.
    """

    page: str
    ground: str
    ink: str
    muted: str
    halo: str
    building: str
    green: str
    edge: str
    lanes: dict[str, str]
    paint: str
    curb: str
    direction: str
    signal: str
    sensor: str
    correction: str


DARK = Look(
    page=style.PAPER,
    ground="#18202a",
    ink=style.INK,
    muted=style.MUTED,
    halo=style.PAPER,
    building="#34404d",
    green="#2f5a41",
    edge="#465563",
    lanes={
        "driving": "#59626d",
        "junction": "#59626d",
        "bus": "#7d6a42",
        "bicycle": "#47705e",
        "parking": "#4b5878",
        "shoulder": "#4c545e",
        "sidewalk": "#a9a498",
        "median": "#8b8579",
        "island": "#8b8579",
    },
    paint="#ffffff",
    curb="#dcd7ca",
    direction="#aab3bd",
    signal="#ff5a4f",
    sensor=style.ACCENT,
    correction="#5fd7ff",
)

PAPER = Look(
    page="#ffffff",
    ground="#f4f2ec",
    ink="#16191d",
    muted="#5c646d",
    halo="#ffffff",
    building="#d9d5ce",
    green="#bcd8b0",
    edge="#a8a29a",
    lanes={
        "driving": "#7b828a",
        "junction": "#7b828a",
        "bus": "#a08650",
        "bicycle": "#a8605a",
        "parking": "#6f7fa3",
        "shoulder": "#8d939a",
        "sidewalk": "#e3ddd0",
        "median": "#cfc8b8",
        "island": "#cfc8b8",
    },
    paint="#ffffff",
    curb="#3f4348",
    direction="#a9afb6",
    signal="#d3281c",
    sensor="#c47f00",
    correction="#7a1fa2",
)
