"""Assets of a twin's actors: those of its site and those usual in its country."""

from __future__ import annotations

from urbantwin.site.country import country_of
from urbantwin.site.traffic import OwnAssetSpec
from urbantwin.traffic.assets import Fleet, OwnBodies
from urbantwin.twin import Twin

__all__ = ["fleet_of", "own_bodies"]


def fleet_of(twin: Twin, seed: int) -> Fleet:
    """Return the fleet of a twin's country, with the assets that its site defines."""
    anchor = twin.manifest["anchor"]
    country = country_of(float(anchor["latitude"]), float(anchor["longitude"]))
    return Fleet(country, seed, own_bodies(twin))


def own_bodies(twin: Twin) -> OwnBodies:
    """Return the assets that a twin's site defines."""
    specs = [OwnAssetSpec.model_validate(entry) for entry in twin.site["traffic"].get("assets", ())]
    return OwnBodies(
        {spec.name: spec.actor_class for spec in specs},
        {spec.name: spec.share for spec in specs},
        {(name, 0): mesh for name, mesh in twin.own_meshes.items()},
    )
