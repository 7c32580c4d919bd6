"""Poles: street lamps, utility poles, bus stops, bollards, and traffic signs with their plates."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.catalogue import Catalogue, street_objects
from urbantwin.scene.lamp import add_lamps, add_wall_lamps, seeded_lamps
from urbantwin.scene.piece import add_pieces
from urbantwin.scene.placement import (
    along_nearest,
    beside_carriageway,
    not_imported,
    on_ground,
    toward_carriageway,
)
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, columns, sweep
from urbantwin.scene.tag_values import count_of, length_m_of, yaw_of_direction
from urbantwin.site.corrections import REMOVED
from urbantwin.site.extract import OsmFeature

__all__ = ["pole_mesh"]

#: Sizes of urban streets (VwV-StVO size 2, MUTCD table 2B-1 rounded), metres.
DISC_M, OCTAGON_M, TRIANGLE_M, BOARD_M = 0.6, 0.75, 0.9, (0.6, 0.35)
HEIGHTS_M = {
    "disc": DISC_M,
    "octagon": OCTAGON_M,
    "up": 0.87 * TRIANGLE_M,
    "down": 0.87 * TRIANGLE_M,
    "board": BOARD_M[1],
}
MOST, GAP_M = 4, 0.03
#: Minimum height of plates, for every mapped height of their post, metres.
LOWEST_M = 1.5


def add_plates(
    assembly: Assembly,
    foot: NDArray[np.float64],
    tags: Mapping[str, str],
    part: int,
    yaw: float,
    top: float,
    off: float,
) -> None:
    """Add the plates of ``traffic_sign``, ``traffic_sign:2``, ... to a pole.

    Args:
        assembly: assembly to extend.
        foot: (3,) base of the pole, on the ground.
        tags: tags of the node.
        part: number of the pole's part.
        yaw: heading of the plates, radians.
        top: height of the upper edge of the first plate, metres.
        off: distance of the plates from the pole's axis, metres.
    """
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    for number, said in enumerate(_signs(tags)):
        shape = _shape(said, number)
        tall = HEIGHTS_M[shape]
        if number and top - tall < LOWEST_M:
            return
        middle = foot + [0, 0, top - tall / 2] + off * ahead
        assembly.add(_plate(shape, middle, ahead, yaw), "traffic-sign", "retroreflector", part)
        top -= tall + GAP_M


def stack_m(tags: Mapping[str, str]) -> float:
    """Return the total height of all plates of a node, metres."""
    shapes = [_shape(said, number) for number, said in enumerate(_signs(tags))]
    return sum(HEIGHTS_M[shape] + GAP_M for shape in shapes)


def _signs(tags: Mapping[str, str]) -> list[str]:
    """Return the codes of the plates, the uppermost first."""
    first = re.split(r"[;,](?![^\[]*\])", tags.get("traffic_sign", ""))
    further = [tags[key] for key in sorted(tags) if re.fullmatch(r"traffic_sign:\d", key)]
    return [said for said in (*first, *further) if said][:MOST] or ["sign"]


def _shape(said: str, number: int) -> str:
    """Return a plate's shape; without a word for it discs, and boards under the first."""
    word = said.lower().split(":")[-1]
    if word in ("stop", "206", "r1-1") and not number:
        return "octagon"
    if word in ("give_way", "yield", "205", "r1-2"):
        return "down"
    if word in ("hazard", "warning") or re.fullmatch(r"1\d\d(\D.*)?", word):
        return "up"  # Vienna Convention numbering of DE, FI, AT and others: 1xx are warnings
    if word in ("city_limit", "maxspeed", "overtaking"):
        return "board" if word == "city_limit" else "disc"
    if re.fullmatch(r"([3-9]\d\d|10\d\d).*", word) and (number or not word.startswith("3")):
        return "board"
    return "board" if number and count_of(word) is None and ":" not in said else "disc"


def _plate(
    shape: str, middle: NDArray[np.float64], ahead: NDArray[np.float64], yaw: float
) -> Solid:
    if shape == "board":
        return box(middle, [0.02, *BOARD_M], yaw)
    corners, first, radius = {
        "disc": (12, 15.0, DISC_M / 2),
        "octagon": (8, 22.5, OCTAGON_M / 2),
        "up": (3, 90.0, TRIANGLE_M / 3**0.5),
        "down": (3, -90.0, TRIANGLE_M / 3**0.5),
    }[shape]
    angle = np.radians(first + np.arange(corners) * 360.0 / corners)
    outline = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    # Seen along the path the outline must run counter-clockwise: left is to the left.
    return sweep([middle - 0.01 * ahead, middle + 0.01 * ahead], -outline * [1, -1])


#: Minimum distance of poles from carriageways, and their depth in the ground, metres.
KERB_M = 0.4
BURIED_M = 0.3
#: Pedestrians pass below plates (VwV-StVO to section 39: 2.0 m above sidewalks).
CLEAR_M = 2.0
#: A pole mapped within a carriageway is moved to its side, at most by this, metres.
FARTHEST_M = 8.0
#: Lamps farther than this from any carriageway belong to a path: no arm, and a lower pole.
ARM_REACH_M = 15.0

HUNG = "lamps hung or on walls, not drawn"
POWER_LINES = ("line", "minor_line")
HUNG_LAMPS = ("wall", "wall_mounted", "ceiling", "ground", "bollard")
#: Lamps on wires are drawn by ``wire_mesh``.
ON_WIRES = ("suspended", "catenary")
#: Names of poles in counts, and their street objects.
POLES = {
    "bus stops": "bus stop",
    "bollards": "bollard",
    "utility poles": "utility pole",
    "other poles": "other pole",
}
KINDS = ("street lamps", "bus stops", "bollards", "utility poles", "traffic signs", "other poles")


def pole_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    without: Geometry | None = None,
    decks: Geometry | None = None,
    deck_height: GroundHeight | None = None,
    objects: Catalogue | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build poles and the objects on them, except traffic signals (``signal_pole``).

    Plates have the class ``traffic-sign``, other parts ``pole``. Streets with ``lit=yes`` but
    without a mapped lamp get lamps at assumed positions.

    Args:
        features: the map's features, site frame.
        region: objects outside it are left out.
        ground_height: heights of the ground.
        carriageway: area without poles; lamps extend towards it.
        without: area in which imported geometry contains the poles.
        decks: decks over the ground in plan: mapped lamps and signs are placed on them.
        deck_height: heights of decks; of the ground elsewhere.
        objects: street objects; those of the package if not given.

    Returns:
        The mesh, ``part`` 1, 2, ... per pole, and counts of objects built or left out.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    known = objects or street_objects()
    kinds: dict[str, list[OsmFeature]] = {name: [] for name in (*KINDS, HUNG)}
    for feature in not_imported([f for f in features if _kind(f.tags, known)], without):
        name = _kind(feature.tags, known)
        if name and isinstance(feature.geometry, Point) and region.covers(feature.geometry):
            kinds.setdefault(name, []).append(feature)
    houses = [
        f.geometry for f in features
        if "building" in f.tags and f.geometry.geom_type.endswith("Polygon")
    ]  # fmt: skip
    hung = kinds.pop(HUNG)
    notes["lamps on walls"] = add_wall_lamps(assembly, hung, houses, ground_height, known)
    notes[HUNG] = len(hung) - notes["lamps on walls"]
    for name, found in kinds.items():
        if not found:
            continue
        mapped = np.array([[f.geometry.x, f.geometry.y] for f in found])
        # A bollard within a carriageway bars it: roads are drivable, so it is left out.
        reach = 0.0 if name == "bollards" else FARTHEST_M
        xy = beside_carriageway(mapped, carriageway, margin_m=KERB_M, farthest_m=reach)
        keep = np.isfinite(xy[:, 0])
        notes["poles moved off carriageways"] += int((keep & (xy != mapped).any(axis=1)).sum())
        notes["poles on carriageways, left out"] += int((~keep).sum())
        if not keep.any():
            continue
        on_decks = name in ("street lamps", "traffic signs")
        height = deck_height if on_decks and deck_height else ground_height
        feet = on_ground(xy[keep], height(xy[keep]))
        tags = [f.tags for f, kept in zip(found, keep, strict=True) if kept]
        first = assembly.parts + 1
        road = toward_carriageway(feet[:, :2], carriageway, farthest_m=ARM_REACH_M)
        _add_kind(assembly, name, feet, tags, features, carriageway, known)
        signs = [k for k, own in enumerate(tags) if _carries_signs(name, own)]
        for k in signs:
            add_plates(assembly, feet[k], tags[k], first + k, _facing(tags[k], road[k]), 2.9, 0.13)
        notes["signs on other poles"] += len(signs)
        notes[name] += len(feet)
    taken = shapely.union_all([h for h in houses if region.intersects(h)])
    for other in (without, decks):
        if other is not None:
            taken = shapely.union(taken, other)
    lamps = seeded_lamps(features, region, carriageway, taken)
    if len(lamps):
        feet = on_ground(lamps, ground_height(lamps))
        add_lamps(assembly, feet, [{}] * len(feet), carriageway, known)
        notes["street lamps seeded where lit=yes"] = len(lamps)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _kind(tags: dict[str, str], known: Catalogue) -> str | None:
    """Return the kind of pole that a node's tags describe."""
    if REMOVED in tags:
        return None
    highway, man_made = tags.get("highway"), tags.get("man_made")
    mounts = {tags.get(k) for k in ("lamp_mount", "support", "light:mount")}
    tests = {
        HUNG: highway == "street_lamp" and bool(mounts & set(HUNG_LAMPS)),
        "street lamps": highway == "street_lamp" and not mounts & set(ON_WIRES),
        "bus stops": highway == "bus_stop",
        "bollards": tags.get("barrier") == "bollard",
        "utility poles": tags.get("power") == "pole"
        or man_made in ("utility_pole", "telecommunication_pole"),
        "traffic signs": tags.get("traffic_sign", "no") != "no" and highway != "traffic_signals",
        "other poles": man_made in ("pole", "flagpole", "mast")
        or tags.get("power") == "catenary_mast",
    }
    found = next((name for name, holds in tests.items() if holds), None)
    if found not in (HUNG, "street lamps") and (own := known.of(tags, "pole")):
        return own.counted
    return found


def _carries_signs(name: str, tags: dict[str, str]) -> bool:
    return name in ("street lamps", "utility poles") and tags.get("traffic_sign", "no") != "no"


def _facing(tags: dict[str, str], toward: float) -> float:
    """Return the heading of a sign: as mapped, otherwise along the road beside it."""
    said = yaw_of_direction(tags.get("traffic_sign:direction") or tags.get("direction"))
    return float(np.nan_to_num(toward)) + np.pi / 2 if said is None else said


def _add_kind(
    assembly: Assembly,
    name: str,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    features: Sequence[OsmFeature],
    carriageway: Geometry,
    known: Catalogue,
) -> None:
    """Add poles of one kind at (N, 3) points on the ground."""
    road = toward_carriageway(feet[:, :2], carriageway, farthest_m=ARM_REACH_M)
    if name == "street lamps":
        add_lamps(assembly, feet, tags, carriageway, known)
        return
    if name == "traffic signs":
        _add_signs(assembly, feet, tags, road)
        return
    if name == "utility poles":
        lines = [f.geometry for f in features if f.tags.get("power") in POWER_LINES]
        along = along_nearest(feet[:, :2], lines, farthest_m=2.0)
        road = np.where(np.isfinite(along), along + np.pi / 2, road)
    for foot, own, yaw in zip(feet, tags, np.nan_to_num(road).tolist(), strict=True):
        kind = known[POLES[name]] if name in POLES else known.of(own, "pole")
        assert kind is not None
        add_pieces(assembly, kind.pieces(own), foot, yaw)


def _add_signs(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    road: NDArray[np.float64],
) -> None:
    """Add signs: plates with their mapped heading, otherwise along the road beside them."""
    for foot, own, yaw in zip(feet, tags, road, strict=True):
        usual = max(2.6, CLEAR_M + stack_m(own))
        height = min(max(length_m_of(own.get("height")) or usual, 1.0), 6.0)
        part = assembly.new_part()
        pole = columns(foot - [0, 0, BURIED_M], height + BURIED_M, 0.035, 0.035)
        assembly.add(pole, "pole", "metal-painted", part)
        add_plates(assembly, foot, own, part, _facing(own, float(yaw)), height, 0.05)
