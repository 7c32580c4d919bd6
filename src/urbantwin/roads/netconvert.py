"""SUMO's netconvert: topology, turn connections, junction shapes and signal programs."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from lxml import etree

from urbantwin.errors import StageError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.junctions.plain import PlainNetwork, read_plain, write_plain

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
    "geometry.max-grade": "1000",  # heights are the lane model's; netconvert's network is flat
    "no-turnarounds.except-deadend": "true",
    "output.original-names": "true",
    "output.street-names": "true",
}
#: How the map is read: every edge, its lanes and the ways on from them, no junction yet.
READING = {
    "ramps.guess": "true",
    "osm.sidewalks": "true",
    "osm.turn-lanes": "true",
    "osm.lane-access": "true",
    "osm.bike-access": "true",
    "default.sidewalk-width": "2.5",
    "keep-edges.by-vclass": "passenger,bus,bicycle,pedestrian",
}
#: How the network is made of edges whose junctions are known.
MAKING = {
    "geometry.remove": "true",
    "roundabouts.guess": "true",
    "junctions.corner-detail": "5",
    "tls.join": "true",
    "tls.default-type": "static",
    "tls.left-green.time": "12",
    "tls.allred.time": "2",  # to clear the junction (RiLSA 2015, 2.5); by default none
    "walkingareas": "true",
}
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
    edges: Path | None = None,
    reshape: Callable[[PlainNetwork], PlainNetwork] | None = None,
    out: Path,
) -> list[str]:
    """Run netconvert on OSM XML and write a network without comments, dates and paths.

    Args:
        osm: OSM XML with the ways of the network only, cut to the region.
        frame: the site frame, which the network's coordinates are in.
        driving_side: ``right`` or ``left``.
        keep_apart: ids of ways (bridges, outer roads) that stay roads of their own, not joined to
            the next.
        reshape: makes junctions of nodes and tells where people cross, once the map is read.
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
        read, made = Path(scratch) / "read", Path(scratch) / "made"
        raw = Path(scratch) / "raw.net.xml"
        side = ["--lefthand", "true" if driving_side == "left" else "false"]
        reading = [
            *("--osm-files", str(osm)),
            *("--type-files", types),
            *("--proj", frame.proj),
            *side,
            *_words(OPTIONS | READING),
            *("--plain-output-prefix", str(read)),
        ]
        if edges is not None:
            reading += ["--edge-files", str(edges)]
        warnings = _run_with(edges, reading, raw)
        plain = read_plain(read, raw)
        plain = plain if reshape is None else reshape(plain)
        making = [*write_plain(made, plain), *side, *_words(OPTIONS | MAKING)]
        apart = [
            f"{sign}{way}{piece}"
            for way in keep_apart
            for sign in ("", "-")
            for piece in ("", *(f"#{k}" for k in range(12)))
        ]
        # netconvert forgets what is crossed where it joins edges.
        apart += sorted({edge for crossing in plain.crossings for edge in crossing.edges})
        if apart:
            making += ["--geometry.remove.keep-edges.explicit", ",".join(apart)]
        warnings += run_netconvert(making, raw)
        write_network(raw, out)
    return warnings


def _words(options: Mapping[str, str]) -> list[str]:
    """Return options as they are written on a command line."""
    return [word for key, value in options.items() for word in (f"--{key}", value)]


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
