"""A study of fusion from the command line: it runs, goes on, and refuses what is wrong."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main

from ..reliability.small_site import bytes_of
from ..whole_page import whole_page
from .conftest import Line

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.learn.model import Design, Model, new_network, write_model  # noqa: E402
from urbantwin.studies.fusion import open_nodes  # noqa: E402

SENSOR = {"model": "VLP-16", "columns": 900, "height_m": 4.0}
PLACES = {"corner": (12, -12, 135), "gate": (-12, 12, -45), "yard": (-12, -12, 45)}
FEW = {"frames": 2, "studies": ["nodes", "failure"], "progress": False}


@pytest.fixture(scope="module")
def fleet(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three poles that look at one motion for 1.5 s."""
    folder = tmp_path_factory.mktemp("fusion")
    rigs = []
    for name, (east, north, yaw) in PLACES.items():
        sensor = {"name": name, "east_m": east, "north_m": north, "yaw_deg": yaw, **SENSOR}
        rigs.append({"name": name, "rig": {"rate_hz": 5, "frame": "level", "sensors": [sensor]}})
    nodes = folder / "nodes.yaml"
    nodes.write_text(yaml.safe_dump({"rate_hz": 5, "nodes": rigs}))
    ut.record(line.twin, line.motion, folder / "fleet", nodes=nodes, stop=1.4, workers=1,
              pictures=False, progress=False)  # fmt: skip
    return folder / "fleet"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A detector that nobody trained: it says something everywhere."""
    torch.manual_seed(1)
    design = Design(("car", "pedestrian"), range_m=32.0, cell_m=0.8, width=0.25)
    network = new_network(design).eval()
    for head in network.heads:
        head[-1].weight.data *= 30  # type: ignore[index, union-attr]
        head[-1].bias.data[0] = -1.5  # type: ignore[index, union-attr]
    folder = tmp_path_factory.mktemp("models") / "model"
    folder.mkdir()
    write_model(folder, Model(design, network, {}))
    return folder


@pytest.fixture(scope="module")
def study(
    fleet: Path, model: Path, tmp_path_factory: pytest.TempPathFactory
) -> ut.model.FusionStudy:
    return ut.model.fuse(model, fleet, tmp_path_factory.mktemp("study") / "fusion", **FEW)  # type: ignore[arg-type]


def test_a_fleet_and_its_datasets_are_the_same_nodes(fleet: Path) -> None:
    together = open_nodes([fleet])
    apart = open_nodes([fleet / name for name in PLACES])
    with pytest.raises(ut.InputError, match="gate: is given twice"):
        open_nodes([fleet / "gate", fleet / "gate"])
    assert [one.name for one in together.nodes] == [one.name for one in apart.nodes] == [*PLACES]
    for moment in (0, 5):
        a, b = together.labelled(moment), apart.labelled(moment)
        seen = dict(zip(a.track.tolist(), a.num_points.tolist(), strict=True))
        assert {k for k, n in seen.items() if n} <= set(b.track.tolist())
        for track, points, box in zip(b.track.tolist(), b.num_points, b.box, strict=True):
            assert seen[track] == points
            own = a.box[a.track == track][0]
            # A node's beams meet an actor later by up to a turn, 0.2 s, at up to 14 m/s.
            assert np.hypot(*(own[:2] - box[:2])) < 2.8
            assert np.allclose(own[3:6], box[3:6], atol=0.2)
        frames = [one.frame(moment) for one in (together.nodes[1], apart.nodes[1])]
        assert (frames[0].points == frames[1].points).all()
        poses = [one.nodes[1].looks[moment].reported for one in (together, apart)]
        assert np.allclose(poses[0].translation, poses[1].translation)


@pytest.mark.thorough
def test_the_study_holds_what_it_tells(study: ut.model.FusionStudy) -> None:
    rows = study.settings.to_pylist()
    assert {row["study"] for row in rows} == {"nodes", "failure"}
    assert len({row["objects"] for row in rows}) == 1
    by_way = {way: next(row for row in rows if row["way"] == way and row["study"] == "nodes")
              for way in ("alone", "early", "middle", "late")}  # fmt: skip
    assert by_way["alone"]["kbit_s"] == 0
    assert 0 < by_way["late"]["kbit_s"] < by_way["early"]["kbit_s"]
    for row in rows:
        assert row["kbit_s"] == pytest.approx(5 * row["kbit_frame"])
        assert 0 <= row["map"] <= 100
        assert row["map_low"] <= row["map_high"]
    dead = [row for row in rows if row["silent_from_s"] is not None]
    alive = [row for row in rows if row["study"] == "failure" and row["silent_from_s"] is None]
    assert len(dead) == 3
    assert len(alive) == 4
    assert study.over_time is not None
    assert sum(row["frames"] for row in study.over_time.to_pylist()) == 7 * 2
    page = (study.folder / "fusion.html").read_text()
    assert study.manifest["in_short"] in whole_page(page).texts
    assert str(study.folder.parent) not in page
    assert isinstance(ut.open(study.folder), ut.model.FusionStudy)
    told = pq.read_table(study.folder / "settings.parquet")
    assert told.num_rows == len((study.folder / "settings.csv").read_text().splitlines()) - 1


@pytest.mark.thorough
def test_interrupted_it_goes_on_and_the_command_writes_the_same(
    study: ut.model.FusionStudy, fleet: Path, model: Path, tmp_path: Path
) -> None:
    out = tmp_path / "fusion"
    seen: list[str] = []

    def stop(share: float, doing: str) -> None:
        seen.append(doing)
        if doing == "moment 1 of 2":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ut.model.fuse(model, fleet, out, **(FEW | {"progress": stop}))  # type: ignore[arg-type]
    assert not out.exists()
    arguments = ["model", "fuse", model, fleet, "-o", out, "--frames", 2, "--study", "nodes"]
    assert main([*map(str, arguments), "--study", "failure", "--quiet"]) == 0
    assert bytes_of(out) == bytes_of(study.folder)
    assert [one.name for one in tmp_path.iterdir()] == ["fusion"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (lambda fleet: [fleet, "--ego", "bus"], "--ego: no node 'bus'; expected one of corner, ga"),
        (lambda fleet: [fleet, "--node", "bus"], "--node: no node 'bus'; expected one of corner"),
        (lambda fleet: [fleet, "--node", "gate"], "has 1 node"),
        (lambda fleet: [fleet, "--study", "wind"], "--study: unknown study 'wind'; expected bitr"),
        (
            lambda fleet: [fleet, "--within", "40"],
            "--within: 40 m is beyond the model's range; exp",
        ),
        (lambda fleet: [fleet / "corner"], "has 1 node (corner)"),
        (lambda fleet: [fleet.parent], "is no dataset of ours"),
        (lambda fleet: [fleet, "--mtu", "100"], "--mtu"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(
    fleet: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    more: Callable[[Path], list[Any]], said: str,
) -> None:  # fmt: skip
    out = tmp_path / "out"
    assert main(["model", "fuse", str(model), *map(str, more(fleet)), "-o", str(out)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert said in told.err
    assert not out.exists()


def test_a_plan_writes_nothing(fleet: Path, model: Path, tmp_path: Path) -> None:
    made = ut.model.fuse(model, fleet, tmp_path / "out", plan=True, progress=False)
    assert made.seconds is not None
    assert made.seconds > 0
    assert made.summary()["minutes"] >= 0
    assert not list(tmp_path.iterdir())
