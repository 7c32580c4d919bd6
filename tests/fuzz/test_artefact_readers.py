"""Bad files in the folders that UrbanTwin itself writes, with their checksums right and wrong."""

import gzip
import hashlib
import io
import json
import shutil
import struct
import tarfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import laspy
import numpy as np
import osmium
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from urbantwin.artefact import read_json
from urbantwin.artefact.privacy import search_files
from urbantwin.artefact.tables import PARQUET
from urbantwin.cli.app import main
from urbantwin.dataset.card import write_cards
from urbantwin.dataset.frame_columns import COLUMNS, parquet_bytes
from urbantwin.dataset.frame_las import laz_bytes
from urbantwin.dataset.reading.frame_files import FrameFiles
from urbantwin.dataset.rig_of_manifest import rig_of_manifest
from urbantwin.dataset.split import SplitAsked, datasets_at, read_split_document, split_in_time
from urbantwin.dataset.split.scenarios import scenarios_of
from urbantwin.drawing.labelled_frame import read_labelled_points
from urbantwin.drawing.surface_colours import surface_colours
from urbantwin.errors import InputError
from urbantwin.experiments.journal import Journal as StepJournal
from urbantwin.exports.carla.package import spawn_points
from urbantwin.exports.geojson import write_geojson
from urbantwin.fidelity.challenge import read_detections
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.tuning.study import Journal
from urbantwin.geometry import LabelledMesh
from urbantwin.interface.dataset import Dataset, Fleet
from urbantwin.interface.rig import rig_on
from urbantwin.lidar.background import MeasuredBackground
from urbantwin.lidar.background_file import load_backgrounds, save_backgrounds
from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.roads.signals.programs import described_signals
from urbantwin.studies.placement.folder import read_layouts
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.traffic import Motion
from urbantwin.traffic.demand.demand import plan_demand
from urbantwin.traffic.motion import describe as describe_motion
from urbantwin.twin import Twin, load_twin
from urbantwin.web import open_shown
from urbantwin.web.beside import read_report, worst_places
from urbantwin.web.chosen_frames import ChosenFrames
from urbantwin.web.side import FrameEntry
from urbantwin.web.wanted import Wanted

from .artefact_set import PLACE, artefacts, content, make_artefacts
from .harness import NUMBERS
from .reader import Reader
from .test_site_readers import made

#: Files of an artefact that are not read by anything that the others are read by.
_BESIDE = {
    "twin": ("scene.npz", "site.yaml", "rig.yaml", "network.net.xml", "elevation.npz",
             "lane_model.json", "roads.json", "surface_material.npz", "colours.npz"),
    "motion": ("motion.json", "actors.parquet", "signals.parquet", "meshes.npz"),
    "dataset": ("dataset.json", "boxes.parquet", "sweeps.parquet", "ignore_regions.geojson",
                "tracks.parquet", "tracklets.parquet", "trajectories.parquet", "poses.parquet",
                "lanes.parquet", "ImageSets/train.txt", "points/000000.npy", "rays/000000.npy",
                "semantic/000000.label", "labels/000000.txt"),
    "fleet": ("fleet.json", "boxes.parquet", "nodes.parquet",
              *(f"{node}/{name}" for node in ("pole", "roof") for name in
                ("dataset.json", "boxes.parquet", "sweeps.parquet", "ImageSets/train.txt",
                 "points/000000.npy", "rays/000000.npy", "semantic/000000.label"))),
}  # fmt: skip


def beside(kind: str) -> Callable[[], Mapping[str, bytes]]:
    """What gives the sound files of an artefact, with their manifest."""
    names = (f"{kind}.json", *(name for name in _BESIDE[kind]))
    return lambda: {f"{kind}/{name}": content(f"{kind}/{name}") for name in names}


def inspected(path: Path) -> None:
    """What `inspect` does with the folder of a file."""
    code = main(["info", str(path.parent)])
    assert code in (0, 1, 2), code


def of_twin(use: Callable[[Twin], object]) -> Callable[[Path], None]:
    """What reads a twin in which the checksum of the bad file is right, and uses it."""

    def read(path: Path) -> None:
        file = path.parent / "twin.json"
        manifest = json.loads(file.read_text())
        manifest["files"][path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        file.write_text(json.dumps(manifest))
        use(load_twin(path.parent))

    return read


def use_mesh(twin: Twin) -> None:
    rig_on(twin)
    twin.ground_mesh.areas()
    twin.surface_materials.materials_of(
        twin.mesh, np.arange(len(twin.mesh.faces)), twin.mesh.triangles().mean(axis=1)
    )


def use_model(twin: Twin) -> None:
    place = twin.folder.with_name("written")
    for version in ("1.8", "1.4"):
        write_opendrive(twin.lane_model, twin.frame, place / "a.xodr", version=version, name="a")
    write_geojson(twin, place / "a.geojson")


def use_roads(twin: Twin) -> None:
    twin.roads.carriageway(0)
    twin.roads.footway(0)
    spawn_points(twin.roads)
    write_geojson(twin, twin.folder.with_name("written") / "a.geojson")


def use_network(twin: Twin) -> None:
    described_signals(twin.net_path)
    network = StreetNetwork(twin.net_path, twin.region)
    asked = twin.site["traffic"]
    plan_demand(
        network, asked["per_hour"], warmup_s=10, duration_s=1, seed=1,
        body=lambda name, number: f"{name}-x",
    )  # fmt: skip


def read_motion(path: Path) -> None:
    describe_motion(path.parent)
    motion = Motion.load(path.parent)
    _looked_at(path.parent)
    for time_s in motion.times()[:3]:
        for row in motion.at(float(time_s))[:5]:
            motion.mesh(str(row["asset"]), int(row["phase"]))


def read_dataset(path: Path) -> None:
    """What pictures, `compare` and the arbitrary site do with a dataset."""
    folder = next(one for one in path.parents if one.name == "dataset")
    problems = []
    for use in (
        read_labelled_points,
        _compared,
        _followed,
        _looked_at,
        lambda one: inspected(one / "dataset.json"),
        lambda one: write_cards(one, to=one.with_name("card")),
    ):
        try:
            use(folder)
        except Exception as error:
            problems.append(error)
    for error in problems:
        raise error


def read_fleet(path: Path) -> None:
    """What people, other readers and pages do with a fleet."""
    folder = path.parent
    problems = []
    for use in (
        _nodes_used,
        lambda one: open_recording(one).read(0),
        _looked_at,
        lambda one: inspected(one / "fleet.json"),
    ):
        try:
            use(folder)
        except Exception as error:
            problems.append(error)
    for error in sorted(problems, key=lambda one: isinstance(one, InputError)):
        raise error


def _nodes_used(folder: Path) -> None:
    fleet = Fleet(folder)
    for frame in list(fleet)[:1]:
        str(frame)
        _ = frame.box_array
        for using, at in (("true", "same"), ("reported", "nearest"), ("true", "extrapolated")):
            frame.fused(frame_of="pole", using=using, at=at)
    fleet.summary()


def _compared(folder: Path) -> None:
    recording = open_recording(folder)
    recording.read(0)
    rig_of_manifest(read_json(folder / "dataset.json", kind="dataset"))


def _followed(folder: Path) -> None:
    """What people do with a dataset in Python."""
    dataset = Dataset(folder)
    problems = []
    for use in (
        lambda: [dataset.tracks, dataset.tracklets, dataset.poses, dataset.lanes],
        lambda: dataset.split("train"),
        lambda: dataset[0].trajectories(past=1.0),
        lambda: [dataset[0].site_SE3_ego, dataset[0].site_SE3_sensor(reported=True)],
        lambda: dataset[0].flow(ego=True),
        lambda: dataset[0].cloud,
        lambda: dataset.where(within_m=50, max_occlusion=0.5, counted=True, with_boxes=True)[:],
    ):
        try:
            use()
        except Exception as error:
            problems.append(error)
    for error in sorted(problems, key=lambda one: isinstance(one, InputError)):
        raise error


def _looked_at(folder: Path) -> None:
    """What a page shows of a dataset or a motion."""
    shown = open_shown(Wanted(folder, frames=ChosenFrames(0, 2)))
    json.dumps(shown.document(), allow_nan=False)
    for name in shown.names():
        shown.packet(name)


def _worst(path: Path) -> None:
    entries = [FrameEntry("1", 0.0)]
    report = read_report(path.parent)
    found = worst_places(report, [(0, 0)], entries, None, lambda *_: np.zeros(3))
    json.dumps(found, allow_nan=False)


def _background() -> bytes:
    image = np.full((2, 4, 6), 12.0, np.float32)
    small = np.full_like(image, 0.4)
    one = MeasuredBackground(image, small, small, small, np.full((4, 6), 9, np.int32), "A", 10.0)
    return made("a.npz", lambda path: save_backgrounds(path, [one]))


def _kept_journal(path: Path) -> None:
    with Journal(path, "abc") as journal:
        journal.recall("one", 0, [0.5])


def _report() -> bytes:
    """What `compare` writes, as far as `inspect` tells it."""
    figures = {"chamfer": {"mean": 0.4}}
    report = {
        "kind": "report", "version": 1, "in_short": ["a"], "doubts": ["b"],
        "folders": {"real": "a", "synthetic": "b"},
        "frames": [{"real": "1", "twin_figures": {"hausdorff_p95_m": 0.5}}],
        "aggregate": figures, "definitions": {"chamfer": "c"},
        "anchors": {"real_against_real": figures, "arbitrary": None,
                    "reduction_percent": {"chamfer": 12.0}, "ratio_to_real": {"chamfer": None}},
        "headline": {"ground": {"chamfer": {"twin": 0.1}}},
        "protocol": {"scores": {"twin": {"combined": 0.1, "detection": None, "realism": 0.2}}},
        "problems": [], "notes": ["c"],
        "missing": [{"x": 1.0, "y": 2.0, "low": 0.0, "high": 1.0, "points_per_frame": 3.0,
                     "distance_m": 0.5}],
    }  # fmt: skip
    return json.dumps(report).encode()


def _seeds(name: str) -> Callable[[], list[bytes]]:
    return lambda: [content(name)]


def _of_twin(name: str, use: Callable[[Twin], object]) -> Reader:
    return Reader(f"twin {name}", of_twin(use), f"twin/{name}", _seeds(f"twin/{name}"),
                  beside("twin"))  # fmt: skip


def _frame_files(path: Path) -> None:
    frame = FrameFiles(path.parent.parent, path.stem)
    assert len(frame.points) == len(frame.labels) == len(frame.rays)


def _packed(as_bytes: Callable[[dict[str, np.ndarray]], bytes]) -> bytes:
    """The file of a small frame."""
    draw, count = np.random.default_rng(1), 40
    return as_bytes({name: draw.integers(0, 2, count).astype(one) for name, one in COLUMNS.items()})


def _split_boxes(path: Path) -> None:
    (source,) = datasets_at([path.parent])
    scenarios_of([source, source])
    split_in_time(source.recorded, SplitAsked(moved_m=0.5))


SPLIT = b'{"kind": "split", "datasets": [{"path": "one", "part": "train", "kept": ["000000"]}]}'


def _told_by(ending: str) -> Callable[[], list[bytes]]:
    """A small file of a format that says something of somebody."""
    return lambda: [made(f"a.{ending}", _SAYS[ending])]


def _image(path: Path) -> None:
    exif = Image.Exif()
    exif[0x013B] = "jdoe"
    Image.new("RGB", (4, 4)).save(path, exif=exif)


def _survey(path: Path) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=1, version="1.2"))
    cloud.x = cloud.y = cloud.z = cloud.gps_time = np.arange(5.0)
    cloud.write(path)


def _tar(path: Path) -> None:
    with tarfile.open(path, "w") as packed:
        one = tarfile.TarInfo("a.json")
        one.size, one.uname = len(EXPORTED), "jdoe"
        packed.addfile(one, io.BytesIO(EXPORTED))


def _zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("a.json", EXPORTED)


def _glb(path: Path) -> None:
    text = b'{"asset": {"version": "2.0", "generator": "/home/jdoe/x"}}  '
    head = struct.pack("<III", 0x46546C67, 2, 20 + len(text))
    path.write_bytes(head + struct.pack("<II", len(text), 0x4E4F534A) + text)


def _map(path: Path) -> None:
    with osmium.SimpleWriter(path) as writer:
        node = osmium.osm.mutable.Node(id=1, location=(9.0, 48.0), user="jdoe", uid=7)
        writer.add_node(node)


EXPORTED = (
    b'{"kind": "exported", "format": "kitti", "urbantwin": "0.1.0", "inputs": [{"kind": "osm", '
    b'"name": "a", "licence": "ODbL-1.0", "attribution": "b"}], "losses": ["c"], "notes": []}'
)
_SAYS = {
    "json": lambda path: path.write_bytes(EXPORTED),
    **dict.fromkeys(("png", "jpg", "tif"), _image),
    "las": _survey,
    "tar": _tar,
    "zip": _zip,
    "npz": lambda path: np.savez(path, about=np.array('{"user": "jdoe"}'), t=np.arange(4.0)),
    "gz": lambda path: path.write_bytes(gzip.compress(EXPORTED, mtime=0)),
    "parquet": lambda path: pq.write_table(
        pa.table({"user": ["a", "b"], "time": [1.0, 2.0]}), path
    ),
    "ply": lambda path: path.write_bytes(
        b"ply\nformat ascii 1.0\ncomment /home/a/b\nend_header\n1 2"
    ),
    "glb": _glb,
    "pbf": _map,
}
DETECTIONS = b'{"0001": [{"box": [1, 2, 0.5, 4, 2, 1.5, 0.1], "score": 0.9, "class": "Car"}]}'
JOURNAL = (
    b'{"recipe": "abc"}\n{"study": "one", "trial": 0, "shares": [0.5], "loss": 1.5}\n'
    b'{"study": "one", "trial": 1, "shares": [0.25], "loss": 1.25}\n'
)

CELLS = (
    b'{"cell": "ab", "state": "done", "attempts": 1, "seconds": 2.5}\n'
    b'{"cell": "cd", "state": "failed", "attempts": 2, "why": "SUMO fell over"}\n'
)

CAMPAIGN = (
    b'{"kind": "campaign", "cells": 2, "axes": {"site": ["a"], "seed": [1]}, "counts": '
    b'{"frames": 4, "points": 9, "boxes": 3, "bytes": 70}, "datasets": '
    b'[{"path": "datasets/a-1", "levels": {"site": "a", "seed": 1}, '
    b'"frames": 4, "manifest_sha256": "00"}], "failed": [{"path": "datasets/b", "why": "SUMO"}]}'
)

PLACEMENT = (
    b'{"kind": "placement", "layouts": 1, "views_cast": 1, "candidates": 2, "moments": 3, '
    b'"actors": {"car": 4}, "objectives": ["cost", "seen_20"], "front": ["layout-0000"]}'
)


def _layouts() -> bytes:
    columns = {"layout": [0], "front": [True], "what": ["a sensor"]}
    table = pa.table(columns | {name: [0.5] for name in MEASURES})
    return made("a.parquet", lambda path: pq.write_table(table, path, **PARQUET))


def _beside_placement() -> dict[str, bytes]:
    return {"layouts.parquet": _layouts()}


READERS = [
    Reader("twin.json", inspected, "twin/twin.json", _seeds("twin/twin.json"), beside("twin")),
    Reader("twin changed", inspected, "twin/scene.npz", _seeds("twin/scene.npz"), beside("twin")),
    _of_twin("scene.npz", use_mesh),
    _of_twin("surface_material.npz", use_mesh),
    _of_twin("colours.npz", lambda twin: surface_colours(twin.mesh, twin.colours)),
    _of_twin("elevation.npz", lambda twin: twin.elevation.raw_at(np.zeros((3, 2)))),
    _of_twin("lane_model.json", use_model),
    _of_twin("roads.json", use_roads),
    _of_twin("network.net.xml", use_network),
    _of_twin("site.yaml", lambda twin: twin.site),
    _of_twin("rig.yaml", rig_on),
    *(
        Reader(f"motion {name}", read_motion, f"motion/{name}", _seeds(f"motion/{name}"),
               beside("motion"))
        for name in _BESIDE["motion"]
    ),
    *(
        Reader(f"dataset {name}", read_dataset, f"dataset/{name}", _seeds(f"dataset/{name}"),
               beside("dataset"))
        for name in _BESIDE["dataset"]
    ),
    *(
        Reader(f"fleet {name}", read_fleet, f"fleet/{name}", _seeds(f"fleet/{name}"),
               beside("fleet"))
        for name in ("fleet.json", "boxes.parquet", "nodes.parquet")
    ),
    Reader("frame in columns", _frame_files, "points/f.parquet", lambda: [_packed(parquet_bytes)]),
    Reader("frame as laz", _frame_files, "points/f.laz", lambda: [_packed(laz_bytes)]),
    Reader("split of datasets", read_split_document, "a.json", lambda: [SPLIT],
           lambda: {"one/dataset.json": content("dataset/dataset.json")}),
    Reader("split of boxes", _split_boxes, "dataset/boxes.parquet",
           _seeds("dataset/boxes.parquet"), beside("dataset")),
    Reader("split of manifest", _split_boxes, "dataset/dataset.json",
           _seeds("dataset/dataset.json"), beside("dataset")),
    Reader("report, looked at", _worst, "report.json", lambda: [_report()]),
    Reader("mesh", LabelledMesh.load, "a.npz", _seeds("twin/scene.npz")),
    Reader("coverage", inspected, "coverage.json", _seeds("coverage/coverage.json")),
    Reader("placement", inspected, "placement.json", lambda: [PLACEMENT], _beside_placement),
    Reader("layouts", read_layouts, "layouts.parquet", lambda: [_layouts()]),
    Reader("report", inspected, "report.json", lambda: [_report()]),
    Reader("background", load_backgrounds, "a.npz", lambda: [_background()]),
    Reader("exported card", lambda path: write_cards(path.parent, "exported"), "exported.json",
           lambda: [EXPORTED]),
    *(
        Reader(f"privacy {ending}", search_files, f"a.{ending}", _told_by(ending))
        for ending in ("json", "png", "jpg", "tif", "las", "tar", "zip", "npz", "gz", "parquet",
                       "ply", "glb", "pbf")
    ),
    Reader("detections", read_detections, "a.json", lambda: [DETECTIONS]),
    Reader("journal", _kept_journal, "journal", lambda: [JOURNAL]),
    Reader(
        "journal of steps",
        lambda file: StepJournal(file.parent, file.name),
        "steps.jsonl",
        lambda: [CELLS],
    ),
    Reader("campaign", inspected, "campaign.json", lambda: [CAMPAIGN]),
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def made_artefacts(made_once: Callable[[str, Callable[[Path], object]], Path]) -> Iterator[None]:
    """Make the artefacts once for this process, the readers' and those of other workers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(PLACE, str(made_once("fuzz-artefacts", make_artefacts)))
        yield


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)


def test_the_sound_files_are_read(tmp_path: Path) -> None:
    """Otherwise all of the above could pass by refusing everything."""
    folder = tmp_path / "copy"  # what is written goes beside it
    shutil.copytree(artefacts(), folder)
    for use in (use_mesh, use_model, use_roads, use_network, rig_on, lambda twin: twin.site):
        use(load_twin(folder / "twin"))
    read_motion(folder / "motion" / "motion.json")
    read_dataset(folder / "dataset" / "dataset.json")
    read_fleet(folder / "fleet" / "fleet.json")
