"""Forms of barriers by kind: make, height, thickness, material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from urbantwin.scene.tag_values import length_m_of

__all__ = ["Form", "form_of"]


@dataclass(frozen=True)
class Form:
    """What a barrier looks like; metres."""

    make: str
    height_m: float
    thickness_m: float
    material: str
    semantic: str = "fence"


#: Usual heights: guard rails 0.75 m and concrete barriers 0.81 to 0.9 m (systems tested to EN 1317
#: and AASHTO MASH), railings 1.0 m (building codes); the others are assumed.
FORMS = {
    "fence": Form("rails", 1.5, 0.05, "metal-painted"),
    "wall": Form("solid", 1.8, 0.25, "brick"),
    "retaining_wall": Form("solid", 0.8, 0.3, "concrete"),
    "city_wall": Form("solid", 5.0, 1.2, "brick", "other-structure"),
    "guard_rail": Form("guard", 0.75, 0.1, "metal-painted"),
    "handrail": Form("handrail", 1.0, 0.05, "metal-painted"),
    "railing": Form("bars", 1.0, 0.05, "metal-painted"),
    "jersey_barrier": Form("jersey", 0.85, 0.6, "concrete"),
    "cable_barrier": Form("wires", 0.8, 0.05, "metal-painted"),
    "collision_protection": Form("solid", 0.8, 0.4, "concrete"),
    "block": Form("solid", 0.6, 0.5, "concrete"),
    "log": Form("solid", 0.4, 0.35, "wood"),
    "barrier_board": Form("rails", 1.0, 0.05, "wood"),
    "gate": Form("bars", 1.3, 0.05, "metal-painted"),
    "swing_gate": Form("bars", 1.1, 0.05, "metal-painted"),
    "chain": Form("chain", 0.8, 0.03, "metal-dark"),
    "rope": Form("chain", 0.9, 0.03, "wood"),
    "hedge": Form("hedge", 1.4, 0.8, "foliage", "vegetation"),
    "bollard": Form("bollards", 0.9, 0.0, "metal-painted", "pole"),
    "kerb": Form("kerb", 0.12, 0.15, "concrete", "sidewalk"),
    "wire_fence": Form("wires", 1.2, 0.05, "wood"),
}
#: ``fence_type`` -> make, height, material.
FENCES = {
    "chain_link": ("mesh", 1.8, "metal-painted"),
    "metal_mesh": ("mesh", 1.8, "metal-painted"),
    "mesh": ("mesh", 1.8, "metal-painted"),
    "net": ("mesh", 3.0, "metal-painted"),
    "temporary": ("mesh", 2.0, "metal-painted"),
    "railing": ("bars", 1.2, "metal-painted"),
    "metal_bars": ("bars", 1.5, "metal-painted"),
    "metal": ("bars", 1.5, "metal-painted"),
    "bars": ("bars", 1.5, "metal-painted"),
    "wrought_iron": ("bars", 1.5, "metal-painted"),
    "wire": ("wires", 1.2, "wood"),
    "barbed_wire": ("wires", 1.3, "wood"),
    "electric": ("wires", 1.2, "wood"),
    "avalanche": ("mesh", 3.0, "metal-painted"),
    "split_rail": ("rails", 1.1, "wood"),
    "pole": ("rails", 1.1, "wood"),
    "roundpole": ("rails", 1.1, "wood"),
    "pales": ("pales", 1.1, "wood"),
    "picket": ("pales", 1.1, "wood"),
    "wood": ("solid", 1.5, "wood"),
    "wooden": ("solid", 1.5, "wood"),
    "panel": ("solid", 1.8, "wood"),
    "wood_panel": ("solid", 1.8, "wood"),
    "close_boarded": ("solid", 1.8, "wood"),
    "hoarding": ("solid", 2.0, "wood"),
    "metal_panel": ("solid", 1.8, "metal-painted"),
    "corrugated_metal": ("solid", 1.8, "metal-painted"),
    "concrete": ("solid", 1.8, "concrete"),
    "slate": ("solid", 1.2, "stone"),
    "stone": ("solid", 1.2, "stone"),
    "glass": ("solid", 1.2, "glass"),
}
WALL_MATERIALS = {
    "concrete": "concrete",
    "stone": "stone",
    "dry_stone": "stone",
    "sandstone": "stone",
    "granite": "stone",
    "limestone": "stone",
    "brick": "brick",
    "wood": "wood",
    "gabion": "stone",
    "plaster": "plaster",
    "noise_barrier": "concrete",
    "glass": "glass",
    "metal": "metal-painted",
}
WALL_HEIGHTS = {"noise_barrier": 3.0, "dry_stone": 1.2, "flood_wall": 1.2, "gabion": 1.0}
KERB_HEIGHTS = {"raised": 0.12, "regular": 0.1, "rolled": 0.08, "lowered": 0.03, "flush": 0.0}


def form_of(tags: Mapping[str, str]) -> Form | None:
    """Return the form of a barrier along a line; ``None`` where the tags name none."""
    form = FORMS.get(tags.get("barrier", ""))
    if form is None:
        return None
    if tags["barrier"] == "fence" and tags.get("fence_type") in FENCES:
        make, high, material = FENCES[tags["fence_type"]]
        form = replace(form, make=make, height_m=high, material=material)
    if form.make == "kerb":
        form = replace(form, height_m=KERB_HEIGHTS.get(tags.get("kerb", ""), form.height_m))
    wall = tags.get("wall", "")
    if tags["barrier"] == "wall" and wall in WALL_HEIGHTS:
        form = replace(form, height_m=WALL_HEIGHTS[wall])
    height = min(length_m_of(tags.get("height")) or form.height_m, 15.0)
    thickness = form.thickness_m
    if form.make in ("solid", "hedge", "jersey", "kerb"):
        thickness = min(length_m_of(tags.get("width")) or thickness, 3.0)
    material = form.material
    if form.make == "solid":
        material = WALL_MATERIALS.get(tags.get("material") or wall, material)
    elif tags.get("material") in ("wood", "metal") and form.make in ("rails", "bars", "pales"):
        material = "wood" if tags["material"] == "wood" else "metal-painted"
    return replace(form, height_m=height, thickness_m=thickness, material=material)
