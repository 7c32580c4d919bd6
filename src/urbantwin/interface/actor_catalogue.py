"""Catalogue of actors: 3D models, their sizes, a country's fleet, a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import numpy as np

from urbantwin.artefact import check_file, replaced_file
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Listing, Summary
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import Asset, Fleet, asset, asset_mesh, asset_names

__all__ = ["ActorCatalogue", "actors"]

#: Number of actors drawn per class to estimate the distribution of sizes, and its quantiles.
DRAWN, QUANTILES = 400, (0.05, 0.5, 0.95)
_SIDES = ("length", "width", "height")


class ActorCatalogue(Listing, Mapping[str, Asset]):
    """The actors' bodies by name; printed as a table.

    Args:
        classes: classes of actors.
        country: country of the fleet's sizes, ISO 3166-1 alpha-2; empty for the default fleet.
    """

    def __init__(self, classes: tuple[str, ...] = ACTOR_CLASSES, country: str = "") -> None:
        self.classes, self.country = classes, country
        self._names = tuple(name for one in classes for name in asset_names(one))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return self._names

    def __getitem__(self, name: str) -> Asset:
        """Return a body by its name.

        Raises:
            KeyError: no body has this name.
        """
        if name not in self._names:
            raise KeyError(name)
        return asset(name)

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of bodies."""
        return len(self._names)

    def sizes(self, actor_class: str) -> dict[str, list[float]]:
        """Return the 5th, 50th and 95th percentile of each side of a class in the fleet, metres."""
        fleet = Fleet(self.country)
        drawn = [asset(fleet.body(actor_class, number)) for number in range(DRAWN)]
        return {
            side: np.round(
                np.quantile([getattr(one, side) for one in drawn], QUANTILES), 2
            ).tolist()
            for side in _SIDES
        }

    def __repr__(self) -> str:
        """Return the table of bodies, and the sizes of the fleet by class."""
        lines = [f"{'body':<24}{'class':<12}{'length x width x height, m':<30}{'postures':>8}"]
        for one in self.values():
            size = f"{one.length:.2f} x {one.width:.2f} x {one.height:.2f}"
            lines.append(f"{one.name:<24}{one.actor_class:<12}{size:<30}{one.phases:>8}")
        fleet = f"fleet of {self.country}" if self.country else "fleet"
        lines += ["", f"{fleet:<24}{'5, 50 and 95 % of length, width, height, m'}"]
        for name in self.classes:
            sides = ("  ".join(f"{x:.2f}" for x in values) for values in self.sizes(name).values())
            lines.append(f"  {name:<22}" + "    ".join(sides))
        return "\n".join(lines)

    def summary(self) -> Summary:
        """Return bodies and sizes in JSON-compatible form."""
        return Summary(
            actors=[
                {
                    "name": one.name,
                    "class": one.actor_class,
                    **{side: round(float(getattr(one, side)), 3) for side in _SIDES},
                    "postures": one.phases,
                }
                for one in self.values()
            ],
            fleet={name: self.sizes(name) for name in self.classes},
        )


@command
def actors(
    name: str | None = None,
    *,
    country: Annotated[str, "XX"] = "",
    save: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> ActorCatalogue:
    """List the bodies of actors, and their sizes.

    Args:
        name: class of actors: ``car``, ``van``, ``truck``, ...; all if not given.
        country: country of the fleet whose sizes are given, ISO 3166-1 alpha-2, such as ``DE``.
        save: picture of all bodies to write (.png).
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the class or country is unknown, or the picture cannot be written.

    Example:
        >>> ut.catalogue.actors("van")
        >>> ut.catalogue.actors(country="US").sizes("car")["length"]
        >>> ut.catalogue.actors(save="actors.png")
        $ urbantwin catalogue actors van --country DE
    """
    if name is not None and name not in ACTOR_CLASSES:
        raise InputError(f"no class of actors {name[:40]!r}", expected=", ".join(ACTOR_CLASSES))
    if country and not (len(country) == 2 and country.isascii() and country.isupper()):
        raise InputError(f"no country {country[:40]!r}", expected="two letters, such as DE or US")
    catalogue = ActorCatalogue(ACTOR_CLASSES if name is None else (name,), country)
    if save is not None:
        _save(catalogue, Path(save), progress)
    return catalogue


def _save(catalogue: ActorCatalogue, path: Path, progress: ShowProgress) -> None:
    if path.suffix.lower() != ".png":
        raise InputError("is no picture's name", file=path, expected="one that ends in .png")
    check_file(path, kind="actors")
    from urbantwin.drawing import style
    from urbantwin.drawing.actor_sheet import ShownActor, actor_sheet

    shown = [
        ShownActor(
            asset_mesh(one.name, 0),
            one.name,
            f"{one.length:.2f} x {one.width:.2f} x {one.height:.2f} m",
        )
        for one in catalogue.values()
    ]
    with shown_stage("actors", progress) as tell:
        figure = actor_sheet(shown, tell=tell)
        with replaced_file(path, kind="actors") as scratch:
            style.save(figure, scratch)
