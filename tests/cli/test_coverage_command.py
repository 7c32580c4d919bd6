"""The map of what a rig covers, from the command line."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image

from ..thorough import further


@pytest.fixture
def twin(two_avenues_twin):
    return two_avenues_twin.folder


def test_a_folder_with_map_numbers_and_picture(twin, run_here, tmp_path):
    rig = yaml.safe_load((twin / "rig.yaml").read_text())
    for sensor in rig["sensors"]:
        sensor |= {"model": "OS1-32", "columns": 512}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    out = tmp_path / "coverage"
    asked = ("rig", "coverage", twin, "--rig", tmp_path / "rig.yaml", "-o", out, "--cell", "4")
    done = run_here(*asked, "--json")
    assert done.code == 0, done.err
    said = json.loads(done.out)
    written = json.loads((out / "coverage.json").read_text())
    told = [": ".join([row["about"], row["problem"], row["reason"]]) for row in written["warnings"]]
    assert len(said["warnings"]) == len(told)
    assert all(line.startswith(row) for line, row in zip(said["warnings"], told, strict=True))
    written["warnings"] = said["warnings"]
    assert said == {"path": str(out), **written}
    with np.load(out / "coverage.npz") as data:
        facing = data["facing"].sum(axis=0) / data["rate_hz"]
        assert data["semantic"].shape == facing.shape
    assert said["facing"]["most"] == pytest.approx(facing.max(), abs=0.06)
    told = json.loads(run_here("info", out, "--json").out)
    assert told == said
    with Image.open(out / "coverage.png") as image:
        picture = np.asarray(image.convert("RGB"), float)
    colourful = picture.max(axis=2) - picture.min(axis=2) > 60
    thirds = np.array_split(colourful, 3, axis=1)
    assert all(third.mean() > 0.01 for third in thirds)
    # Somebody's own folder is never replaced.
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "file").write_text("x")
    assert run_here("rig", "coverage", twin, "-o", tmp_path / "mine").code == 2


@pytest.mark.parametrize("cell", ["0", "nan", "0.00001", *further("-1", "inf")])
def test_a_cell_that_is_none_is_a_clear_line(twin, run_here, tmp_path, cell):
    done = run_here("rig", "coverage", twin, "-o", tmp_path / "out", f"--cell={cell}")
    assert done.code == 2
    assert done.err.startswith("error: cell:")
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_rig_that_rides_has_no_map(twin, run_here, tmp_path):
    sensor = "{name: roof, model: VLP-16, forward_m: 0, left_m: 0, above_roof_m: 0.3}"
    (tmp_path / "rig.yaml").write_text(f"ride: {{class: car}}\nsensors: [{sensor}]\n")
    done = run_here("rig", "coverage", twin, "--rig", tmp_path / "rig.yaml", "-o", tmp_path / "out")
    assert done.code == 2
    assert "covers no fixed place" in done.err
    assert done.err.count("\n") == 1
