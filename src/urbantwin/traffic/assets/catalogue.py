"""The actor catalogue: names, sizes and meshes of all actors and movable objects.

Its data are ``assets.yaml``, ``light.yaml`` and ``articulated.yaml`` (given point by point),
``cars.yaml`` (generated from measures) and ``things.yaml`` (objects on streets).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_id
from urbantwin.traffic.assets.asset_name import (
    COATED_CLASSES,
    AssetName,
    Size,
    coated_mesh,
    scaled_mesh,
)
from urbantwin.traffic.assets.car import car, contact_points
from urbantwin.traffic.assets.car_shape import drawn
from urbantwin.traffic.assets.gait import (
    BESIDE_M,
    DOG_PHASES,
    GAIT_PHASES,
    dog,
    dog_stride,
    stride_length,
    walker,
)
from urbantwin.traffic.assets.heavy import (
    Body,
    bodies_of,
    bus,
    bus_section,
    trailer,
    tram_bodies,
    tram_entries,
    tram_section,
    truck,
)
from urbantwin.traffic.assets.person import Figure
from urbantwin.traffic.assets.solid import Solid, fitted, labelled, parts
from urbantwin.traffic.assets.two_wheeler import PEDAL_PHASES, hub_contacts, two_wheeler

__all__ = [
    "Asset",
    "american_body",
    "asset",
    "asset_mesh",
    "asset_names",
    "bending_names",
    "bodies_of_asset",
    "class_of",
]

#: Files of the catalogue.
_FILES = ("assets.yaml", "cars.yaml", "light.yaml", "articulated.yaml", "things.yaml")
#: Builders of assets without moving limbs.
_RIGID_BUILDERS: dict[str, Callable[[Mapping[str, Any]], list[Solid]]] = {
    "car": car,
    "truck": truck,
    "bus": bus,
    "trailer": trailer,
    "bus-section": bus_section,
    "tram-body": tram_section,
    "thing": parts,
}
#: Builders of assets with several bodies.
_MULTI_BODY_BUILDERS = ("tram", "coupled", "accompanied")


@dataclass(frozen=True, eq=False)
class Asset:
    """An actor of the catalogue.

    The asset frame: x forward, y left, z up; the origin is on the ground under the centre of the
    bounds of phase 0.

    Attributes:
        name: such as ``car-sedan``.
        actor_class: one of ``taxonomy.BOX_SEMANTICS``.
        phases: number of postures of its cycle of movement (steps, turns of the cranks); 1 for a
            rigid asset.
        standing: phase of the standing posture; it may lie outside the cycle.
        length: bounds of phase 0 along x, metres.
        width: bounds along y, metres.
        height: bounds along z, metres.
        contacts: (K, 3) ground contacts, metres: wheels from the front, left before right; the
            origin for a person.
        stride_m: distance travelled in one cycle, metres; 0 for a rigid asset. Phase ``k`` shows
            the asset ``k / phases`` of that distance into the cycle.
        bodies: rigid bodies of an articulated vehicle from the nose, each an asset; for a person
            with a companion, both.
        rigid: for an articulated road vehicle: the rigid asset used where it cannot turn.
        hitch: for a towed body: hitch position, metres ahead of its centre.
        cab_m: for a truck: distance of its load behind its nose, metres.
        loaded: for a truck: whether it carries a load itself.
    """

    name: str
    actor_class: str
    phases: int
    standing: int
    length: float
    width: float
    height: float
    contacts: NDArray[np.float64]
    stride_m: float
    bodies: tuple[Body, ...] = ()
    rigid: str = ""
    hitch: float | None = None
    cab_m: float | None = None
    loaded: bool = False

    @property
    def supports(self) -> NDArray[np.float64]:
        """Support points (K, 3), asset frame: its contacts, and the ground below its hitch."""
        if self.hitch is None:
            return self.contacts
        return np.vstack([[[self.hitch, 0.0, 0.0]], self.contacts])


def asset_names(actor_class: str) -> tuple[str, ...]:
    """Return the names of a class's assets, in the catalogue's order.

    Assets with a companion, or a car with a trailer, are listed without them; variants sold in
    North America (``car-sedan-american``) are not listed.

    Raises:
        InputError: there is no such class.
    """
    if actor_class not in BOX_SEMANTICS:
        raise InputError(
            f"unknown actor class '{actor_class}'", expected=f"one of {', '.join(BOX_SEMANTICS)}"
        )
    return tuple(
        name
        for name, entry in _entries().items()
        if entry["class"] == actor_class
        and "part_of" not in entry
        and entry["builder"] != "accompanied"
        and "unlisted" not in entry
    )


def bending_names() -> tuple[str, ...]:
    """Return the names of the articulated assets, on rails or on roads."""
    return tuple(
        name for name, entry in _entries().items() if entry["builder"] in ("tram", "coupled")
    )


def class_of(name: str) -> str:
    """Return the class of a catalogue asset by its plain name, without making its mesh."""
    return str(_entry(name)["class"])


def bodies_of_asset(name: str) -> tuple[Body, ...]:
    """Return the bodies of an asset, by its plain name; empty if it has only one."""
    return _bodies(name) if _entry(name)["builder"] in _MULTI_BODY_BUILDERS else ()


@cache
def asset(name: str) -> Asset:
    """Return an asset; its name may include a size and a colour, see `asset_name`.

    Raises:
        InputError: there is no asset of that name.
    """
    parsed = AssetName.of(name)
    if parsed.size is not None:
        usual = asset(parsed.unsized)
        factors = _factors(usual, parsed.size)
        return replace(
            usual,
            name=name,
            length=parsed.size[0],
            width=parsed.size[1],
            height=parsed.size[2],
            contacts=usual.contacts * factors,
            stride_m=usual.stride_m * factors[2],
            hitch=None if usual.hitch is None else usual.hitch * factors[0],
            cab_m=None if usual.cab_m is None else usual.cab_m * factors[0],
        )
    if parsed.coat and _has_coat(parsed.body):
        bare = asset(parsed.body)
        coated = tuple(_coated(body, parsed.coat) for body in bare.bodies)
        rigid = str(AssetName(bare.rigid, parsed.coat)) if bare.rigid else ""
        return replace(bare, name=name, bodies=coated, rigid=rigid)
    entry = _entry(name)
    phases, standing = _phases(entry)
    size = np.ptp(asset_mesh(name).vertices, axis=0)
    contacts: list[list[float]] = [[0.0, 0.0, 0.0]]
    stride = 0.0
    bodies: tuple[Body, ...] = ()
    match entry["builder"]:
        case "walker":
            stride = stride_length(Figure(**entry["figure"]))
        case "dog":
            stride = dog_stride(entry)
        case "accompanied":
            bodies = _bodies(name)
            stride = asset(bodies[0].asset).stride_m
        case "two-wheeler":
            contacts, stride = hub_contacts(entry), entry.get("stride", 0.0)
        case "tram" | "coupled":
            bodies = _bodies(name)
            contacts = [
                [float(x) + entry["size"][0] / 2 - part.middle_m, float(y), 0.0]
                for part in bodies
                for x, y, _ in asset(part.asset).contacts
            ]
        case "thing":
            pass
        case _:
            contacts = contact_points(entry)
    return Asset(
        name=name,
        actor_class=entry["class"],
        phases=phases,
        standing=standing,
        length=float(size[0]),
        width=float(size[1]),
        height=float(size[2]),
        contacts=np.array(contacts),
        stride_m=stride,
        bodies=bodies,
        rigid=entry.get("instead", ""),
        hitch=float(size[0]) / 2 - entry["hitch"] if "hitch" in entry else None,
        cab_m=entry.get("trailer", entry["cab"]["size"][0]) if "cab" in entry else None,
        loaded="cab" in entry and "trailer" not in entry,
    )


@lru_cache(maxsize=512)
def asset_mesh(name: str, phase: int = 0) -> LabelledMesh:
    """Return the mesh of an asset in its own frame; ``part`` counts its closed solids from 1.

    Args:
        name: name of the asset; it may include a size and a colour, see `asset_name`.
        phase: phase of the cycle of movement (0 <= phase < ``asset(name).phases``), or
            ``asset(name).standing``.

    Raises:
        InputError: there is no asset of that name, or no such phase of it.
    """
    parsed = AssetName.of(name)
    if parsed.size is not None:
        unsized = parsed.unsized
        return scaled_mesh(asset_mesh(unsized, phase), _factors(asset(unsized), parsed.size))
    if parsed.coat and _has_coat(parsed.body):
        return coated_mesh(asset_mesh(parsed.body, phase), parsed.coat)
    entry = _entry(name)
    phases, standing = _phases(entry)
    if not (0 <= phase < phases or phase == standing):
        raise InputError(
            f"{name} has no phase {phase}", expected=f"0 to {max(phases - 1, standing)}"
        )
    solids = _solids(name, phase, halted=phase == standing > 0)
    return labelled(solids, semantic_id(BOX_SEMANTICS[entry["class"]]))


def _phases(entry: dict[str, Any]) -> tuple[int, int]:
    """Return the number of phases of an entry's cycle, and its standing phase."""
    match entry["builder"]:
        case "walker" | "accompanied":
            return GAIT_PHASES, GAIT_PHASES
        case "dog":
            return DOG_PHASES, DOG_PHASES
        case "two-wheeler":
            phases = PEDAL_PHASES if "cranks" in entry else 1
            return phases, phases
        case _:
            return 1, 0


def _solids(name: str, phase: int, *, halted: bool) -> list[Solid]:
    entry = _entry(name)
    match entry["builder"]:
        case "walker" | "two-wheeler" | "dog":
            return _posed(name, phase, halted=halted)
        case "tram" | "coupled":
            return [
                solid.moved([entry["size"][0] / 2 - part.middle_m, 0.0, 0.0])
                for part in _bodies(name)
                for solid in _solids(part.asset, 0, halted=False)
            ]
        case "accompanied":
            walks, follows = (_solids(part.asset, phase, halted=halted) for part in _bodies(name))
            return walks + [solid.moved([BESIDE_M[0], -BESIDE_M[1], 0.0]) for solid in follows]
    return fitted(_RIGID_BUILDERS[entry["builder"]](entry), entry["size"])


def _posed(name: str, phase: int, *, halted: bool) -> list[Solid]:
    """Return the solids of an asset with moving limbs."""
    entry, now = _entry(name), None if halted else phase
    if entry["builder"] == "dog":
        return _over_the_middle(dog(entry, now), dog(entry, 0))
    if entry["builder"] == "walker":
        if "stands" not in entry:
            return walker(Figure(**entry["figure"]), now)
        return fitted(pushing(entry, now), entry["size"], like=_first_phase(name))
    first = _first_phase(name)
    moved = first if phase == 0 and not halted else two_wheeler(entry, now or 0, halted=halted)
    return fitted(moved, entry["size"], like=first)


@cache
def _first_phase(name: str) -> list[Solid]:
    """Return the solids of an asset in phase 0, which determines the scale of all phases."""
    entry = _entry(name)
    return pushing(entry, 0) if entry["builder"] == "walker" else two_wheeler(entry)


@cache
def _entries() -> dict[str, dict[str, Any]]:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    entries: dict[str, dict[str, Any]] = {}
    for name in _FILES:
        entries |= yaml.load(files(__package__).joinpath(name).read_text(encoding="utf-8"), loader)
    listed = {name: drawn(entry) for name, entry in entries.items()} | tram_entries()
    american = {
        f"{name}-american": {**entry, "american": True, "unlisted": True}
        for name, entry in listed.items()
        if entry["builder"] == "car"
    }
    return listed | american


def american_body(name: str) -> str:
    """Return the name of a body's variant sold in North America, or its own without one."""
    sold = f"{name}-american"
    return sold if sold in _entries() else name


def _bodies(name: str) -> tuple[Body, ...]:
    """Return the bodies of an asset with several bodies."""
    entry = _entry(name)
    if entry["builder"] == "tram":
        return tram_bodies(name)
    if entry["builder"] == "accompanied":
        return tuple(Body(part, 0.0, (0.0, 0.0)) for part in entry["bodies"])
    names = [part["asset"] for part in entry["bodies"]]
    return bodies_of(entry, {part: _entry(part)["size"][0] for part in names})


def _coated(body: Body, coat: str) -> Body:
    """Return a body with a colour, if its class has colours."""
    return replace(body, asset=f"{body.asset}_{coat}") if _has_coat(body.asset) else body


def _over_the_middle(solids: list[Solid], like: list[Solid]) -> list[Solid]:
    """Return solids shifted by the offset that centres others on the origin."""
    corners = np.concatenate([solid.vertices for solid in like])
    middle = (corners.min(axis=0) + corners.max(axis=0))[:2] / 2
    return [solid.moved([-middle[0], -middle[1], 0.0]) for solid in solids]


def _has_coat(body: str) -> bool:
    """Return whether a body's class has colours."""
    return _entries().get(body, {}).get("class") in COATED_CLASSES


def _factors(usual: Asset, size: Size) -> tuple[float, float, float]:
    """Return the scale factors of an asset for a size."""
    return size[0] / usual.length, size[1] / usual.width, size[2] / usual.height


def _entry(name: str) -> dict[str, Any]:
    try:
        return _entries()[name]
    except KeyError:
        names = [key for key, entry in _entries().items() if "american" not in entry]
        raise InputError(f"unknown asset '{name}'", expected=f"one of {', '.join(names)}") from None


def pushing(entry: Mapping[str, Any], phase: int | None) -> list[Solid]:
    """Return the solids of a person in a phase, or standing, behind a pushed object."""
    ahead = [entry["size"][0] / 2 - entry["stands"], 0.0, 0.0]
    person = walker(Figure(**entry["figure"]), phase)
    return [solid.moved(ahead) for solid in person] + parts(entry)
