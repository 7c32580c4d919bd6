"""Sizes of trees: mapped or surveyed, with the rest derived."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from urbantwin.scene.tag_values import length_m_of
from urbantwin.scene.tree.genus import Genus, genus_of

__all__ = ["TreeSize", "mapped_size", "surveyed_size"]

#: Share of the full-grown height of their genus for trees without a mapped size: most trees of a
#: city are younger, and crowns are limited to the street's width.
HALF_GROWN = 0.58


@dataclass(frozen=True)
class TreeSize:
    """Metres; ``trunk``: radius at the ground, ``clear``: height of the crown's underside."""

    height: float
    crown: float
    clear: float
    trunk: float
    form: str
    needles: bool


def mapped_size(tags: Mapping[str, str], rng: Generator) -> TreeSize:
    """Return a tree's size from its tags; missing values are derived from genus and the others."""
    genus = genus_of(tags)
    height = length_m_of(tags.get("height") or tags.get("est_height"))
    crown = length_m_of(tags.get("diameter_crown"))
    girth = _girth(tags)
    if height is None:
        if crown is not None:
            height = crown / genus.crown
        elif girth is not None and genus.form != "palm":
            # About 10 m at 0.8 m of girth and 18 m at 2 m: street trees of temperate cities.
            height = 11.5 * girth**0.65
        else:
            height = HALF_GROWN * genus.height_m * rng.uniform(0.8, 1.2)
        height = min(max(height, 3.0), 1.3 * genus.height_m)
    height = min(max(height, 1.5), 80.0)
    if crown is None:
        crown = min(max(genus.crown * height, 1.2), 16.0) * rng.uniform(0.9, 1.1)
    crown = min(crown, 35.0)
    base = length_m_of(tags.get("crown_base"))
    clear = _clear(genus, height) if base is None else min(base, 0.6 * height)
    trunk = girth / (2 * np.pi) if girth is not None else 0.04 + 0.014 * height
    return TreeSize(height, crown, clear, min(trunk, 2.0, crown / 4), genus.form, genus.needles)


def surveyed_size(height_m: float, crown_m: float, crown_base_m: float) -> TreeSize:
    """Return the size of a measured tree; slender crowns are treated as conifers."""
    height = min(max(height_m, 1.5), 90.0)
    crown = min(max(crown_m, 0.8), 35.0)
    clear = min(max(crown_base_m, 0.05 * height), 0.8 * height)
    needles = crown < 0.33 * height and clear < 0.2 * height
    trunk = min(0.04 + 0.014 * height, crown / 4)
    return TreeSize(height, crown, clear, trunk, "cone" if needles else "round", needles)


def _girth(tags: Mapping[str, str]) -> float | None:
    girth = length_m_of(tags.get("circumference"))
    if girth is None:
        across = length_m_of(tags.get("diameter") or tags.get("dbh"))
        if across is None:
            return None
        # Diameters are often in centimetres or, as in the wiki, in millimetres.
        across /= 1000 if across > 250 else 100 if across > 4 else 1
        return float(np.pi * across)
    return girth / 100 if girth > 12 else girth


def _clear(genus: Genus, height: float) -> float:
    clear = genus.clear * height
    if not genus.needles and genus.form != "palm" and height > 5:
        # Street trees are pruned so that pedestrians can pass below.
        clear = min(max(clear, 2.3), 0.45 * height)
    return clear
