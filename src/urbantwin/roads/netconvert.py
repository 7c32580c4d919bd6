"""SUMO's netconvert: topology, turn connections, junction shapes and signal programs."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from lxml import etree

from urbantwin.errors import StageError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.junctions.plain import PlainNetwork, PlainNode, read_plain, write_plain
from urbantwin.roads.junctions.strip import split_edges

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
    "xml-validation": "never",  # of our own files: it takes a quarter of a small run
}
#: Options for reading the map: edges, lanes and connections, without junctions.
READING = {
    "ramps.guess": "true",
    "osm.sidewalks": "true",
    "osm.turn-lanes": "true",
    "osm.lane-access": "true",
    "osm.bike-access": "true",
    "default.sidewalk-width": "2.5",
    "keep-edges.by-vclass": "passenger,bus,bicycle,pedestrian,authority",  # closed: `NOBODY`
}
#: Options for making the network from edges with known junctions.
MAKING = {
    "geometry.remove": "true",
    "roundabouts.guess": "true",
    "junctions.corner-detail": "5",
    "tls.join": "true",
    "tls.default-type": "actuated",
    "tls.left-green.time": "12",
    "tls.allred.time": "2",  # to clear the junction (RiLSA 2015, 2.5); by default none
    "walkingareas": "true",
    "geometry.avoid-overlap": "false",  # moved apart before, with links drawn from there
    "aggregate-warnings": "-1",
}
#: Edge id in netconvert's error messages, and the maximum number of runs that remove such edges.
EDGE = re.compile(r"edge (?:with id )?'([^']+)'")
MOST_UNKNOWN = 8
#: netconvert's messages on crossings without an access and on dropped ones, and the maximum number
#: of attempts.
NOWHERE = re.compile(r"crossing '[^']*' across \[([^]]*)\] has no")
DROPPED = "Discarding invalid crossing"
MOST_ATTEMPTS = 4
TYPE_FILES = ("osmNetconvert.typ.xml", "osmNetconvertBicycle.typ.xml")


def sumo_home() -> Path:
    """Return the folder of the ``eclipse-sumo`` package.

    The package is located, not imported: its import would set PROJ of this process to SUMO's own,
    older database, after which ``pyproj`` and ``rasterio`` fail.

    Raises:
        StageError: the package is not installed.
    """
    spec = importlib.util.find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise StageError("SUMO is not installed: pip install eclipse-sumo")
    return Path(spec.submodule_search_locations[0])


def sumo_binary(name: str) -> Path:
    """Return the path of a program of the ``eclipse-sumo`` package."""
    return sumo_home() / "bin" / name


def sumo_environment() -> dict[str, str]:
    """Return the environment for SUMO's programs, with SUMO's own PROJ database."""
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
        frame: the site frame, in which the network's coordinates are.
        driving_side: ``right`` or ``left``.
        keep_apart: ids of ways (bridges, outer roads) that stay separate edges.
        edges: attributes of edges; those of missing edges are removed from the file.
        reshape: function that makes junctions and crossings after the map is read.
        out: the ``.net.xml`` to write.

    Returns:
        netconvert's warnings, one per line, in their order.

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
        plain, loops = _without_self_loops(plain)
        apart = [
            f"{sign}{way_id}{piece}"
            for way_id in keep_apart
            for sign in ("", "-")
            for piece in ("", *(f"#{k}" for k in range(12)))
        ]
        apart += loops
        warnings += _make(plain, apart, [*side, *_words(OPTIONS | MAKING)], made, raw)
        write_network(raw, out)
    return warnings


def _without_self_loops(plain: PlainNetwork) -> tuple[PlainNetwork, list[str]]:
    """Split edges that begin and end at one node, which netconvert would drop.

    These are slip lanes and crescents with both ends in one junction of many nodes.

    Returns:
        The network, and the names of the parts.
    """
    parts: list[str] = []
    for name, edge in [(k, v) for k, v in plain.edges.items() if v.start == v.end]:
        half = float(edge.line.length) / 2
        node = PlainNode(f"{name}.middle", np.array(edge.line.interpolate(half).coords[0]), {})
        plain, before = split_edges(plain, node, {name: half})
        parts += [name, before[name]]
    return plain, parts


def _make(
    plain: PlainNetwork, apart: Sequence[str], options: Sequence[str], made: Path, raw: Path
) -> list[str]:
    """Make the network of plain edges and return the warnings.

    A crossing without access makes netconvert drop others at the same node: it is left out.
    """
    for attempt in range(MOST_ATTEMPTS):
        # netconvert loses crossed edges when it joins edges.
        crossed = {edge for crossing in plain.crossings for edge in crossing.edges}
        keep = ",".join([*apart, *sorted(crossed)])
        keep_option = ["--geometry.remove.keep-edges.explicit", keep] if keep else []
        warnings = run_netconvert([*write_plain(made, plain), *options, *keep_option], raw)
        nowhere = {frozenset(match[1].split()) for match in map(NOWHERE.search, warnings) if match}
        dropped = any(DROPPED in line for line in warnings)
        if not nowhere or not dropped or attempt == MOST_ATTEMPTS - 1:
            break
        crossings = tuple(c for c in plain.crossings if frozenset(c.edges) not in nowhere)
        plain = replace(plain, crossings=crossings)
    return warnings


def _words(options: Mapping[str, str]) -> list[str]:
    """Return options as command line words."""
    return [word for key, value in options.items() for word in (f"--{key}", value)]


def _run_with(edges: Path | None, command: list[str], raw: Path) -> list[str]:
    """Run netconvert; attributes of edges that it reports as unknown are removed."""
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
    """Write a copy of netconvert's network without comments, dates and paths."""
    root = etree.parse(raw, etree.XMLParser(remove_comments=True)).getroot()
    etree.indent(root, space=" ")
    out.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n")


def run_netconvert(options: list[str], raw: Path) -> list[str]:
    """Run netconvert.

    Args:
        options: its options.
        raw: the network to write.

    Returns:
        Its warnings, one per line, in their order.

    Raises:
        StageError: it failed.
    """
    command = [str(sumo_binary("netconvert")), *options, "--output-file", str(raw)]
    process = subprocess.run(
        command,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        env=sumo_environment(),
    )
    lines = [line.strip() for line in process.stderr.splitlines() if line.strip()]
    if process.returncode or not raw.exists():
        errors = [line for line in lines if line.startswith("Error")] or lines[-1:]
        raise StageError(f"netconvert failed: {' '.join(errors[:2]) or 'no message'}")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning")]
