"""From real frames to a twin that sees what it lacks, as a person does it, and the same bytes."""

import json

import numpy as np
import pytest

from urbantwin.artefact import sha256_of, write_json
from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.fidelity.background_estimation import measure_recording
from urbantwin.fidelity.beam_assignment import beams_of_rig
from urbantwin.lidar import place_rig
from urbantwin.lidar.background_file import load_backgrounds, rig_with_backgrounds
from urbantwin.roads import RoadNetwork
from urbantwin.taxonomy import semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.motion import MOTION_VERSION
from urbantwin.twin import load_twin


@pytest.fixture(scope="module")
def bare(twin, tmp_path_factory):
    """The street without its wall."""
    folder = tmp_path_factory.mktemp("bare") / "twin"
    folder.mkdir()
    mesh = twin.mesh.select(twin.mesh.semantic == semantic_id("road"))
    mesh.save(folder / "scene.npz")
    RoadNetwork("right", (), (), (), (), ()).save(folder / "roads.json")
    manifest = json.loads((twin.folder / "twin.json").read_text())
    files = ("scene.npz", "roads.json")
    manifest["files"] = {name: sha256_of(folder / name) for name in files}
    write_json(folder / "twin.json", manifest)
    return load_twin(folder)


@pytest.fixture(scope="module")
def driven(bare, motion):
    """The same motion on it."""
    kind = {"kind": "motion", "version": MOTION_VERSION, "twin_sha256": bare.sha256}
    manifest = {**motion.manifest, **kind}
    return Motion(manifest, motion.actors, motion.signals)


@pytest.fixture(scope="module")
def folder(bare, driven, rig_spec, tmp_path_factory):
    """A folder with the motion and the rig as files."""
    folder = tmp_path_factory.mktemp("given")
    driven.save(folder / "motion")
    write_json(folder / "rig.yaml", rig_spec().written())  # JSON is YAML.
    return folder


def told(capsys, *arguments):
    capsys.readouterr()
    code = main([str(one) for one in (*arguments, "--json")])
    found = capsys.readouterr()
    assert code == 0, found.err
    return json.loads(found.out)


@pytest.mark.thorough
def test_a_twin_records_what_it_lacks_and_is_near(dataset, bare, folder, tmp_path, capsys):
    measured = tmp_path / "measured.npz"
    place = ("--twin", bare.folder, "--rig", folder / "rig.yaml")
    summary = told(capsys, "rig", "background", dataset, *place, "-o", measured)
    assert summary["sensors"][0]["name"] == "pole"
    common = (bare.folder, folder / "motion", "--rig", folder / "rig.yaml", "--no-pictures")
    common += ("--workers", 1, "--seed", 6, "--stop", 0.2)
    for name, more in (
        ("plain", ()),
        ("background", ("--background", measured)),
        ("fused", ("--background", f"pole={measured}", "--fuse")),
    ):
        told(capsys, "record", *common, *more, "-o", tmp_path / name)
        frames = [np.load(path) for path in sorted((tmp_path / name / "points").glob("*.npy"))]
        # The wall stands 20 m off, and nothing of the bare street is higher than the ground.
        away = [one[np.linalg.norm(one[:, :2], axis=1) > 15] for one in frames[:2]]
        assert any((one[:, 2] > -2.5).any() for one in away) == (name != "plain")
    pair = (dataset, tmp_path / "background", "-o", tmp_path / "report")
    told(capsys, "compare", *pair, "--arbitrary", "none", "--workers", 1)
    said = json.loads((tmp_path / "report/report.json").read_text())
    found = said["parts"]["background"]
    assert found["aggregate"]["hausdorff_p95_m"]["mean"] < 0.2
    assert found["anchors"]["ratio_to_real"]["hausdorff_p95_m"] < 2


@pytest.mark.thorough
def test_the_same_bytes_with_workers_and_after_an_interruption(
    dataset, bare, driven, rig_spec, digests, tmp_path
):
    rig = place_rig(rig_spec(), bare.mesh)
    measure_recording(dataset, beams_of_rig(rig), tmp_path / "measured.npz")
    measure_recording(dataset, beams_of_rig(rig), tmp_path / "again.npz")
    assert sha256_of(tmp_path / "measured.npz") == sha256_of(tmp_path / "again.npz")
    (one,) = load_backgrounds(tmp_path / "measured.npz")
    assert ((one.share > 0).sum(axis=0) > 1).any(), "chance chooses nothing"
    rig = rig_with_backgrounds(rig, [str(tmp_path / "measured.npz")])
    record(bare, driven, rig, tmp_path / "one", workers=1, seed=5)

    def stop(_fraction, doing):
        if doing.startswith("frame 5 "):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(bare, driven, rig, tmp_path / "two", workers=1, seed=5, progress=stop)
    record(bare, driven, rig, tmp_path / "two", workers=2, seed=5)
    assert digests(tmp_path / "one") == digests(tmp_path / "two")
    manifest = json.loads((tmp_path / "one/dataset.json").read_text())
    assert manifest["rig"]["sensors"][0]["measured"] == {"sha256": one.sha256, "fused": False}
