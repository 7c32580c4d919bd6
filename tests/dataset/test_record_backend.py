"""Recording with every ray tracer."""

import json
from dataclasses import replace

import numpy as np
import pytest

from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.errors import InputError
from urbantwin.traffic.motion import MOTION_VERSION

from ..thorough import further

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("backend", ["warp:cpu", *further("bvh")])
def test_a_backend_records_what_embree_does(backend, twin, motion, rig, digests, tmp_path):
    """The same frames to the millimetre, and the same bytes for any number of workers.

    A ray in ten thousand may lie where the last digits of its range decide whether it returns.
    """
    if backend == "warp:cpu":
        pytest.importorskip("warp", reason="the extra 'warp' is not installed")
    for workers in (1, 2):
        out = tmp_path / str(workers)
        record(twin, motion, rig, out, seed=3, stop_s=0.2, workers=workers, backend=backend)
    assert digests(tmp_path / "1") == digests(tmp_path / "2")
    record(twin, motion, rig, tmp_path / "embree", seed=3, stop_s=0.2, workers=1, backend="embree")
    made = json.loads((tmp_path / "1" / "dataset.json").read_text())
    assert made["backend"] == backend
    assert ("warp-lang" in made["dependencies"]) == (backend == "warp:cpu")
    usual = json.loads((tmp_path / "embree" / "dataset.json").read_text())
    assert usual["backend"] == "embree"
    assert "warp-lang" not in usual["dependencies"]
    for frame in usual["frames"]:
        sides = []
        for folder in ("embree", "1"):
            at = tmp_path / folder
            rays = np.load(at / "rays" / f"{frame['name']}.npy")
            points = np.load(at / "points" / f"{frame['name']}.npy")
            beam = zip(*(rays[key].tolist() for key in ("sensor", "ring", "column")), strict=True)
            sides.append(dict(zip(beam, points[:, :3], strict=True)))
        ours, other = sides
        both = ours.keys() & other.keys()
        assert len(both) > max(100, 0.9995 * max(len(ours), len(other)))
        apart = np.array([np.linalg.norm(ours[beam] - other[beam]) for beam in both])
        assert np.mean(apart <= 1e-3) > 0.999


def test_a_backend_that_is_not_here_is_refused_before_any_work(twin, motion, rig, tmp_path):
    with pytest.raises(InputError, match="there is no backend 'optix'; expected embree, bvh, warp"):
        record(twin, motion, rig, tmp_path / "out", backend="optix")
    assert not list(tmp_path.iterdir())


def test_the_command_says_it_in_one_line(twin, motion, tmp_path, capsys):
    manifest = {"kind": "motion", "version": MOTION_VERSION, **motion.manifest}
    replace(motion, manifest=manifest).save(tmp_path / "motion")
    one = {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 3.0}
    file = tmp_path / "rig.yaml"
    file.write_text(json.dumps({"sensors": [one]}))  # JSON is YAML.
    arguments = ["record", twin.folder, tmp_path / "motion", "--rig", file, "-q", "--seed", "1"]
    arguments += ["-o", tmp_path / "out"]
    code = main([str(one) for one in [*arguments, "--backend", "optix"]])
    assert code == 2
    said = capsys.readouterr().err
    assert "there is no backend 'optix'" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
