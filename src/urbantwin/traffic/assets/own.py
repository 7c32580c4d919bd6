"""Bodies that a site brings along: meshes of its own beside those of the catalogue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from urbantwin.geometry import LabelledMesh
from urbantwin.traffic.assets.asset_name import AssetName
from urbantwin.traffic.assets.catalogue import Asset, asset

__all__ = ["OwnBodies"]

#: Where the wheels of a vehicle that says nothing of them stand, as parts of length and width.
_AXLES, _TRACK = (0.3, -0.3), 0.42


@dataclass(frozen=True, eq=False)
class OwnBodies:
    """The meshes of a site.

    Attributes:
        classes: class of each by its name.
        shares: which share of the actors of its class each is, 0..1.
        meshes: each in phase 0, in the asset frame.
    """

    classes: Mapping[str, str] = field(default_factory=dict)
    shares: Mapping[str, float] = field(default_factory=dict)
    meshes: Mapping[tuple[str, int], LabelledMesh] = field(default_factory=dict)

    def asset(self, name: str) -> Asset:
        """Return an asset, of the site's own or of the catalogue.

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
                [[x * length, y * width, 0.0] for x in _AXLES for y in (_TRACK, -_TRACK)]
            )
        return Asset(name, actor_class, 1, 0, length, width, height, contacts, 0.0)

    def of_class(self, actor_class: str) -> tuple[tuple[str, float], ...]:
        """Return names and shares of those of a class."""
        return tuple((n, self.shares[n]) for n, c in self.classes.items() if c == actor_class)
