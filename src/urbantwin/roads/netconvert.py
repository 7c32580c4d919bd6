"""SUMO's netconvert: topology, turn connections, junction shapes and signal programs."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from lxml import etree

from urbantwin.errors import StageError
from urbantwin.geometry import SiteFrame

__all__ = [
    "run_netconvert",
    "sumo_binary",
    "sumo_environment",
    "sumo_home",
    "sumo_network",
    "write_network",
]

OPTIONS = {
    "offset.disable-normalization": "true",  # keep the site frame
    "precision": "3",
    "geometry.remove": "true",
    "geometry.max-grade": "1000",  # heights are the lane model's; netconvert's network is flat
    "roundabouts.guess": "true",
    "junctions.join": "true",
    "junctions.corner-detail": "5",
    "ramps.guess": "true",
    "tls.join": "true",
    "tls.default-type": "static",
    "tls.left-green.time": "12",
    "tls.allred.time": "2",  # to clear the junction (RiLSA 2015, 2.5); by default none
    "osm.sidewalks": "true",
    "osm.turn-lanes": "true",
    "osm.lane-access": "true",
    "osm.bike-access": "true",
    "crossings.guess": "true",
    "walkingareas": "true",
    "default.sidewalk-width": "2.5",
    "no-turnarounds.except-deadend": "true",
    "output.original-names": "true",
    "output.street-names": "true",
    "keep-edges.by-vclass": "passenger,bus,bicycle,pedestrian",
}
#: What netconvert says of a cluster that it does not join because too many roads meet there.
TOO_MANY = re.compile(r"Not joining junctions ([\w:,#-]+) \(\d+ incoming edges\)")
#: The edge that an error of netconvert's is about, and how many such edges are accepted.
EDGE = re.compile(r"edge '([^']+)'")
MOST_UNKNOWN = 8
TYPE_FILES = ("osmNetconvert.typ.xml", "osmNetconvertBicycle.typ.xml")


def sumo_home() -> Path:
    """Return the folder of the ``eclipse-sumo`` package.

    The package is found, not imported: importing it points PROJ of this whole process to
    SUMO's own, older database, after which ``pyproj`` and ``rasterio`` fail.

    Raises:
        StageError: the package is not installed.
    """
    found = importlib.util.find_spec("sumo")
    if found is None or not found.submodule_search_locations:
        raise StageError("SUMO is not installed: pip install eclipse-sumo")
    return Path(found.submodule_search_locations[0])


def sumo_binary(name: str) -> Path:
    """Return the path of a program of the ``eclipse-sumo`` package."""
    return sumo_home() / "bin" / name


def sumo_environment() -> dict[str, str]:
    """Return the environment that SUMO's programs run in: with SUMO's own PROJ database."""
    proj = str(sumo_home() / "data" / "proj")
    return {**os.environ, "SUMO_HOME": str(sumo_home()), "PROJ_LIB": proj, "PROJ_DATA": proj}


def sumo_network(
    osm: Path,
    frame: SiteFrame,
    *,
    driving_side: str,
    keep_apart: Iterable[int],
    keep_nodes: Iterable[int] = (),
    edges: Path | None = None,
    out: Path,
) -> list[str]:
    """Run netconvert on OSM XML and write a network without comments, dates and paths.

    Args:
        osm: OSM XML with the ways of the network only, cut to the region.
        frame: the site frame, which the network's coordinates are in.
        driving_side: ``right`` or ``left``.
        keep_apart: ids of ways (bridges, outer roads) that stay roads of their own, not joined to
            the next.
        keep_nodes: ids of nodes that are not merged with others into one junction.
        edges: attributes of the edges that it makes of ways; edges that it does not make are taken
            out of the file.
        out: the ``.net.xml`` to write.

    Returns:
        netconvert's warnings, one a line, in the order given.

    Raises:
        StageError: netconvert failed.
    """
    types = ",".join(str(sumo_home() / "data" / "typemap" / name) for name in TYPE_FILES)
    with tempfile.TemporaryDirectory(prefix="netconvert-", dir=out.parent) as scratch:
        raw = Path(scratch) / "raw.net.xml"
        command = [
            *("--osm-files", str(osm)),
            *("--type-files", types),
            *("--proj", frame.proj),
            *("--lefthand", "true" if driving_side == "left" else "false"),
        ]
        apart = [
            f"{sign}{way}{piece}"
            for way in keep_apart
            for sign in ("", "-")
            for piece in ("", *(f"#{k}" for k in range(12)))
        ]
        if apart:
            command += ["--geometry.remove.keep-edges.explicit", ",".join(apart)]
        if edges is not None:
            command += ["--edge-files", str(edges)]
        if nodes := ",".join(str(node) for node in keep_nodes):
            command += ["--junctions.join-exclude", nodes]
        for key, value in OPTIONS.items():
            command += [f"--{key}", value]
        warnings = _run_with(edges, command, raw)
        clusters = [found[1] for line in warnings if (found := TOO_MANY.search(line))]
        if clusters:
            # One junction of many nodes, which netconvert by itself leaves in pieces: each with
            # signals of its own, so that traffic locks up between them.
            joins = Path(scratch) / "joins.nod.xml"
            rows = "".join(f'<join nodes="{ids.replace(",", " ")}"/>' for ids in clusters)
            joins.write_text(f"<nodes>{rows}</nodes>")
            warnings = run_netconvert([*command, "--node-files", str(joins)], raw)
        write_network(raw, out)
    return warnings


def _run_with(edges: Path | None, command: list[str], raw: Path) -> list[str]:
    """Run netconvert, leaving out the attributes of edges that it did not make as expected."""
    for _ in range(MOST_UNKNOWN):
        try:
            return run_netconvert(command, raw)
        except StageError as error:
            unknown = set(EDGE.findall(str(error.args[0])))
            if edges is None or not unknown:
                raise
            root = etree.parse(edges).getroot()
            for element in root.findall("edge"):
                if element.get("id") in unknown:
                    root.remove(element)
            edges.write_bytes(etree.tostring(root))
    return run_netconvert(command, raw)


def write_network(raw: Path, out: Path) -> None:
    """Write a network that netconvert wrote once more, without comments, dates and paths."""
    root = etree.parse(raw, etree.XMLParser(remove_comments=True)).getroot()
    etree.indent(root, space=" ")
    out.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n")


def run_netconvert(options: list[str], raw: Path) -> list[str]:
    """Run netconvert.

    Args:
        options: its options.
        raw: the network to write.

    Returns:
        Its warnings, one a line, in the order given.

    Raises:
        StageError: it failed.
    """
    command = [str(sumo_binary("netconvert")), *options, "--output-file", str(raw)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=sumo_environment()
    )
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode or not raw.exists():
        errors = [line for line in lines if line.startswith("Error")] or lines[-1:]
        raise StageError(f"netconvert failed: {' '.join(errors[:2]) or 'no message'}")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning")]
