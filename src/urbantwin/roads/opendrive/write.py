"""Writing a lane network as OpenDRIVE."""

from __future__ import annotations

from pathlib import Path

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.opendrive.document import Map, document
from urbantwin.roads.streets.furniture import furnish
from urbantwin.roads.streets.manoeuvre import build_manoeuvres, find_topology
from urbantwin.roads.streets.street import build_streets

__all__ = ["VERSIONS", "opendrive_map", "write_opendrive"]

#: Versions of the standard that are written: the newest, and the one that CARLA reads.
VERSIONS = ("1.8", "1.4")


def write_opendrive(
    network: RoadNetwork, frame: SiteFrame, path: Path, *, version: str = "1.8", name: str
) -> None:
    """Write a lane network as an OpenDRIVE file, whole or not at all.

    Args:
        network: the lanes, with heights.
        frame: the site frame, which becomes the file's ``geoReference``.
        path: the ``.xodr`` to write.
        version: ``1.8``, or ``1.4`` for CARLA.
        name: the map's name.

    Raises:
        InputError: the version is not one that we write.
    """
    if version not in VERSIONS:
        raise InputError(
            f"OpenDRIVE {version!r} is not written", expected=f"one of {', '.join(VERSIONS)}"
        )
    content = document(opendrive_map(network, version), frame, version=version, name=name)
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_bytes(content)
    scratch.replace(path)


def opendrive_map(network: RoadNetwork, version: str) -> Map:
    """Return a lane network as roads, junctions and what stands on them.

    OpenDRIVE 1.4 knows right-hand traffic only. There, each direction of a street on which people
    drive on the left is a road of its own, its lanes to the right of its left border.
    """
    left = network.driving_side == "left"
    pair = not (left and version == "1.4")
    side = 1 if left and pair else -1
    topology = find_topology(network)
    streets = build_streets(network, list(topology.edges), topology.trims, pair=pair, side=side)
    manoeuvres = build_manoeuvres(network, streets, topology, side=side)
    furniture = furnish(network, streets, manoeuvres, topology)
    used = [junction.id for junction in network.junctions]
    used = [name for name in used if name in {m.junction for m in manoeuvres}]
    first = 1 + max(
        [len(streets) + len(manoeuvres)]
        + [c.number for c in furniture.controllers]
        + [s.number for s in furniture.signals]
        + [a.number for a in furniture.areas]
    )
    junctions = {name: first + k for k, name in enumerate(used)}
    return Map(streets, manoeuvres, furniture, "LHT" if left else "RHT", junctions)
