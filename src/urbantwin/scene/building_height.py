"""Heights and materials of buildings, read from their tags.

Follows Simple 3D Buildings (https://wiki.openstreetmap.org/wiki/Simple_3D_Buildings): ``height``
is from the ground to the top of the roof, ``min_height`` from the ground to the underside;
``building:levels`` counts from the ground and leaves out the levels within the roof.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["LEVEL_M", "ROOF_TYPES", "Rise", "building_materials", "building_rise", "building_type"]

#: Storey height if only levels are mapped, metres.
LEVEL_M = 3.2
#: Roofs without walls.
ROOF_TYPES = ("roof", "carport", "canopy")
HIGHEST_M = 900.0
MOST_LEVELS = 200.0

#: Heights if no usable height is mapped, metres, by ``building`` value.
DEFAULT_HEIGHT_M = {
    **dict.fromkeys(("apartments", "dormitory", "office", "commercial", "hotel"), 12.8),
    **dict.fromkeys(("residential", "mixed_use", "hospital", "university", "government"), 9.6),
    **dict.fromkeys(("school", "civic", "public", "college", "train_station"), 9.6),
    **dict.fromkeys(("industrial", "warehouse", "hangar", "manufacture", "supermarket"), 7.0),
    **dict.fromkeys(("house", "detached", "semidetached_house", "terrace", "farm"), 6.4),
    **dict.fromkeys(("retail", "kindergarten", "pavilion", "service", "barn"), 4.5),
    **dict.fromkeys(("garage", "garages", "shed", "hut", "cabin", "kiosk", "toilets"), 2.8),
    **dict.fromkeys(("carport", "canopy", "greenhouse", "transformer_tower"), 3.0),
    **dict.fromkeys(("church", "cathedral", "mosque", "temple", "synagogue"), 15.0),
    "chapel": 8.0,
    "roof": 4.5,
}
OTHER_HEIGHT_M = 6.4
SMALL_M2, SMALL_HEIGHT_M = 30.0, 2.8

WALLS = {
    **dict.fromkeys(("brick", "bricks", "clinker", "masonry"), "brick"),
    **dict.fromkeys(("concrete", "cement_block", "cement", "reinforced_concrete"), "concrete"),
    **dict.fromkeys(("stone", "sandstone", "limestone", "granite", "marble"), "stone"),
    **dict.fromkeys(("plaster", "stucco", "render", "rendered"), "plaster"),
    **dict.fromkeys(("glass", "mirror"), "glass"),
    **dict.fromkeys(("wood", "timber_framing", "timber", "bamboo"), "wood"),
    **dict.fromkeys(("metal", "steel", "metal_plates", "tin", "aluminium"), "metal-painted"),
}
ROOFS = {
    **WALLS,
    **dict.fromkeys(("roof_tiles", "tile", "tiles"), "roof-tile"),
    **dict.fromkeys(("tar_paper", "asphalt", "asphalt_shingle", "bitumen"), "roofing-felt"),
    **dict.fromkeys(("eternit", "asbestos"), "concrete"),
    "slate": "slate",
    "gravel": "gravel",
    **dict.fromkeys(("copper", "zinc", "lead", "sheet_metal"), "metal-painted"),
    **dict.fromkeys(("grass", "plants"), "grass"),
    "thatch": "wood",
}
GLASS_TYPES = ("greenhouse", "conservatory")


@dataclass(frozen=True)
class Rise:
    """Heights of a building's underside and top above its lowest ground, metres.

    Attributes:
        low_m: its underside.
        high_m: its top.
        eaves_m: top of the storeys below the roof, if only levels or nothing is mapped; a sloped
            roof then starts there, for every ``high_m``.
        storey_m: height of a storey.
    """

    low_m: float
    high_m: float
    eaves_m: float | None = None
    storey_m: float = LEVEL_M


def building_type(tags: Mapping[str, str]) -> str:
    """Return the more specific value of ``building:part`` and ``building``."""
    values = [tags.get("building:part", "yes"), tags.get("building", "yes")]
    return next((value for value in values if value not in ("yes", "")), "yes")


def building_rise(
    tags: Mapping[str, str],
    outline_tags: Mapping[str, str],
    area_m2: float,
    notes: Counter[str],
) -> Rise:
    """Return the rise of a building or part; ``notes`` counts assumptions.

    Args:
        tags: tags of the building or the part.
        outline_tags: tags of the building of a part, used if the part's tags have no height.
        area_m2: area of the footprint.
        notes: counter of assumptions.
    """
    storey = LEVEL_M
    high = _mapped_height(tags, notes)
    levels = _mapped_levels(tags)
    eaves: float | None = None
    if high is not None and levels is not None and 2.2 <= high / levels <= 6.0:
        storey = high / levels
    if high is None and levels is not None:
        high = levels * LEVEL_M
        eaves = min(count_of(tags.get("building:levels")) or 0.0, MOST_LEVELS) * LEVEL_M
        notes["height from levels"] += 1
    if high is None:
        high = _mapped_height(outline_tags, Counter())
        outline_levels = _mapped_levels(outline_tags)
        if high is None and outline_levels is not None:
            high = outline_levels * LEVEL_M
        if high is not None:
            notes["height of a part from its building"] += 1
    if high is None:
        kind = building_type(tags)
        small = area_m2 < SMALL_M2 and kind == "yes"
        high = SMALL_HEIGHT_M if small else DEFAULT_HEIGHT_M.get(kind, OTHER_HEIGHT_M)
        eaves = high
        notes["height assumed from building type"] += 1

    low = length_m_of(tags.get("min_height"))
    if low is None:
        lowest_level = count_of(tags.get("building:min_level"))
        low = 0.0 if lowest_level is None else min(lowest_level, MOST_LEVELS) * storey
    if low > high - 0.2:
        notes["min_height not below height, ignored"] += 1
        low = 0.0
    return Rise(low, high, eaves, storey)


def building_materials(tags: Mapping[str, str], outline_tags: Mapping[str, str]) -> tuple[str, str]:
    """Return the names of the walls' and the roof's material."""
    kind = building_type(tags)
    if kind == "yes":
        kind = building_type(outline_tags)
    wall, roof = ("glass", "glass") if kind in GLASS_TYPES else ("plaster", "roofing")
    for source in (outline_tags, tags):
        wall = WALLS.get(source.get("building:material", ""), wall)
        wall = WALLS.get(source.get("building:facade:material", ""), wall)
        roof = ROOFS.get(source.get("roof:material", ""), roof)
    return wall, roof


def _mapped_height(tags: Mapping[str, str], notes: Counter[str]) -> float | None:
    for key in ("height", "building:height"):
        if key in tags:
            height = length_m_of(tags[key])
            if height is not None and height <= HIGHEST_M:
                return height
            notes["height tag not understood"] += 1
    return None


def _mapped_levels(tags: Mapping[str, str]) -> float | None:
    """Return the number of storeys including those of the roof, if mapped."""
    levels = count_of(tags.get("building:levels"))
    if levels is None:
        return None
    levels += count_of(tags.get("roof:levels")) or 0.0
    return levels if 0 < levels <= MOST_LEVELS else None
