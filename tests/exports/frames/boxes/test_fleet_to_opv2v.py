"""A fleet as OPV2V: an agent for each node, by OpenCOOD's rules as `test_to_opv2v` has them."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.traffic.motion import MOTION_VERSION

from .test_to_opv2v import MIRROR, agents_of, corners, pcd_to_np, x_to_world

SENSOR = {"model": "VLP-16", "columns": 900}
POLE = [{**SENSOR, "name": name, "east_m": 0.0, "north_m": north, "height_m": 3.0}
        for name, north in (("a", 0.0), ("b", -20.0))]  # fmt: skip
ROOF = {**SENSOR, "name": "r", "forward_m": 0.5, "left_m": 0.0, "above_roof_m": 0.4}
NODES = [
    {"name": "pole", "rig": {"sensors": POLE}},
    {"name": "lamp", "rig": {"sensors": [POLE[1]]}},
    {"name": "van", "rig": {"ride": {"track": 4}, "sensors": [ROOF]},
     "pose_error": {"bias": {"forward_m": 0.4, "left_m": 0.3, "yaw_deg": 2.0}}},
]  # fmt: skip


@pytest.fixture(scope="module")
def fleet(twin, motion, tmp_path_factory):
    """Frames 0 to 5; the van comes with frame 2."""
    base = tmp_path_factory.mktemp("fleet")
    manifest = {"kind": "motion", "version": MOTION_VERSION, **motion.manifest}
    replace(motion, manifest=manifest).save(base / "motion")
    (base / "nodes.yaml").write_text(yaml.safe_dump({"nodes": NODES}))
    return ut.record(twin.folder, base / "motion", base / "fleet", nodes=base / "nodes.yaml",
                     stop=0.5, workers=1, seed=5, split="100,0,0", pictures=False,
                     progress=False)  # fmt: skip


def test_scenarios_have_agents_that_are_there_all_the_time(fleet, tmp_path):
    made = ut.export(fleet, "opv2v", tmp_path / "out", progress=False)
    assert "agents: -1 pole, -2 lamp, 4 van" in made.notes
    assert any("clocks" in note for note in made.notes)
    scenarios = sorted((tmp_path / "out" / "train").iterdir())
    assert [agents_of(one) for one in scenarios] == [["-2", "-1"], ["-2", "4", "-1"]]
    found = []
    for scenario in scenarios:
        names = {
            agent: sorted(file.stem for file in (scenario / agent).glob("*.yaml"))
            for agent in agents_of(scenario)
        }
        first, *others = names.values()
        assert all(one == first for one in others)
        found += first
    assert found == list(fleet.names)


def test_agents_agree_in_the_world(fleet, tmp_path):
    out = ut.export(fleet, "opv2v", tmp_path / "out", progress=False).path
    of_two = 0
    for name in fleet.names[2:]:
        told, clouds = {}, []
        for file in out.glob(f"train/*/*/{name}.yaml"):
            agent = file.parent.name
            told[agent] = yaml.safe_load(file.read_text())
            cloud = pcd_to_np(file.with_suffix(".pcd"))
            world = x_to_world(told[agent]["lidar_pose"])
            clouds.append((cloud[:, :3] @ world[:3, :3].T + world[:3, 3]) @ MIRROR)
        assert set(told) == {"-1", "-2", "4"}
        assert len(np.concatenate(clouds)) == sum(
            len(one.points) for one in fleet.frame(name).nodes.values()
        )
        # The van is a vehicle of those that stand, under its agent's number, and not its own.
        assert 4 not in told["4"]["vehicles"]
        assert 4 in told["-1"]["vehicles"]
        mine = np.array(told["-1"]["vehicles"][4]["location"][:2])
        roof = np.array(told["4"]["lidar_pose"][:2])
        assert np.linalg.norm(roof - mine) < 1.5  # half a metre ahead, and a turn's way
        # Who is seen by two stands for both in one place: up to what it walks in a turn.
        for track in set(told["-1"]["pedestrians"]) & set(told["4"]["pedestrians"]):
            one, other = (
                corners({0: told[agent]["pedestrians"][track]}, [0] * 6)[0] for agent in ("-1", "4")
            )
            assert np.abs(one.mean(axis=0) - other.mean(axis=0)).max() < 0.15
            of_two += 1
        true, believed = (x_to_world(told["4"][key]) for key in
                          ("true_ego_pos", "predicted_ego_pos"))  # fmt: skip
        assert told["4"]["lidar_pose"] == told["4"]["true_ego_pos"]
        # The bias is of the carrier: half a metre behind the sensor, to which it turns.
        turn = np.radians(2.0)
        ahead = 0.4 + 0.5 * np.cos(turn) - 0.5
        left = 0.3 + 0.5 * np.sin(turn)
        wrong = np.linalg.inv(true) @ believed
        np.testing.assert_allclose(wrong[:3, 3], [ahead, -left, 0.0], atol=1e-6)
        assert np.degrees(np.arctan2(wrong[1, 0], wrong[0, 0])) == pytest.approx(-2.0)
        for agent in ("-1", "-2"):
            assert told[agent]["predicted_ego_pos"] == pytest.approx(told[agent]["lidar_pose"])
    assert of_two > 0


def test_formats_of_one_ego_name_the_nodes(fleet, tmp_path, capsys):
    for to, words in (("kitti", "one of its nodes (pole, lamp, van), or --to opv2v"),
                      ("carla", "expected of a fleet one of opv2v")):  # fmt: skip
        command = ["export", str(fleet.folder), "--to", to, "-o", str(tmp_path / "out")]
        assert main(command) == 2
        told = capsys.readouterr().err
        assert words in told
        assert told.count("\n") == 1
    node = ["export", str(fleet.folder / "van"), "--to", "pcd", "-o", str(tmp_path / "pcd")]
    assert main(node) == 0
