"""The actor catalogue: names, sizes and meshes of everything that moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import ACTOR_CLASSES, ACTOR_SEMANTICS, semantic_id
from urbantwin.traffic.assets.car import car, contact_points, fitted
from urbantwin.traffic.assets.gait import stride_length, walking
from urbantwin.traffic.assets.heavy import bus, truck
from urbantwin.traffic.assets.person import Figure, figure_solids
from urbantwin.traffic.assets.solid import Solid, labelled

__all__ = ["Asset", "asset", "asset_mesh", "asset_names"]

#: Postures of a gait cycle.
GAIT_PHASES = 12


@dataclass(frozen=True, eq=False)
class Asset:
    """An actor of the catalogue.

    The asset frame: x forward, y left, z up; the origin lies on the ground under the middle of
    the bounds of phase 0.

    Attributes:
        name: such as ``car-sedan``.
        actor_class: one of ``taxonomy.ACTOR_CLASSES``.
        phases: how many postures a movement cycle has; 1 for a rigid asset.
        length: bounds of phase 0 along x, metres.
        width: along y.
        height: along z.
        contacts: (K, 3) where the asset touches the ground, metres: four or more wheels, the two
            wheels of a two-wheeler (front first), the origin for a person.
        stride_m: distance travelled in one cycle of the phases, metres; 0 for a rigid asset.
            Phase ``k`` belongs to distances ``k / phases * stride_m`` and on.
    """

    name: str
    actor_class: str
    phases: int
    length: float
    width: float
    height: float
    contacts: NDArray[np.float64]
    stride_m: float


def asset_names(actor_class: str) -> tuple[str, ...]:
    """Return the names of a class's assets, in the catalogue's order.

    Raises:
        InputError: there is no such class.
    """
    if actor_class not in ACTOR_CLASSES:
        raise InputError(
            f"unknown actor class '{actor_class}'", expected=f"one of {', '.join(ACTOR_CLASSES)}"
        )
    return tuple(name for name, entry in _entries().items() if entry["class"] == actor_class)


@cache
def asset(name: str) -> Asset:
    """Return an asset.

    Raises:
        InputError: there is no asset of that name.
    """
    entry = _entry(name)
    walks = entry["builder"] == "walker"
    size = np.ptp(asset_mesh(name).vertices, axis=0)
    contacts = BUILDERS[entry["builder"]].contacts(entry)
    return Asset(
        name=name,
        actor_class=entry["class"],
        phases=GAIT_PHASES if walks else 1,
        length=float(size[0]),
        width=float(size[1]),
        height=float(size[2]),
        contacts=np.array(contacts, np.float64).reshape(-1, 3),
        stride_m=stride_length(Figure(**entry["figure"])) if walks else 0.0,
    )


@cache
def asset_mesh(name: str, phase: int = 0) -> LabelledMesh:
    """Return the mesh of an asset in its own frame; ``part`` counts its closed solids from 1.

    Args:
        name: of the asset.
        phase: of the movement cycle, 0 <= phase < ``asset(name).phases``.

    Raises:
        InputError: there is no asset of that name, or no such phase of it.
    """
    entry = _entry(name)
    phases = GAIT_PHASES if entry["builder"] == "walker" else 1
    if not 0 <= phase < phases:
        raise InputError(f"{name} has no phase {phase}", expected=f"0 to {phases - 1}")
    solids = BUILDERS[entry["builder"]].solids(entry, phase)
    return labelled(solids, semantic_id(ACTOR_SEMANTICS[entry["class"]]))


@dataclass(frozen=True)
class Builder:
    """How an entry of the catalogue becomes solids, and where it touches the ground."""

    solids: Callable[[dict[str, Any], int], list[Solid]]
    contacts: Callable[[dict[str, Any]], list[list[float]]]


def _rigid(
    build: Callable[[dict[str, Any]], list[Solid]],
) -> Callable[[dict[str, Any], int], list[Solid]]:
    def solids(entry: dict[str, Any], _phase: int) -> list[Solid]:
        return fitted(build(entry), entry["size"])

    return solids


def _walker(entry: dict[str, Any], phase: int) -> list[Solid]:
    """Return a walking figure: the pelvis keeps its place over the ground in every phase."""
    figure = Figure(**entry["figure"])

    def standing(at: int) -> list[Solid]:
        solids = figure_solids(figure, walking(figure, at / GAIT_PHASES))
        lowest = min(solid.vertices[:, 2].min() for solid in solids)
        return [solid.moved([0.0, 0.0, -lowest]) for solid in solids]

    first = np.concatenate([solid.vertices for solid in standing(0)])
    middle = (first[:, 0].min() + first[:, 0].max()) / 2
    return [solid.moved([-middle, 0.0, 0.0]) for solid in standing(phase)]


BUILDERS = {
    "bus": Builder(_rigid(bus), contact_points),
    "car": Builder(_rigid(car), contact_points),
    "truck": Builder(_rigid(truck), contact_points),
    "walker": Builder(_walker, lambda _entry: [[0.0, 0.0, 0.0]]),
}


@cache
def _entries() -> dict[str, dict[str, Any]]:
    text = files(__package__).joinpath("assets.yaml").read_text()
    entries: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return entries


def _entry(name: str) -> dict[str, Any]:
    try:
        return _entries()[name]
    except KeyError:
        raise InputError(
            f"unknown asset '{name}'", expected=f"one of {', '.join(_entries())}"
        ) from None
