"""Roof tags of Simple 3D Buildings: shape, height, pitch, direction.

Simple 3D Buildings (https://wiki.openstreetmap.org/wiki/Simple_3D_Buildings): ``roof:shape``,
``roof:height``, ``roof:angle``, ``roof:levels``, ``roof:direction`` (direction of the slope) and
``roof:orientation`` (the ridge along or across the longer side).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from urbantwin.scene.tag_values import angle_deg_of, count_of, length_m_of, yaw_of_direction

__all__ = ["SHAPES", "RoofTags", "roof_tags", "roof_yaw"]

#: The shapes that are built.
SHAPES = (
    "flat gabled hipped pyramidal skillion dome round half-hipped gambrel mansard saltbox "
    "side_hipped cone onion butterfly"
).split()

#: Shapes used for other values. "many" and "complex" mean that no shape fits.
SYNONYMS = {
    **dict.fromkeys(("gable", "pitched", "cross_gabled", "crosspitched", "dormer"), "gabled"),
    **dict.fromkeys(("double_pitch", "gabled_row", "gabled_height_moved"), "gabled"),
    **dict.fromkeys(("hip", "hipped_and_gabled", "tented"), "hipped"),
    **dict.fromkeys(("half_hipped", "halfhipped", "half-hip", "jerkinhead"), "half-hipped"),
    **dict.fromkeys(("side_half-hipped", "bellcast_gable"), "half-hipped"),
    **dict.fromkeys(("side_hipped", "side-hipped"), "side_hipped"),
    **dict.fromkeys(("pyramid", "spire", "pyramidical", "helm"), "pyramidal"),
    **dict.fromkeys(("lean_to", "shed", "mono_pitched", "monopitch", "slanted"), "skillion"),
    **dict.fromkeys(("half_pitched", "skillion_roof"), "skillion"),
    **dict.fromkeys(("barrel", "barrel_vault", "arched", "vaulted", "half_round"), "round"),
    **dict.fromkeys(("hemisphere", "domed", "cupola"), "dome"),
    **dict.fromkeys(("conical", "circular"), "cone"),
    **dict.fromkeys(("french", "mansarde"), "mansard"),
    **dict.fromkeys(("double_saltbox", "quadruple_saltbox"), "saltbox"),
    **dict.fromkeys(("terrace", "roof_terrace", "no", "yes", "horizontal"), "flat"),
}

#: Pitch of roofs without a mapped height, degrees.
PITCH_DEG = {"skillion": 10.0, "butterfly": 10.0, "pyramidal": 35.0, "saltbox": 30.0}
OTHER_PITCH_DEG = 33.0
#: Maximum height of a roof of assumed height, metres, so that wide roofs are flatter; domes, twice.
HIGHEST_M = 6.0
#: Ratio of height to half the span if not mapped: half-circles, and roofs with two pitches.
RISE = {"round": 0.6, "dome": 1.0, "onion": 2.0, "cone": 1.0, "gambrel": 0.9, "mansard": 0.9}
#: No roof is higher than this, metres.
STEEPEST_M = 150.0
#: Roofs drawn with a slope over the whole span.
ONE_SIDED = ("skillion",)
STOREY_M = 3.2
#: Maximum angle between a mapped direction and a wall's for use of the wall's: words and degrees.
WORD_DEG, DEGREES_DEG = 23.0, 6.0


@dataclass(frozen=True)
class RoofTags:
    """A roof's tags: its shape and, if mapped, height or pitch."""

    shape: str
    height_m: float | None
    pitch_deg: float | None

    def rise_m(self, span_m: float) -> float:
        """Return the roof's height over a span; if it is not mapped, from the usual pitch."""
        if self.shape == "flat":
            return 0.0
        if self.height_m is not None:
            return self.height_m
        run = span_m if self.shape in ONE_SIDED else span_m / 2
        if self.pitch_deg is not None:
            return min(run * math.tan(math.radians(self.pitch_deg)), STEEPEST_M)
        if self.shape in RISE:
            return min(run * RISE[self.shape], 2 * HIGHEST_M)
        pitch = PITCH_DEG.get(self.shape, OTHER_PITCH_DEG)
        return min(run * math.tan(math.radians(pitch)), HIGHEST_M)


def roof_tags(tags: Mapping[str, str], notes: Counter[str]) -> RoofTags:
    """Read a building's roof; ``notes`` counts assumptions."""
    height = length_m_of(tags.get("roof:height"))
    pitch = angle_deg_of(tags.get("roof:angle"))
    levels = count_of(tags.get("roof:levels"))
    if height is None and "roof:height" in tags and tags["roof:height"].strip() not in ("0", "0 m"):
        notes["roof:height not understood"] += 1
    if height is not None and height > STEEPEST_M:
        notes["roof:height not understood"] += 1
        height = None
    if pitch is not None and not 0 < pitch < 85:
        pitch = None
    mapped = tags.get("roof:shape", tags.get("building:roof:shape", "")).strip().lower()
    mapped = mapped.replace(" ", "_")
    shape = SYNONYMS.get(mapped, mapped)
    if shape not in SHAPES:
        if mapped:
            notes[f"roof shape {_plain(mapped)} not known"] += 1
        # Levels within the roof, or a height of it, are mapped of roofs with slopes only.
        sloped = bool(levels) or height is not None or pitch is not None
        shape = "gabled" if sloped else "flat"
        if sloped:
            notes["roof shape assumed: gabled"] += 1
    elif shape != mapped:
        notes[f"roof shape {_plain(mapped)} built as {shape}"] += 1
    if height is None and pitch is None and levels:
        height = levels * STOREY_M
    return RoofTags(shape, height, pitch)


def roof_yaw(tags: Mapping[str, str], footprint: Polygon) -> tuple[float, bool]:
    """Return the direction of a roof's slope, and whether it is mapped.

    Args:
        tags: tags of the building.
        footprint: its outline, site frame.

    Returns:
        Yaw in radians, counter-clockwise from east. Without ``roof:direction`` the ridge is along
        the longer side of the smallest rectangle, or across for ``roof:orientation=across``.
    """
    text = tags.get("roof:direction", tags.get("roof:slope:direction"))
    yaw = yaw_of_direction(text)
    if yaw is not None:
        word = text is not None and not any(c.isdigit() for c in text)
        return _snapped(yaw, footprint, math.radians(WORD_DEG if word else DEGREES_DEG)), True
    corners = shapely.get_coordinates(shapely.oriented_envelope(footprint))
    sides = np.diff(corners[:3], axis=0)
    length = np.hypot(*sides.T)
    longer = sides[int(length[1] > length[0] * (1 + 1e-6))]
    yaw = math.atan2(longer[1], longer[0]) - math.pi / 2
    if tags.get("roof:orientation") == "across":
        yaw += math.pi / 2
    return _snapped(yaw, footprint, math.radians(2.0)), False


def _snapped(yaw: float, footprint: Polygon, within: float) -> float:
    """Return a direction aligned to the nearest wall direction, if within a limit."""
    xy = shapely.get_coordinates(footprint.exterior)
    edge = np.diff(xy, axis=0)
    length = np.hypot(*edge.T)
    edge, length = edge[length > 0.5], length[length > 0.5]
    if not len(edge):
        return yaw
    turn = np.arctan2(edge[:, 1], edge[:, 0]) - yaw
    off = (turn + math.pi / 4) % (math.pi / 2) - math.pi / 4
    near = np.abs(off) <= within
    if not near.any():
        return yaw
    # The longest of the walls within the limit; among equal lengths the nearest direction.
    best = np.lexsort((np.abs(off[near]), -np.round(length[near], 1)))[0]
    return float(yaw + off[near][best])


def _plain(text: str) -> str:
    """Return a tag's value with only the characters allowed in a note."""
    return "".join(c for c in text[:24] if c.isalnum() or c in "_-.")
