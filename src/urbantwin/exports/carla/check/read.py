"""A package as the rules read it: its documents, its mesh, its roads, and CARLA's view of them."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.artefact import passing_folder
from urbantwin.artefact.document import read_bytes
from urbantwin.errors import InputError
from urbantwin.exports.carla.package_documents import read_plan
from urbantwin.reconstruct.formats.fbx import read_fbx

__all__ = ["Mesh", "Package", "read_package", "read_roads"]

_PROGRAM = Path(__file__).with_name("map_program.py")
#: CARLA reads a map within this, seconds.
_LONGEST_S = 300


@dataclass(frozen=True, eq=False)
class Mesh:
    """The FBX.

    Attributes:
        corners: (F, 3, 3) of its triangles, site frame, metres.
        node: (F,) index into ``nodes``.
        nodes: names of its nodes.
        materials: of each node.
        version: of the file.
        unit_m: its unit.
    """

    corners: NDArray[np.float64]
    node: NDArray[np.int64]
    nodes: tuple[str, ...]
    materials: tuple[tuple[str, ...], ...]
    version: int
    unit_m: float

    def of(self, kind: str) -> NDArray[np.float64]:
        """Return the triangles (N, 3, 3) of the nodes of a kind: ``Road_Sidewalk``."""
        wanted = [k for k, name in enumerate(self.nodes) if name.startswith(f"{kind}_")]
        return self.corners[np.isin(self.node, wanted)]


@dataclass(frozen=True, eq=False)
class Package:
    """A package.

    Attributes:
        folder: what ``urbantwin export --to carla`` wrote.
        import_folder: what is copied to ``carla/Import``.
        name: of the map.
        plan: traffic, spawn points, rig, and what was written.
        mesh: the FBX.
        roads: root of the OpenDRIVE.
        carla: what CARLA's own library makes of it; ``None`` if it is not installed.
    """

    folder: Path
    import_folder: Path
    name: str
    plan: dict[str, Any]
    mesh: Mesh
    roads: etree._Element
    carla: dict[str, Any] | None


def read_package(folder: Path, python: str = sys.executable) -> Package:
    """Read a package.

    Args:
        folder: what ``urbantwin export --to carla`` wrote.
        python: an interpreter that may have ``carla``.

    Raises:
        InputError: a file is missing or cannot be read.
    """
    plan = read_plan(folder)
    name, package = plan["carla"]["map"], plan["carla"]["package"]
    base = folder / package / name / name
    xodr = base.with_suffix(".xodr")
    return Package(
        folder,
        folder / package,
        name,
        plan,
        _mesh(base.with_suffix(".fbx")),
        read_roads(xodr),
        _asked(xodr, name, plan["spawn_points"]["spawn_points"], python),
    )


def read_roads(path: Path) -> etree._Element:
    """Return the root of an OpenDRIVE.

    Raises:
        InputError: it is missing, or not XML.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True)
    try:
        return etree.fromstring(read_bytes(path, "the package's map of the roads"), parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise InputError(f"is not XML ({error})", file=path, expected="OpenDRIVE") from None


def _mesh(path: Path) -> Mesh:
    model = read_fbx(path)
    mesh = model.mesh
    if mesh is None:  # an FBX holds triangles, or is refused
        raise InputError("holds no triangle", file=path)
    header = path.read_bytes()[:27]
    pairs = [name.split(" / ") for name in mesh.names]
    nodes = list(dict.fromkeys(pair[0] for pair in pairs))
    materials: dict[str, list[str]] = {name: [] for name in nodes}
    for pair in pairs:
        materials[pair[0]].append(pair[-1])
    number = np.array([nodes.index(pair[0]) for pair in pairs])
    return Mesh(
        mesh.vertices[mesh.faces],
        number[mesh.object],
        tuple(nodes),
        tuple(tuple(materials[name]) for name in nodes),
        int.from_bytes(header[23:27], "little") if header.startswith(b"Kaydara FBX Binary") else 0,
        float(str(model.notes["unit_in_file_m"])),
    )


def _asked(
    xodr: Path, name: str, spawns: list[dict[str, Any]], python: str
) -> dict[str, Any] | None:
    """Ask CARLA's library, in a process of its own."""
    placed = [{key: one[key] for key in ("location", "rotation")} for one in spawns]
    with passing_folder("urbantwin-carla") as scratch:
        (scratch / "spawns.json").write_text(json.dumps(placed), encoding="utf-8")
        command = [python, "-P", str(_PROGRAM), str(xodr), name]
        command += [str(scratch / "spawns.json"), str(scratch)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                check=False,
                timeout=_LONGEST_S,
            )
        except subprocess.TimeoutExpired:
            raise InputError("CARLA does not come to an end with it", file=xodr) from None
        if "No module named 'carla'" in done.stderr:
            return None
        if done.returncode:
            said = [line for line in done.stderr.splitlines() if line.strip()]
            why = said[-1] if said else done.returncode
            raise InputError(f"CARLA cannot read it ({why})", file=xodr)
        answer: dict[str, Any] = json.loads((scratch / "answer.json").read_text(encoding="utf-8"))
    return answer
