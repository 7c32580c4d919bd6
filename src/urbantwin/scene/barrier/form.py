"""Forms of barriers by kind: make, height, thickness, material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from urbantwin.scene.tag_values import length_m_of

__all__ = ["Form", "form_of"]


@dataclass(frozen=True)
class Form:
    """The shape of a barrier; metres."""

    make: str
    height_m: float
    thickness_m: float
    material: str
    semantic: str = "fence"


@cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return ``forms.yaml``."""
    read: dict[str, dict[str, Any]] = yaml.safe_load(
        (files(__package__) / "forms.yaml").read_text(encoding="utf-8")
    )
    return read


def form_of(tags: Mapping[str, str]) -> Form | None:
    """Return the form of a barrier along a line; ``None`` if the tags name none."""
    tables = _tables()
    kind = tags.get("barrier", "")
    if kind not in tables["forms"]:
        return None
    form = Form(**tables["forms"][kind])
    if kind == "fence":
        form = replace(form, **tables["fences"].get(tags.get("fence_type", ""), {}))
    if form.make == "kerb":
        form = replace(
            form, height_m=tables["kerb_heights"].get(tags.get("kerb", ""), form.height_m)
        )
    wall = tags.get("wall", "")
    if kind == "wall":
        form = replace(form, height_m=tables["wall_heights"].get(wall, form.height_m))
    height = min(length_m_of(tags.get("height")) or form.height_m, 15.0)
    thickness = form.thickness_m
    if form.make in ("solid", "hedge", "jersey", "kerb"):
        thickness = min(length_m_of(tags.get("width")) or thickness, 3.0)
    material = form.material
    if form.make == "solid":
        material = tables["wall_materials"].get(tags.get("material") or wall, material)
    elif tags.get("material") in ("wood", "metal") and form.make in ("rails", "bars", "pales"):
        material = "wood" if tags["material"] == "wood" else "metal-painted"
    return replace(form, height_m=height, thickness_m=thickness, material=material)
