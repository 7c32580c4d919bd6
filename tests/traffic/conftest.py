"""A crossing that tests drive over: plain XML -> netconvert -> a real twin on a slope."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import yaml

import urbantwin as ut
from urbantwin.artefact import sha256_of, write_json
from urbantwin.geometry import LabelledMesh
from urbantwin.ground import Elevation
from urbantwin.roads import sumo_binary
from urbantwin.roads.sumo_network import read_sumo_network
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic import Motion, run_traffic
from urbantwin.twin import Twin, load_twin

#: The ground of every twin here: z = 0.03 x + 0.02 y.
SLOPE = (0.03, 0.02)
ARM_M = 150.0
LIMIT_MS = 13.9

PER_HOUR = {
    "car": 1500.0,
    "truck": 120.0,
    "bus": 90.0,
    "motorcycle": 180.0,
    "bicycle": 240.0,
    "pedestrian": 2400.0,
}


def rows_of(table: pa.Table) -> np.recarray:
    """A table as an array of records."""
    names = table.column_names
    columns = [table[name].to_numpy() for name in names]
    return np.rec.fromarrays(columns, names=names)


def netconvert(folder: Path, nodes: str, edges: str, *options: str) -> Path:
    """Make a network from the text of plain XML nodes and edges."""
    (folder / "plain.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "plain.edg.xml").write_text(f"<edges>{edges}</edges>")
    net = folder / "made.net.xml"
    files = ["-n", folder / "plain.nod.xml", "-e", folder / "plain.edg.xml", "-o", net]
    fixed = ["--offset.disable-normalization", "true", "--no-turnarounds", "true"]
    command = [sumo_binary("netconvert"), *files, *fixed, *options]
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return net


def make_twin(folder: Path, net: Path, per_hour: dict[str, float], **traffic: float) -> Twin:
    """Write a twin of a network on the slope, and open it."""
    folder.mkdir()
    shutil.copy(net, folder / "network.net.xml")
    roads = read_sumo_network(net, driving_side="right", level_of_way={}, origin={})
    for lane in roads.lanes:
        lane.centre[:, 2] = lane.centre[:, :2] @ SLOPE
    roads.save(folder / "roads.json")
    half = ARM_M + 50
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    plane = np.column_stack([corners, corners @ SLOPE])
    faces = [[0, 1, 2], [0, 2, 3]]
    asphalt = semantic_id("road"), material_id("asphalt")
    LabelledMesh.build(plane, faces, *asphalt).save(folder / "scene.npz")
    Elevation.flat().save(folder / "elevation.npz")
    settings = {"duration_s": 60.0, "warmup_s": 60.0, "step_s": 0.1, "seed": 1, **traffic}
    site = {"traffic": {"per_hour": per_hour, **settings}}
    (folder / "site.yaml").write_text(yaml.safe_dump(site))
    region = [[-ARM_M, -ARM_M], [ARM_M, -ARM_M], [ARM_M, ARM_M], [-ARM_M, ARM_M]]
    manifest = {
        "kind": "twin",
        "version": "test",
        "name": "test",
        "driving_side": "right",
        "notes": {},
        "inputs": [],
        "anchor": {"latitude": 50.0, "longitude": 8.0},
        "region_m": region,
        "files": {path.name: sha256_of(path) for path in sorted(folder.iterdir())},
    }
    write_json(folder / "twin.json", manifest)
    return load_twin(folder)


@pytest.fixture(scope="session")
def make_net() -> Callable[..., Path]:
    return netconvert


@pytest.fixture(scope="session")
def twin_of() -> Callable[..., Twin]:
    return make_twin


@pytest.fixture(scope="session")
def records() -> Callable[[pa.Table], np.recarray]:
    return rows_of


@pytest.fixture(scope="session")
def slope() -> np.ndarray:
    return np.array(SLOPE)


@pytest.fixture(scope="session")
def limit_ms() -> float:
    return LIMIT_MS


@pytest.fixture(scope="session")
def per_hour() -> dict[str, float]:
    return dict(PER_HOUR)


@pytest.fixture(scope="session")
def crossing_net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four arms of two lanes each way, sidewalks, crossings and a signal."""
    ends = {"e": (ARM_M, 0.0), "n": (0.0, ARM_M), "w": (-ARM_M, 0.0), "s": (0.0, -ARM_M)}
    nodes = '<node id="c" x="0" y="0" type="traffic_light"/>'
    edges = ""
    for name, (x, y) in ends.items():
        nodes += f'<node id="{name}" x="{x}" y="{y}"/>'
        for start, end in ((name, "c"), ("c", name)):
            edges += (
                f'<edge id="{start}{end}" from="{start}" to="{end}" numLanes="2" '
                f'speed="{LIMIT_MS}" sidewalkWidth="2.5" type="highway.primary"/>'
            )
    folder = tmp_path_factory.mktemp("crossing")
    return netconvert(folder, nodes, edges, "--crossings.guess", "true", "--walkingareas", "true")


@pytest.fixture(scope="session")
def crossing_twin(crossing_net: Path, tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """The crossing as a twin with traffic of every class."""
    return make_twin(tmp_path_factory.mktemp("twins") / "crossing", crossing_net, PER_HOUR)


@pytest.fixture(scope="session")
def brief_twin(crossing_net: Path, tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """The same, whose streets fill for ten seconds only."""
    folder = tmp_path_factory.mktemp("twins") / "brief"
    return make_twin(folder, crossing_net, PER_HOUR, warmup_s=10.0)


MADE = {"two-avenues": "open_avenues_twin", "crossing": "crossing_twin"}


@pytest.fixture(scope="session")
def real_drive(
    request: pytest.FixtureRequest,
    shared_data: Path,
    made_once: Callable[[str, Callable[[Path], object]], Path],
) -> Callable[[str], tuple[Twin, Motion]]:
    """Return what gives the twin of an extract, as `init` proposes it, and 25 s of its traffic.

    ``two-avenues`` is the example and ``crossing`` is `crossing_twin`, with 40 s of their traffic.
    """

    def driven(place: str) -> tuple[Twin, Motion]:
        if place in MADE:
            twin = request.getfixturevalue(MADE[place])
            folder = made_once(
                f"drive-{place}",
                lambda folder: run_traffic(twin, folder / "motion", seconds=40),
            )
            return twin, Motion.load(folder / "motion")

        def make(folder: Path) -> None:
            ut.init(folder / "site", osm=shared_data / "osm" / f"{place}.osm", progress=False)
            site = folder / "site/site.yaml"
            twin = ut.build(site, folder / "twin", pictures=False, progress=False)
            ut.drive(twin, folder / "motion", seconds=25, progress=False)

        folder = made_once(f"drive-{place}", make)
        return load_twin(folder / "twin"), Motion.load(folder / "motion")

    return driven
