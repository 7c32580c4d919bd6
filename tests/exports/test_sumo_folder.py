"""The SUMO folder, run by SUMO as it is."""

import re
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from lxml import etree

from urbantwin.drawing.footprint import footprints
from urbantwin.exports import export_twin
from urbantwin.roads.netconvert import sumo_binary, sumo_environment, sumo_home
from urbantwin.traffic.assets import asset
from urbantwin.traffic.sumo.simulation import simulate

from ..thorough import further


def sumo(folder, *options):
    return subprocess.run(
        [sumo_binary("sumo"), "-c", "twin.sumocfg", *options],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=sumo_environment(),
    )


@pytest.fixture(scope="module", params=["two_avenues_twin", *further("perth_twin")])
def exported(request, tmp_path_factory):
    twin = request.getfixturevalue(request.param)
    folder = tmp_path_factory.mktemp("sumo") / "run"
    export_twin(twin, "sumo", folder)
    return twin, folder


def test_sumo_runs_the_folder_to_its_end_without_a_complaint_of_it(exported, tmp_path):
    _, folder = exported
    done = sumo(folder, "--statistic-output", str(tmp_path / "statistics.xml"))
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    # What SUMO tells of people who squeeze past each other is no complaint of a file.
    told = [line for line in done.stderr.splitlines() if line.startswith("Warning")]
    behaviour = r"Warning: (Person '\d+' is jammed|Collision of person|Vehicle '\d+')"
    assert [line for line in told if not re.match(behaviour, line)] == []
    statistics = ElementTree.parse(tmp_path / "statistics.xml").getroot()
    assert statistics.find("teleports").get("total") == "0"
    assert int(statistics.find("vehicles").get("inserted")) > 10
    assert int(statistics.find("persons").get("loaded")) > 3


def test_the_run_is_the_twin_s_own_traffic(exported, planned_once, tmp_path):
    twin, folder = exported
    asked = twin.site["traffic"]
    steps = 20
    demand = planned_once(twin, duration_s=asked["duration_s"], seed=asked["seed"])
    simulated = simulate(
        twin.net_path,
        demand,
        asset,
        warmup_s=asked["warmup_s"],
        steps=steps,
        step_s=asked["step_s"],
        seed=asked["seed"],
    )
    command = [sys.executable, folder / "drive.py", "--fcd-output", tmp_path / "fcd.xml"]
    assert subprocess.run(command, cwd=tmp_path, check=False, capture_output=True).returncode == 0
    seen = {}
    for moment in ElementTree.parse(tmp_path / "fcd.xml").getroot():
        for actor in moment:
            key = round(float(moment.get("time")), 3), actor.get("id")
            seen[key] = float(actor.get("x")), float(actor.get("y"))
    chosen = (simulated.step >= 0) & (simulated.step < steps)
    assert chosen.sum() > 50
    times = asked["warmup_s"] + simulated.step[chosen] * asked["step_s"]
    trips = simulated.trip[chosen]
    there = [seen[round(float(t), 3), str(k)] for t, k in zip(times, trips, strict=True)]
    assert np.abs(np.array(there) - simulated.front[chosen]).max() < 0.011  # two decimals


def test_files_keep_to_sumo_s_schemas(exported):
    _, folder = exported
    for name, schema in (
        ("twin.sumocfg", "sumoConfiguration"),
        ("demand.rou.xml", "routes_file"),
        ("types.add.xml", "additional_file"),
        ("buildings.add.xml", "additional_file"),
        ("view.settings.xml", "viewsettings_file"),
    ):
        rules = etree.XMLSchema(etree.parse(sumo_home() / "data" / "xsd" / f"{schema}.xsd"))
        rules.assertValid(etree.parse(folder / name))


def test_nothing_in_the_folder_names_another_folder(exported):
    _, folder = exported
    for path in folder.iterdir():
        assert str(folder.parent) not in path.read_text()
    for entry in etree.parse(folder / "twin.sumocfg").find("input"):
        assert all((folder / name).is_file() for name in entry.get("value").split(","))


def test_buildings_are_where_the_mesh_has_them(two_avenues_twin):
    mesh = two_avenues_twin.mesh
    for part, footprint in footprints(mesh, "building").items():
        one = mesh.select(mesh.part == part)
        points = shapely.points(one.vertices[:, :2])
        assert shapely.distance(footprint, points).max() < 1.0  # eaves and walls
        assert footprint.area > 5.0
