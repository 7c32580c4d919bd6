"""The fleet of a region: body, size and colour of the n-th actor of a class.

Positions in the distributions follow the additive recurrence of Roberts (R-sequence: multiples of
powers of a generalised golden ratio; M. Roberts, The unreasonable effectiveness of quasirandom
sequences, 2018). So few actors already cover the distributions, and each depends only on the seed,
its class and its number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.special import ndtri

from urbantwin.geometry import LabelledMesh
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets.asset_name import COATED_CLASSES, AssetName, Size, coat_at
from urbantwin.traffic.assets.catalogue import (
    Asset,
    american_body,
    asset,
    asset_names,
    bodies_of_asset,
)

__all__ = ["Fleet", "OwnBodies", "region_of"]

#: Assumed positions of wheels of a site's own vehicles, as shares of length and width.
_AXLE_SHARES, _WHEEL_TRACK_SHARE = (0.3, -0.3), 0.42


@dataclass(frozen=True, eq=False)
class OwnBodies:
    """The assets that a site defines.

    Attributes:
        classes: class of each by name.
        shares: share of the actors of its class that each makes up, 0..1.
        meshes: meshes in phase 0, in the asset frame.
    """

    classes: Mapping[str, str] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    meshes: Mapping[tuple[str, int], LabelledMesh] = field(default_factory=dict)

    def asset(self, name: str) -> Asset:
        """Return an asset of the site, or of the catalogue.

        Raises:
            InputError: neither has it.
        """
        parsed = AssetName.of(name)
        mesh = self.meshes.get((parsed.unsized, 0))
        if mesh is None:
            return asset(name)
        length, width, height = parsed.size or np.ptp(mesh.vertices, axis=0).tolist()
        actor_class = self.classes[parsed.unsized]
        contacts = np.zeros((1, 3))
        if actor_class != "pedestrian":
            contacts = np.array(
                [
                    [x * length, y * width, 0.0]
                    for x in _AXLE_SHARES
                    for y in (_WHEEL_TRACK_SHARE, -_WHEEL_TRACK_SHARE)
                ]
            )
        return Asset(name, actor_class, 1, 0, length, width, height, contacts, 0.0)

    def of_class(self, actor_class: str) -> tuple[tuple[str, float], ...]:
        """Return names and shares of the assets of a class."""
        return tuple((n, self.shares[n]) for n, c in self.classes.items() if c == actor_class)


#: Region of the tables by country (ISO 3166-1 alpha-2); Europe for all others.
_AMERICA, _DEFAULT_REGION = "north-america", "europe"
_REGIONS = {"US": _AMERICA, "CA": _AMERICA, "MX": _AMERICA, "JP": "japan"}
#: Maximum deviation from the mean, standard deviations.
_MAX_DEVIATION_SIGMAS = 2.3
#: Correlation of widths with lengths.
_WIDTH_LENGTH_CORRELATION = 0.6
#: Number of random values per actor: kind and body, length, width, height, colour.
_DRAWS_PER_ACTOR = 5
#: Steps of sizes, so that actors share meshes: relative for assets with many postures; length,
#: width and height of vehicles, metres.
_FACTOR_STEP, _STEPS_M = 0.02, (0.02, 0.01, 0.01)


def region_of(country: str) -> str:
    """Return the region of the tables for a country (ISO 3166-1 alpha-2; empty if unknown)."""
    return _REGIONS.get(country, _DEFAULT_REGION)


@dataclass(frozen=True)
class Fleet:
    """The actors of a region.

    Attributes:
        country: ISO 3166-1 alpha-2; empty if unknown.
        seed: random seed.
        own: assets that the site defines.
    """

    country: str = ""
    seed: int = 1
    own: OwnBodies = field(default_factory=OwnBodies)

    def body(self, actor_class: str, number: int, *, bends: bool = True) -> str:
        """Return the name of the asset of the n-th actor of a class (`AssetName`).

        Args:
            actor_class: one of ``taxonomy.ACTOR_CLASSES``.
            number: number of the actor, from 0.
            bends: allow articulated road vehicles.
        """
        kinds = _kinds(region_of(self.country), actor_class, bends=bends)
        draws = _draws_of_actor(self.seed, ACTOR_CLASSES.index(actor_class), number)
        taken = 0.0
        for name, share_of in self.own.of_class(actor_class):
            taken += share_of
            if draws[0] < taken:
                return name
        draws[0] = (draws[0] - taken) / (1.0 - taken)
        share = np.cumsum([kind["share"] for kind in kinds])
        place = float(draws[0] * share[-1])
        which = min(int(np.searchsorted(share, place, side="right")), len(kinds) - 1)
        kind = kinds[which]
        within = (place - float(share[which] - kind["share"])) / kind["share"]
        bodies = kind["bodies"]
        body = bodies[min(int(within * len(bodies)), len(bodies) - 1)]
        coat = coat_at(float(draws[4]), actor_class) if actor_class in COATED_CLASSES else ""
        return str(AssetName(body, coat, _size(kind, body, draws)))


def _size(kind: dict[str, Any], body: str, at: NDArray[np.float64]) -> Size | None:
    """Return the size of an actor, rounded to steps; ``None``: that of its body."""
    if not kind.keys() & {"scatter", "length", "width", "height"}:
        return None
    own = asset(body)
    away = np.clip(
        ndtri(np.clip(at[1:4], 1e-6, 1 - 1e-6)), -_MAX_DEVIATION_SIGMAS, _MAX_DEVIATION_SIGMAS
    )
    if "scatter" in kind:
        factor = 1.0 + kind["scatter"] * float(away[0])
        factor = round(factor / _FACTOR_STEP) * _FACTOR_STEP
        return own.length * factor, own.width * factor, own.height * factor
    along, across, up = away.tolist()
    across = _WIDTH_LENGTH_CORRELATION * along + (1 - _WIDTH_LENGTH_CORRELATION**2) ** 0.5 * across
    sides = []
    for side, scatter, step in (
        ("length", along, _STEPS_M[0]),
        ("width", across, _STEPS_M[1]),
        ("height", up, _STEPS_M[2]),
    ):
        mean, deviation = kind.get(side, (getattr(own, side), 0.0))
        sides.append(round((mean + deviation * scatter) / step) * step)
    return sides[0], sides[1], sides[2]


def _draws_of_actor(seed: int, stream: int, number: int) -> NDArray[np.float64]:
    """Return the position (5,), 0..1, of the n-th actor of a stream in the distributions."""
    return np.asarray((_shift(seed, stream) + (number + 1) * _steps()) % 1.0)


@cache
def _shift(seed: int, stream: int) -> NDArray[np.float64]:
    key = [seed, 7_000_000_000 + stream]
    return np.random.Generator(np.random.Philox(key=key)).random(_DRAWS_PER_ACTOR)


@cache
def _steps() -> NDArray[np.float64]:
    ratio = 1.5
    for _ in range(64):  # the root of x^(d+1) = x + 1
        ratio = (1.0 + ratio) ** (1.0 / (_DRAWS_PER_ACTOR + 1))
    return ratio ** -np.arange(1.0, _DRAWS_PER_ACTOR + 1)


@cache
def _kinds(region: str, actor_class: str, *, bends: bool) -> list[dict[str, Any]]:
    """Return the kinds of a class in a region; those of Europe if the region has none.

    Without a table, all assets of the class are equally frequent, in their own size.
    """
    tables = _tables()
    table = tables[region].get(actor_class) or tables[_DEFAULT_REGION].get(actor_class)
    if not table:
        return [{"share": 1.0, "bodies": [name]} for name in asset_names(actor_class)]
    kinds = [
        kind for kind in table.values() if bends or not any(map(_is_articulated, kind["bodies"]))
    ]
    if region != _AMERICA:
        return kinds
    return [{**kind, "bodies": [american_body(name) for name in kind["bodies"]]} for kind in kinds]


def _is_articulated(body: str) -> bool:
    return bool(bodies_of_asset(body))


@cache
def _tables() -> dict[str, dict[str, dict[str, dict[str, Any]]]]:
    text = files(__package__).joinpath("fleet.yaml").read_text(encoding="utf-8")
    tables: dict[str, dict[str, dict[str, dict[str, Any]]]] = yaml.load(
        text, getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    )
    return tables
