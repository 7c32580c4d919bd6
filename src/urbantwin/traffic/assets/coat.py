"""Coats: a vehicle's paint, which decides its returns more than its shape does, and its panes.

An asset with a coat is named ``car-sedan_black``. Of 19 cars that two VLP-32C (903 nm) saw in the
Argoverse 2 log of Pittsburgh, 4 gave back 38 to 76 % (median of a car), 6 gave 8 to 20 %, and 9
no more than 4 %: black, dark blue and most greys are painted with soot. `COATS` has those shares.
(Of new cars in Germany in 2024 19.9 % were white, 33.0 % grey or silver, 26.6 % black, and most
others blue or red: KBA.) More vans are white: 57 % of those on Britain's roads in 2011, and 10 %
silver (Direct Line for Business, of the DVLA's register).

Panes of vehicles absorb: those before the middle heat (``glass-tinted``), those behind it mostly
all light (``glass-privacy``: of grey and black cars, as its share is not public), and so do the
panes along trucks and buses. Lamps and mirrors stay as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import material_id

__all__ = ["COATED_CLASSES", "COATS", "coat_at", "coated_mesh", "coated_name"]

#: Coat -> share of vehicles but vans.
COATS: dict[str, float] = {"white": 4 / 19, "grey": 6 / 19, "black": 9 / 19}
_OF_VANS = {"white": 0.57, "grey": 0.10, "black": 0.33}
#: Classes of actors that have a coat.
COATED_CLASSES = ("car", "truck", "bus", "van")
#: Panes lie higher than this share of a car's height, lamps below; of a long vehicle, other shares.
_PANES, _LONG_PANES, _LONG_M = 0.58, 0.25, 6.5
#: Of a long vehicle, what is farther ahead than this share of its half length is its windscreen.
_WINDSCREEN = 0.85
_GOLDEN = (5**0.5 - 1) / 2  # spreads the coats evenly over few vehicles too


def coated_name(name: str, number: int, actor_class: str) -> str:
    """Return the name of an asset in the coat of the n-th vehicle of a class."""
    return f"{name}_{coat_at((number + 0.5) * _GOLDEN % 1.0, actor_class)}"


def coat_at(place: float, actor_class: str) -> str:
    """Return the coat of the vehicle at a place, 0..1, among all of its class."""
    shares = _OF_VANS if actor_class == "van" else COATS
    ends = np.cumsum(list(shares.values()))
    return list(COATS)[min(int(np.searchsorted(ends, place, side="right")), len(COATS) - 1)]


def coated_mesh(mesh: LabelledMesh, coat: str) -> LabelledMesh:
    """Return a vehicle's mesh with a coat on all that is painted, and its panes tinted."""
    material = mesh.material.copy()
    material[material == material_id("metal-painted")] = material_id(f"paint-{coat}")
    middle = mesh.triangles().mean(axis=1)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    is_long = high[0] - low[0] > _LONG_M
    share = _LONG_PANES if is_long else _PANES
    panes = (mesh.material == material_id("glass")) & (middle[:, 2] > share * high[2])
    material[panes] = material_id("glass-tinted")
    ahead = (low[0] + high[0]) / 2 + (_WINDSCREEN * (high[0] - low[0]) / 2 if is_long else 0.0)
    if is_long or coat != "white":
        material[panes & (middle[:, 0] < ahead)] = material_id("glass-privacy")
    return replace(mesh, material=material)
