"""Proportions of trees by genus (table: ``genus.csv``)."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

__all__ = ["Genus", "genus_of"]

_WORD = re.compile(r"[A-Za-z]+")
#: Common names used instead of the genus in the map, in English and German.
_COMMON = {
    "ahorn": "Acer", "apple": "Malus", "ash": "Fraxinus", "beech": "Fagus", "birch": "Betula",
    "birke": "Betula", "buche": "Fagus", "cedar": "Cedrus", "cherry": "Prunus",
    "chestnut": "Aesculus", "eiche": "Quercus", "elm": "Ulmus", "esche": "Fraxinus",
    "fir": "Abies", "hornbeam": "Carpinus", "kastanie": "Aesculus", "kiefer": "Pinus",
    "kirsche": "Prunus", "larch": "Larix", "lime": "Tilia", "linde": "Tilia", "linden": "Tilia",
    "maple": "Acer", "oak": "Quercus", "palm": "Phoenix", "pappel": "Populus", "pine": "Pinus",
    "plane": "Platanus", "platane": "Platanus", "poplar": "Populus", "robinie": "Robinia",
    "rowan": "Sorbus", "spruce": "Picea", "ulme": "Ulmus", "walnut": "Juglans",
    "weide": "Salix", "willow": "Salix", "yew": "Taxus",
}  # fmt: skip


@dataclass(frozen=True)
class Genus:
    """Usual proportions of trees of a genus.

    Attributes:
        name: botanical name; empty for an unknown broadleaved tree.
        height_m: height of a full-grown tree.
        crown: width of the crown over the tree's height.
        clear: height of the clear trunk over the tree's height.
        form: form of the crown: round, ovoid, spreading, column, cone, palm.
        needles: whether its leaves are needles or scales.
    """

    name: str
    height_m: float
    crown: float
    clear: float
    form: str
    needles: bool


@cache
def _genera() -> dict[str, Genus]:
    lines = files(__package__).joinpath("genus.csv").read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    return {
        row["genus"]: Genus(
            row["genus"],
            float(row["height_m"]),
            float(row["crown"]),
            float(row["clear"]),
            row["form"],
            row["needles"] == "1",
        )
        for row in rows
    }


def genus_of(tags: Mapping[str, str]) -> Genus:
    """Return the genus named in tags (``genus``, ``species``, ``taxon``), or one by leaf type.

    Also understands ``genus:en``, ``species:de`` and similar tags in English and German.
    """
    for key in ("genus", "species", "taxon", "genus:en", "species:en", "genus:de", "species:de"):
        words = _WORD.findall(tags.get(key, ""))
        for word in words:
            found = _genera().get(word.capitalize()) or _genera().get(
                _COMMON.get(word.lower(), "-")
            )
            if found is not None and found.name:
                return found
    if tags.get("leaf_type") == "needleleaved":
        return _genera()["needleleaved"]
    if tags.get("leaf_type") == "palm" or tags.get("type") == "palm":
        return _genera()["Phoenix"]
    return _genera()[""]
