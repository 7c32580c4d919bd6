"""A task whose optional packages are missing is refused in one line that says how to install them.

The packages are really missing: the program runs in a process that cannot import any of them, as
after a plain installation.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import DracoPy
import laspy
import meshopt
import numpy as np
import pytest
from pyproj import Transformer

from urbantwin.extras import EXTRAS
from urbantwin.traffic.motion import MOTION_VERSION

from .dataset.conftest import dataset, motion, motion_of, rig, twin
from .io.tile_bytes import Gltf
from .thorough import further

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["dataset", "motion", "motion_of", "rig", "twin"]

#: Each line of its input is a folder and a command line: one process imports what they share once.
WITHOUT = """
import contextlib, io, json, os, sys, traceback

NAMES = sys.argv.pop(1).split(",")

class Without:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        return None if name in NAMES else self.finder.find_spec(name, path, target)

sys.meta_path[:] = map(Without, sys.meta_path)
from urbantwin.cli import main
for line in sys.stdin:
    folder, arguments = json.loads(line)
    os.chdir(folder)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(arguments)
        except Exception:
            code = traceback.print_exc()
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""
#: Extra, the module that is missing, and a command that needs it.
COMMANDS = [
    ("bags", "rosbags", "compare drive.bag dataset -o out"),
    ("detector", "torch", "model train dataset -o out"),
    ("fbx", "cmeel", "export twin --to fbx -o out.fbx"),
    ("film", "imageio_ffmpeg", "traffic film motion -o out.mp4"),
    ("ray", "ray", "record twin motion --ray 127.0.0.1:9 -o out"),
    ("rerun", "rerun", "view dataset --rerun out.rrd"),
    ("tune", "optuna", "rig tune dataset twin -o out"),
    ("tune", "cmaes", "rig place twin motion -o out"),
    ("usd", "pxr", "export twin --to usd -o out.usdc"),
    ("warp", "warp", "record twin motion --backend warp -o out"),
]
MORE_COMMANDS = [
    ("bags", "mcap", "view drive.mcap --save out.html"),
    ("bags", "mcap", "export dataset --to mcap -o out.mcap"),
    ("bags", "velodyne_decoder", "view drive.bag --save out.html"),
    ("detector", "safetensors", "model detect dataset -o out"),
    ("detector", "torch", "model label model dataset -o out"),
]


Run = Callable[[Path, str], tuple[int, str, str]]


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """Run a command line in a folder: its code, output and errors."""
    missing = ",".join(module for modules in EXTRAS.values() for module in modules)
    with subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", WITHOUT, missing],
        env={**os.environ, "PATH": "/nonexistent"},  # no ffmpeg
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None

        def ran(folder: Path, arguments: str) -> tuple[int, str, str]:
            asked = [str(folder), [*arguments.split(), "-q"]]
            process.stdin.write(f"{json.dumps(asked)}\n")
            process.stdin.flush()
            code, out, err = json.loads(process.stdout.readline())
            return code, out, err

        yield ran
        process.stdin.close()


def is_refused(done: tuple[int, str, str], extra: str, module: str) -> None:
    code, out, err = done
    assert code == 2, err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert module.removeprefix("imageio_") in err
    assert f"pip install 'urbantwin[{extra}]'" in err
    assert out == ""


@pytest.fixture(scope="module")
def inputs(
    two_avenues_twin: "Twin",
    dataset: Path,
    motion_of: Callable[..., "Motion"],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """A folder with a twin, a motion on it, a dataset, and recordings that hold nothing."""
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "twin").symlink_to(two_avenues_twin.folder)
    (folder / "dataset").symlink_to(dataset)
    car = {"track": 1, "class": "car", "asset": "car-sedan", "x": 5.0}
    driven = motion_of(two_avenues_twin, [car])
    driven.manifest.update(kind="motion", version=MOTION_VERSION)
    driven.save(folder / "motion")
    for name in ("drive.bag", "drive.mcap"):
        (folder / name).touch()
    return folder


@pytest.mark.parametrize(("extra", "module", "command"), [*COMMANDS, *further(*MORE_COMMANDS)])
def test_a_command(run: Run, inputs: Path, extra: str, module: str, command: str) -> None:
    is_refused(run(inputs, command), extra, module)
    assert not list(inputs.glob("out*"))


def packed_mesh(packing: str) -> bytes:
    """A triangle in a GLB, packed by Draco or meshopt."""
    corners, faces = np.eye(3, dtype="<f4"), np.array([[0, 1, 2]], "<u4")
    gltf = Gltf()
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0}}
    if packing == "draco":
        gltf.add("accessors", {"componentType": 5126, "count": 3, "type": "VEC3"})
        view = gltf.view(DracoPy.encode(corners, faces))
        spec = {"bufferView": view, "attributes": {"POSITION": 0}}
        primitive["extensions"] = {"KHR_draco_mesh_compression": spec}
    else:
        view = gltf.view(bytes(meshopt.encode_gltf_buffer(corners, "ATTRIBUTES")))
        spec = gltf.document["bufferViews"][view]
        whole = {"byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}
        where = {key: spec[key] for key in ("buffer", "byteOffset", "byteLength")}
        spec["extensions"] = {"EXT_meshopt_compression": {**where, **whole}}
        accessor = {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}
        gltf.add("accessors", accessor)
    gltf.add("meshes", {"primitives": [primitive]})
    return gltf.scene({"mesh": 0}).glb()


@pytest.mark.parametrize(
    ("extra", "module", "name"),
    [
        ("e57", "pye57", "survey.e57"),
        *further(
            ("airborne", "pyogrio", "survey.laz"),
            ("fbx", "ufbx", "model.fbx"),
            ("gltf", "DracoPy", "draco.glb"),
            ("gltf", "meshopt", "meshopt.glb"),
        ),
    ],
)
def test_a_file_of_a_site(run: Run, tmp_path: Path, extra: str, module: str, name: str) -> None:
    example = Path(__file__).parents[1] / "examples" / "two-avenues"
    shutil.copytree(example, tmp_path, dirs_exist_ok=True)
    geometry = f"geometry:\n  - file: {name}\n    licence: CC0-1.0\n    attribution: nobody\n"
    if name.endswith(".glb"):
        (tmp_path / name).write_bytes(packed_mesh(name.removesuffix(".glb")))
    elif name.endswith(".laz"):
        cloud = laspy.create()
        east, north = Transformer.from_crs(4326, 32632, always_xy=True).transform(9.18, 48.7)
        cloud.x, cloud.y, cloud.z = east + np.arange(9.0), np.full(9, north), np.zeros(9)
        cloud.write(tmp_path / name)
        (tmp_path / "outlines.gpkg").write_bytes(b"SQLite format 3\0")
        geometry += "    footprints: outlines.gpkg\n    crs: EPSG:32632\n"
    else:
        (tmp_path / name).write_bytes(b"anything")
    site = tmp_path / "site.yaml"
    site.write_text(f"{site.read_text()}\n{geometry}")
    is_refused(run(tmp_path, "build site.yaml -o out"), extra, module)
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
def test_every_extra_is_refused_somewhere() -> None:
    refused = {extra for extra, _, _ in COMMANDS}
    refused |= {"airborne", "e57", "fbx", "gltf"}  # of files
    assert refused | {"carla"} == set(EXTRAS)
