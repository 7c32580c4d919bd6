"""A config of OpenPCDet: anchors are medians of the labels, and strides divide the range."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.errors import InputError

from ..box_tables import write_table


def dataset(folder: Path, count: int) -> dict[str, np.ndarray]:
    """Boxes of cars and people, and a few buses."""
    draw = np.random.default_rng(6)
    folder.mkdir()
    names = np.array(["car"] * count + ["pedestrian"] * count + ["bus"] * 3)
    rows = {name: draw.uniform(-40, 40, len(names)) for name in ("x", "y")}
    rows |= {name: draw.uniform(0.5, 4.5, len(names)) for name in ("length", "width", "height")}
    rows["z"] = draw.normal(-4, 0.1, len(names)) + rows["height"] / 2
    # Every fifth frame is for validation: what is there must not shape the config.
    rows["frame"] = np.array([f"{k % 10:06d}" for k in range(len(names))])
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets" / "train.txt").write_text("".join(f"{k:06d}\n" for k in range(8)))
    rows["num_points"] = draw.integers(0, 50, len(names))
    columns = {"class": names, **rows}
    values = zip(*(one.tolist() for one in columns.values()), strict=True)
    write_table(folder / "boxes.parquet", [dict(zip(columns, row, strict=True)) for row in values])
    return {"class": names, **rows}


def test_anchors_are_medians_and_strides_divide_the_range(tmp_path: Path) -> None:
    rows = dataset(tmp_path / "data", 200)
    told = ut.export(tmp_path / "data", "openpcdet", tmp_path / "pp.yaml", progress=False)
    assert any("boxes of bus" in note for note in told.notes)
    config = yaml.safe_load((tmp_path / "pp.yaml").read_text())
    assert config["CLASS_NAMES"] == ["car", "pedestrian"]
    anchors = config["MODEL"]["DENSE_HEAD"]["ANCHOR_GENERATOR_CONFIG"]
    for anchor in anchors:
        mine = (rows["class"] == anchor["class_name"]) & (rows["num_points"] >= 5)
        mine &= rows["frame"] < "000008"
        size = [np.median(rows[one][mine]) for one in ("length", "width", "height")]
        assert anchor["anchor_sizes"][0] == pytest.approx(size, abs=0.006)
        bottom = np.median((rows["z"] - rows["height"] / 2)[mine])
        assert anchor["anchor_bottom_heights"] == pytest.approx([bottom], abs=0.006)
    data = config["DATA_CONFIG"]
    known = {"car": "Car", "pedestrian": "Pedestrian", "bus": "DontCare", "DontCare": "DontCare"}
    assert data["MAP_CLASS_TO_KITTI"] == known
    reach = np.array(data["POINT_CLOUD_RANGE"])
    edge = data["DATA_PROCESSOR"][-1]["VOXEL_SIZE"]
    cells = (reach[3:] - reach[:3]) / edge
    assert cells == pytest.approx(cells.round(), abs=1e-6)
    assert cells[:2].round().astype(int).tolist() == [int(cells[0].round())] * 2
    assert int(cells[0].round()) % 16 == 0
    assert cells[2] == pytest.approx(1)
    inside = [(np.abs(rows[one]) <= reach[3]).mean() for one in ("x", "y")]
    assert min(inside) >= 0.98


def test_too_few_boxes_and_no_dataset_are_refused(tmp_path: Path) -> None:
    dataset(tmp_path / "data", 4)
    with pytest.raises(InputError, match="no class with 10 boxes"):
        ut.export(tmp_path / "data", "openpcdet", tmp_path / "pp.yaml", progress=False)
    with pytest.raises(InputError):
        ut.export(tmp_path / "none", "openpcdet", tmp_path / "pp.yaml", progress=False)
    assert not (tmp_path / "pp.yaml").exists()
