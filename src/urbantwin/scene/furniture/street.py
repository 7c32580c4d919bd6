"""Furniture along streets: seats, bins, boxes, boards, meters, hydrants.

Sizes are of common products; docs/method/scene.md lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from urbantwin.scene.furniture.piece import Piece, bar, block, drum
from urbantwin.scene.tag_values import count_of, length_m_of

__all__ = ["STREET", "Build"]

Tags = Mapping[str, str]
Build = Callable[[Tags], list[Piece]]


def _height(tags: Tags, usual: float, most: float) -> float:
    return min(max(length_m_of(tags.get("height")) or usual, 0.2), most)


def bench(tags: Tags) -> list[Piece]:
    """Return a bench, 1.8 m long or 0.6 m per seat."""
    seats = count_of(tags.get("seats")) or 3
    long = min(length_m_of(tags.get("length")) or 0.6 * seats, 8.0)
    material = {"metal": "metal-painted", "concrete": "concrete", "stone": "stone"}.get(
        tags.get("material", ""), "wood"
    )
    pieces = [block([0, 0, 0.40], [0.45, long, 0.05], material)]
    if tags.get("backrest") != "no":
        pieces.append(block([-0.22, 0, 0.50], [0.05, long, 0.35], material))
        pieces += [
            block([-0.22, side * (long / 2 - 0.2), 0.45], [0.05, 0.05, 0.05], "metal-dark")
            for side in (1, -1)
        ]
    for side in (1, -1):
        pieces.append(block([0, side * (long / 2 - 0.2), 0], [0.4, 0.08, 0.40], "metal-dark"))
    return pieces


def waste_basket(_tags: Tags) -> list[Piece]:
    """Return a litter bin of 50 litres."""
    return [drum([0, 0, 0], 0.9, 0.2, "metal-painted", top=0.22)]


def container(tags: Tags) -> list[Piece]:
    """Return a container of 1100 litres (EN 840)."""
    return [block([0, 0, 0], [1.07, 1.37, _height(tags, 1.35, 3.0)], "plastic")]


def wheeled_bin(_tags: Tags) -> list[Piece]:
    """Return a bin of 240 litres on wheels (EN 840-1)."""
    return [block([0, 0, 0], [0.74, 0.58, 1.07], "plastic")]


def hydrant(tags: Tags) -> list[Piece]:
    """Return a pillar hydrant; those below ground or in walls are not drawn."""
    if tags.get("fire_hydrant:type", "pillar") != "pillar":
        return []
    return [
        drum([0, 0, 0], 0.75, 0.12, "metal-painted"),
        drum([0, 0, 0.75], 0.12, 0.14, "metal-painted", top=0.04),
        bar([0, -0.2, 0.5], [0, 0.2, 0.5], 0.06),
    ]


def post_box(_tags: Tags) -> list[Piece]:
    """Return a letter box on a post."""
    return [
        bar([0, 0, -0.3], [0, 0, 0.75], 0.05),
        block([0, 0, 0.7], [0.35, 0.5, 0.6], "metal-painted"),
    ]


def cabinet(tags: Tags) -> list[Piece]:
    """Return a street cabinet; those of traffic signals and power are larger than telecom's."""
    kind = tags.get("street_cabinet") or tags.get("utility", "")
    long = {"power": 1.1, "traffic_signals": 0.75, "traffic_control": 0.75}.get(kind, 0.8)
    wide = length_m_of(tags.get("width")) or long
    return [
        block([0, 0, 0], [0.36, min(wide, 4.0), _height(tags, 1.25, 3.0)], "plastic"),
    ]


def meter(tags: Tags) -> list[Piece]:
    """Return a ticket machine or a parking meter."""
    return [block([0, 0, 0], [0.3, 0.35, _height(tags, 1.65, 2.2)], "metal-dark")]


def machine(tags: Tags) -> list[Piece]:
    """Return a vending machine; those on walls are flat, parking meters slim."""
    kind = tags.get("vending", "")
    if "parking_tickets" in kind or "public_transport_tickets" in kind:
        return meter(tags)
    if "excrement_bags" in kind:
        return [
            bar([0, 0, -0.3], [0, 0, 1.2], 0.03),
            block([0, 0, 0.85], [0.15, 0.3, 0.4], "metal-painted"),
        ]
    if kind in ("cigarettes", "chewing_gums", "condoms"):
        return [
            bar([0, 0, -0.3], [0, 0, 1.0], 0.04),
            block([0, 0, 0.9], [0.25, 0.7, 0.8], "metal-painted"),
        ]
    return [block([0, 0, 0], [0.8, 1.0, _height(tags, 1.85, 2.6)], "metal-painted")]


def parcel_locker(tags: Tags) -> list[Piece]:
    """Return lockers for parcels in a row: a cabinet as high as people reach."""
    long = min(length_m_of(tags.get("length")) or 3.0, 12.0)
    return [block([0, 0, 0], [0.65, long, _height(tags, 2.1, 3.0)], "metal-painted")]


def telephone(tags: Tags) -> list[Piece]:
    """Return a telephone box: glass between posts below a roof."""
    del tags
    posts = [
        block([x, y, 0], [0.06, 0.06, 2.2], "metal-dark")
        for x in (-0.42, 0.42)
        for y in (-0.42, 0.42)
    ]
    glass = [
        block([-0.42, 0, 0.1], [0.012, 0.78, 2.0], "glass"),
        block([0, 0.42, 0.1], [0.78, 0.012, 2.0], "glass"),
        block([0, -0.42, 0.1], [0.78, 0.012, 2.0], "glass"),
    ]
    return [*posts, *glass, block([0, 0, 2.2], [0.95, 0.95, 0.12], "metal-dark")]


def advertising(tags: Tags) -> list[Piece]:
    """Return an advertising column (3.6 m high, 1.3 m across), a billboard, or a poster case."""
    kind = tags.get("advertising", "")
    if kind == "column":
        high = _height(tags, 3.6, 6.0)
        return [
            drum([0, 0, 0], high - 0.3, 0.65, "plaster", "other-structure", sides=16),
            drum([0, 0, high - 0.3], 0.3, 0.75, "metal-dark", "other-structure", 0.3, 16),
        ]
    if kind == "billboard":
        wide = min(length_m_of(tags.get("width")) or 3.7, 20.0)
        legs = [
            block([0, side * wide / 3, 0], [0.15, 0.15, 2.3], "metal-dark", "other-structure")
            for side in (1, -1)
        ]
        return [*legs, block([0, 0, 2.25], [0.25, wide, 2.7], "plastic", "other-structure")]
    if kind in ("poster_box", "board", "screen", "sign", "totem"):
        if kind == "sign" or (kind == "board" and tags.get("support") == "wall"):
            return []
        high = _height(tags, 5.0 if kind == "totem" else 2.7, 12.0)
        return [
            block([0, 0, 0], [0.18, 0.5, 0.6], "metal-dark", "other-structure"),
            block([0, 0, 0.55], [0.18, 1.35, high - 0.55], "metal-painted", "other-structure"),
            block([0.1, 0, 0.7], [0.02, 1.2, high - 0.85], "glass", "other-structure"),
        ]
    return []


def information(tags: Tags) -> list[Piece]:
    """Return a board or a map on two posts, or a guidepost."""
    kind = tags.get("information", "")
    if kind in ("board", "map", "tactile_map"):
        legs = [bar([0, side * 0.55, -0.3], [0, side * 0.55, 2.0], 0.04) for side in (1, -1)]
        return [*legs, block([0, 0, 0.9], [0.06, 1.0, 1.1], "wood", "traffic-sign")]
    if kind in ("guidepost", "route_marker"):
        arms = [
            block([0, 0.35, 2.0], [0.03, 0.6, 0.15], "metal-painted", "traffic-sign"),
            block([0, -0.35, 2.2], [0.03, 0.6, 0.15], "metal-painted", "traffic-sign"),
        ]
        return [bar([0, 0, -0.3], [0, 0, 2.4], 0.04, "metal-painted", "pole"), *arms]
    if kind in ("terminal", "audioguide"):
        return [block([0, 0, 0], [0.35, 0.6, 1.7], "metal-painted")]
    return []


def planter(tags: Tags) -> list[Piece]:
    """Return a trough of concrete with soil and low plants."""
    long = min(length_m_of(tags.get("length")) or 1.2, 6.0)
    return [
        block([0, 0, 0], [0.8, long, 0.5], "concrete"),
        block([0, 0, 0.5], [0.6, long - 0.2, 0.35], "foliage", "vegetation"),
    ]


def charging(tags: Tags) -> list[Piece]:
    """Return a charging post."""
    return [block([0, 0, 0], [0.3, 0.45, _height(tags, 1.7, 2.6)], "plastic")]


def clock(tags: Tags) -> list[Piece]:
    """Return a clock on a pole; those on walls are not drawn."""
    if tags.get("support") in ("wall", "wall_mounted", "building", "roof", "tower"):
        return []
    high = _height(tags, 4.0, 12.0)
    return [
        bar([0, 0, -0.3], [0, 0, high - 0.4], 0.06, "metal-painted", "pole"),
        block([0, 0, high - 0.8], [0.2, 0.8, 0.8], "plastic"),
    ]


def camera(tags: Tags) -> list[Piece]:
    """Return a speed camera: a case on a post."""
    return [
        bar([0, 0, -0.3], [0, 0, 1.7], 0.12, "metal-dark", "pole"),
        block([0, 0, 1.7], [0.5, 0.5, _height(tags, 0.9, 1.5)], "metal-painted"),
    ]


def picnic_table(tags: Tags) -> list[Piece]:
    """Return a table with its two seats."""
    del tags
    return [
        block([0, 0, 0.70], [0.75, 1.8, 0.05], "wood"),
        *(block([side * 0.75, 0, 0.42], [0.28, 1.8, 0.05], "wood") for side in (1, -1)),
        *(block([0, side * 0.6, 0], [0.1, 0.1, 0.70], "wood") for side in (1, -1)),
        *(block([0, side * 0.6, 0.36], [1.6, 0.08, 0.06], "wood") for side in (1, -1)),
    ]


def drinking_fountain(tags: Tags) -> list[Piece]:
    """Return a drinking fountain: a pillar with a bowl."""
    del tags
    return [
        block([0, 0, 0], [0.3, 0.3, 0.85], "stone"),
        drum([0, 0, 0.85], 0.12, 0.2, "stone", top=0.25),
    ]


def railway_signal(tags: Tags) -> list[Piece]:
    """Return a railway signal on its mast."""
    high = _height(tags, 4.5, 12.0)
    return [
        bar([0, 0, -0.3], [0, 0, high], 0.07, "metal-painted", "pole"),
        block([0.15, 0, high - 1.1], [0.15, 0.6, 1.0], "metal-dark"),
    ]


def buffer_stop(tags: Tags) -> list[Piece]:
    """Return a buffer stop: a beam before a block."""
    del tags
    return [
        block([-0.6, 0, 0], [0.8, 1.6, 1.0], "concrete"),
        block([-0.1, 0, 0.85], [0.2, 2.4, 0.3], "wood"),
    ]


def kiosk_machine(tags: Tags) -> list[Piece]:
    """Return a terminal where bicycles are hired."""
    del tags
    return [block([0, 0, 0], [0.3, 0.5, 1.6], "metal-painted")]


def kiosk(tags: Tags) -> list[Piece]:
    """Return a kiosk that is mapped as a point: a box under a roof that stands out."""
    high = _height(tags, 2.8, 5.0)
    return [
        block([0, 0, 0], [2.0, 2.5, high - 0.2], "metal-painted", "other-structure"),
        block([0, 0, high - 0.2], [2.8, 3.1, 0.2], "metal-painted", "other-structure"),
    ]


#: (key, value) -> what notes call it, and how it is built.
STREET: dict[tuple[str, str], tuple[str, Build]] = {
    ("amenity", "bench"): ("benches", bench),
    ("amenity", "waste_basket"): ("waste baskets", waste_basket),
    ("amenity", "waste_disposal"): ("containers", container),
    ("amenity", "recycling"): ("containers", container),
    ("amenity", "wheelie_bin"): ("wheeled bins", wheeled_bin),
    ("amenity", "grit_bin"): ("containers", container),
    ("amenity", "post_box"): ("post boxes", post_box),
    ("amenity", "letter_box"): ("post boxes", post_box),
    ("amenity", "telephone"): ("telephone boxes", telephone),
    ("amenity", "vending_machine"): ("machines", machine),
    ("amenity", "parcel_locker"): ("parcel lockers", parcel_locker),
    ("amenity", "parking_meter"): ("parking meters", meter),
    ("amenity", "charging_station"): ("charging posts", charging),
    ("amenity", "drinking_water"): ("drinking fountains", drinking_fountain),
    ("amenity", "clock"): ("clocks", clock),
    ("amenity", "bicycle_rental"): ("hire terminals", kiosk_machine),
    ("amenity", "planter"): ("planters", planter),
    ("man_made", "planter"): ("planters", planter),
    ("man_made", "street_cabinet"): ("street cabinets", cabinet),
    ("power", "cable_distribution_cabinet"): ("street cabinets", cabinet),
    ("power", "box"): ("street cabinets", cabinet),
    ("emergency", "fire_hydrant"): ("hydrants", hydrant),
    ("emergency", "phone"): ("emergency phones", meter),
    ("advertising", "column"): ("advertising", advertising),
    ("advertising", "billboard"): ("advertising", advertising),
    ("advertising", "poster_box"): ("advertising", advertising),
    ("advertising", "board"): ("advertising", advertising),
    ("advertising", "screen"): ("advertising", advertising),
    ("advertising", "totem"): ("advertising", advertising),
    ("tourism", "information"): ("information boards", information),
    ("highway", "speed_camera"): ("speed cameras", camera),
    ("shop", "kiosk"): ("kiosks", kiosk),
    ("leisure", "picnic_table"): ("picnic tables", picnic_table),
    ("railway", "signal"): ("railway signals", railway_signal),
    ("railway", "buffer_stop"): ("buffer stops", buffer_stop),
}
