"""The second look: what it is told, what it learns, and what becomes of scores."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import urbantwin as ut

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.learn import (  # noqa: E402
    Design,
    LabelledFrames,
    Model,
    Recipe,
    labelled_frames,
    read_model,
    write_model,
)
from urbantwin.learn.augmentation.placement import Placement  # noqa: E402
from urbantwin.learn.decoding import Found  # noqa: E402
from urbantwin.learn.frames import IGNORED  # noqa: E402
from urbantwin.learn.grid import Grid  # noqa: E402
from urbantwin.learn.model import new_network  # noqa: E402
from urbantwin.learn.network import Detector  # noqa: E402
from urbantwin.learn.onnx_file import write_onnx  # noqa: E402
from urbantwin.learn.second_look import (  # noqa: E402
    Crops,
    SecondLook,
    crops_of,
    looked_again,
    second_look_trained,
)
from urbantwin.learn.second_look.crop import CROP_POINTS, TOLD  # noqa: E402
from urbantwin.learn.second_look.proposals import judged_proposals, proposals_of  # noqa: E402
from urbantwin.progress import untold  # noqa: E402

pytestmark = pytest.mark.xdist_group("learn")

NAMES = ("car", "pedestrian")
SENSOR = np.array([[0.0, 0.0, 2.0]])


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Other tests run beside."""
    torch.set_num_threads(1)


def found_at(*rows: tuple[float, float, int, float]) -> Found:
    """Boxes of people's size: x, y, class, score."""
    table = np.array(rows)
    box = np.tile([0, 0, 0.9, 0.7, 0.7, 1.8, 0.0], (len(rows), 1))
    box[:, :2] = table[:, :2]
    return Found(box, table[:, 2].astype(np.int64), table[:, 3])


def column(
    x: float, y: float, high: float, wide: float, draw: np.random.Generator, count: int = 60
) -> NDArray[np.float32]:
    """Points of something that stands up, and of the ground about it."""
    at = draw.uniform((-wide / 2, -wide / 2, 0), (wide / 2, wide / 2, high), (count, 3))
    ground = draw.uniform((-2, -2, -0.02), (2, 2, 0.02), (80, 3))
    return (np.concatenate([at, ground]) + (x, y, 0)).astype(np.float32)


def test_a_crop_has_the_points_about_a_box_as_the_nearest_sensor_sees_them() -> None:
    draw = np.random.default_rng(1)
    points = draw.uniform((-20, -20, -1), (20, 20, 5), (9000, 3)).astype(np.float32)
    sensors = np.array([[0.0, 0, 2], [15.0, 12, 5]])
    found = found_at((12, 9, 1, 0.5), (-7, 3, 1, 0.2), (60, 0, 1, 0.1))
    crops = crops_of(points, sensors, found)
    assert crops.points.shape == (3, CROP_POINTS, 3)
    assert not crops.points[2].any()  # nothing is there
    for k, sensor in enumerate((sensors[1], sensors[0])):
        away = points[:, :2] - found.box[k, :2]
        near = (np.hypot(*away.T) < 1.6) & (points[:, 2] > -0.6) & (points[:, 2] < 4)
        ray = found.box[k, :2] - sensor[:2]
        ray /= np.linalg.norm(ray)
        along = away[near] @ ray
        across = ray[0] * away[near, 1] - ray[1] * away[near, 0]
        wanted = np.column_stack([along, across, points[near, 2]])
        apart = np.abs(crops.points[k][:, None] - wanted).max(axis=2)
        assert apart.min(axis=1).max() < 1e-4  # each is one of them,
        if near.sum() <= CROP_POINTS:
            assert apart.min(axis=0).max() < 1e-4  # and all are there
        assert np.expm1(crops.told[k, 0] * 6) == pytest.approx(near.sum(), rel=1e-4)
        assert crops.told[k, 1] * 40 == pytest.approx(np.hypot(*(found.box[k, :2] - sensor[:2])))
    turned = Placement(yaw=1.1)
    box = turned.boxes(found.box)
    sensors[:, :2] = sensors[:, :2] @ turned.matrix.T
    again = crops_of(turned.points(points), sensors, Found(box, found.number, found.score))
    np.testing.assert_allclose(again.points, crops.points, atol=1e-4)
    np.testing.assert_allclose(again.told, crops.told, atol=1e-5)


def test_what_is_found_is_right_or_wrong_or_does_not_count() -> None:
    grid = Grid.around(0, 0, 12.8, 0.4)
    labelled = found_at((0, 0, 1, 1), (5, 5, 1, 1), (-8, 0, 0, 1)).box
    number = np.array([1, IGNORED, 1])
    found = found_at(
        (0.9, 0, 1, 0.9),  # right, though another is nearer: it is likelier
        (0.1, 0, 1, 0.8),  # the same person again
        (1.2, 0, 1, 0.7),  # too far from him
        (5.5, 5.5, 1, 0.6),  # at somebody who does not count
        (0, 0, 0, 0.5),  # another class
        (-8, 0.5, 1, 0.4),  # right, but where labels do not count
        (14, 0, 1, 0.3),  # outside of the window
    )
    everywhere = np.ones((1, 1), bool)
    right, counts = judged_proposals(found, labelled, number, grid, everywhere)
    assert right.tolist() == [True, False, False, False, False, True, False]
    assert counts.tolist() == [True, False, True, False, True, True, False]
    counted = np.ones((grid.cells, grid.cells), bool)
    counted[:, : grid.cells // 4] = False
    right, counts = judged_proposals(found, labelled, number, grid, counted)
    assert right.tolist() == [True, False, False, False, False, False, False]
    assert counts.tolist() == [True, False, True, False, True, False, False]


def written_proposals(file: Path, seed: int) -> tuple[Crops, NDArray[np.bool_]]:
    """People are 1.5 to 1.9 m high, what they are taken for 0.8 to 1.2 m; a detector is blind."""
    draw = np.random.default_rng(seed)
    right = np.arange(240) % 3 == 0
    crops = []
    for one in right:
        x, y = draw.uniform(5, 20, 2)
        high = draw.uniform(1.5, 1.9) if one else draw.uniform(0.8, 1.2)
        found = found_at((x, y, 1, draw.uniform(0.2, 0.6)))
        crops.append(crops_of(column(x, y, high, 0.5, draw), SENSOR, found))
    joined = Crops.joined(crops)
    with file.open("wb") as out:
        np.savez(out, right=right, **{one.name: getattr(joined, one.name) for one in fields(Crops)})
    return joined, right


class Nothing(LabelledFrames):
    """Frames that nobody may ask for."""


@pytest.mark.thorough
def test_it_tells_people_from_what_is_lower_and_goes_on_where_it_was(tmp_path: Path) -> None:
    design = Design(NAMES, 12.0)
    network, frames = new_network(design).eval(), Nothing(tmp_path, (), (), {})
    recipe = Recipe(batch=1, window_m=19.2, seed=3, kept_every_s=0)

    def learned(folder: Path, tell: object = untold) -> SecondLook | None:
        folder.mkdir(exist_ok=True)
        if not (folder / "proposals.npz").is_file():
            written_proposals(folder / "proposals.npz", 1)
        return second_look_trained(network, frames, design, recipe, 24, folder, tell)  # type: ignore[arg-type]

    look = learned(tmp_path / "whole")
    assert look is not None
    crops, right = written_proposals(tmp_path / "others.npz", 2)
    with torch.inference_mode():
        said = look(*(torch.from_numpy(getattr(crops, one.name)) for one in fields(Crops))).numpy()
    assert said[right].min() > said[~right].max()

    def interrupts(share: float, doing: str) -> None:
        if doing.startswith("step 17 "):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learned(tmp_path / "parts", interrupts)
    parts = learned(tmp_path / "parts")
    assert parts is not None
    for name, one in look.state_dict().items():
        assert torch.equal(one, parts.state_dict()[name]), name


def test_scores_of_people_alone_change_and_the_likeliest_is_first(tmp_path: Path) -> None:
    torch.manual_seed(1)
    look = SecondLook(2).eval()
    draw = np.random.default_rng(4)
    points = np.concatenate([column(x, 5, 1.8, 0.5, draw) for x in range(0, 20, 5)])
    found = found_at((0, 5, 1, 0.8), (5, 5, 0, 0.7), (10, 5, 1, 0.6), (15, 5, 1, 0.3))
    again = looked_again(look, found, points, SENSOR, NAMES, "cpu")
    assert sorted(again.score, reverse=True) == again.score.tolist()
    order = [int(np.flatnonzero(found.box[:, 0] == one)[0]) for one in again.box[:, 0]]
    assert np.array_equal(again.number, found.number[order])
    crops = crops_of(points, SENSOR, found)
    given = {one.name: torch.from_numpy(getattr(crops, one.name)) for one in fields(Crops)}
    with torch.inference_mode():
        odds = np.exp(look(**given).double().numpy())
    wanted = np.sqrt(found.score * odds / (1 + odds))
    wanted[1] = 0.7  # a car
    np.testing.assert_allclose(again.score, wanted[order], rtol=1e-5)
    nobody = found.only(np.zeros(0, np.int64))
    assert not len(looked_again(look, nobody, points, SENSOR, NAMES, "cpu").box)

    onnxruntime = pytest.importorskip("onnxruntime", reason="needs onnxruntime")
    write_onnx(tmp_path, Model(Design(NAMES, 12.0), new_network(Design(NAMES, 12.0)), {}, look))
    session = onnxruntime.InferenceSession(tmp_path / "second_look.onnx")
    said = session.run(None, {name: one.numpy() for name, one in given.items()})[0]
    assert np.abs(said - np.log(odds)).max() < 1e-4


def guessing(design: Design) -> Detector:
    """A network that has learned nothing and is sure of much."""
    network = new_network(design).eval()
    last = network.heads[0].get_submodule("1")
    torch.nn.init.normal_(last.get_parameter("weight"), std=0.5)
    torch.nn.init.zeros_(last.get_parameter("bias"))
    return network


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames in the OpenPCDet layout with four people, seen from 2 m above the ground."""
    folder = tmp_path_factory.mktemp("people") / "dataset"
    for name in ("points", "labels"):
        (folder / name).mkdir(parents=True)
    draw = np.random.default_rng(3)
    for number in range(2):
        plan = np.array([[-6.0, -6], [-7, 6], [6, 7], [7, -6]]) + draw.uniform(-1, 1, (4, 2))
        parts = [draw.uniform((-12, -12, -0.02), (12, 12, 0.02), (3500, 3))]
        parts += [column(x, y, 1.8, 0.6, draw, 200) for x, y in plan]
        points = np.concatenate(parts) - (0, 0, 2)
        np.save(folder / f"points/{number:06}.npy", np.pad(points, ((0, 0), (0, 1))).astype("f4"))
        rows = [f"{x:.4f} {y:.4f} -1.1 0.7 0.7 1.8 0 pedestrian" for x, y in plan]
        (folder / f"labels/{number:06}.txt").write_text("\n".join(rows) + "\n")
    return folder


@pytest.mark.thorough
def test_what_a_detector_finds_in_its_frames_is_what_it_learns_from(
    people: Path, tmp_path: Path
) -> None:
    """A network that has learned nothing proposes people everywhere: few of them are right."""
    design = Design(("pedestrian",), 12.0)
    frames = labelled_frames([people], design, tmp_path / "frames", untold)
    torch.manual_seed(1)
    network = new_network(design).eval()
    recipe = Recipe(batch=1, window_m=19.2, seed=3)
    assert proposals_of(network, frames, design, recipe, 2, untold) is None  # of nobody it is sure
    network = guessing(design)
    found = proposals_of(network, frames, design, recipe, 6, untold)
    again = proposals_of(network, frames, design, Recipe(batch=1, window_m=19.2, seed=3, workers=2),
                         6, untold)  # fmt: skip
    assert found is not None
    assert again is not None
    assert np.array_equal(found.crops.points, again.crops.points)
    assert np.array_equal(found.right, again.right)
    assert 0 < found.right.sum() < (~found.right).sum() <= 6 * 24
    assert found.crops.told.shape == (len(found.right), TOLD)


def test_a_model_keeps_its_second_look_and_detects_with_it_unless_told(
    people: Path, tmp_path: Path
) -> None:
    torch.manual_seed(2)
    design = Design(("pedestrian",), 12.0)
    network = guessing(design)
    look = SecondLook(1).eval()
    folder = tmp_path / "model"
    folder.mkdir()
    write_model(folder, Model(design, network, {}, look))
    read = read_model(folder)
    assert read.second_look is not None
    for name, one in look.state_dict().items():
        assert torch.equal(one, read.second_look.state_dict()[name]), name
    given = {"least": 0.02, "progress": False}
    twice = ut.model.detect(people, tmp_path / "twice", model=folder, **given).found
    once = ut.model.detect(
        people, tmp_path / "once", model=folder, second_look=False, **given
    ).found
    assert len(once) > 10
    where = {tuple(box): score for box, score in zip(once.box.tolist(), once.score, strict=True)}
    again = zip(twice.box.tolist(), twice.score, strict=True)
    both = [(where[tuple(box)], score) for box, score in again if tuple(box) in where]
    assert len(both) > 10
    assert not np.allclose(*zip(*both, strict=True))
    text = (folder / "model.yaml").read_text().replace("second_look: true", "second_look: false")
    (folder / "model.yaml").write_text(text)
    with pytest.raises(ut.InputError, match="cannot be read"):
        read_model(folder)


def test_nobody_is_found_where_no_point_is_near(tmp_path: Path) -> None:
    torch.manual_seed(2)
    design = Design(("pedestrian",), 12.0)
    model, frames = tmp_path / "model", tmp_path / "frames"
    model.mkdir()
    frames.mkdir()
    write_model(model, Model(design, new_network(design).eval(), {}, SecondLook(1).eval()))
    points = np.random.default_rng(4).uniform((400, 400, 0, 0), (500, 500, 0.1, 1), (90, 4))
    points.astype("<f4").tofile(frames / "000000.bin")
    assert len(ut.model.detect(frames, tmp_path / "found", model=model, progress=False).found) == 0


@pytest.mark.thorough
def test_a_training_ends_with_a_second_look_where_it_found_somebody(
    people: Path, tmp_path: Path
) -> None:
    given = {"reach": 12, "cell": 0.8, "classes": ["pedestrian"], "batch": 2, "progress": False}
    model = ut.model.train(people, tmp_path / "few", steps=1, **given)
    assert model.trained["second_look"] is False
    assert not (model.folder / "second_look.onnx").exists()
    model = ut.model.train(people, tmp_path / "model", steps=50, **given)
    assert model.trained["second_look"] is True
    assert (model.folder / "second_look.onnx").is_file()
    assert read_model(model.folder).second_look is not None
    bare = ut.model.train(people, tmp_path / "bare", steps=50, second_look=False, **given)
    assert bare.trained["second_look"] is False
    ours, theirs = (read_model(one.folder).network.state_dict() for one in (model, bare))
    assert all(torch.equal(one, theirs[name]) for name, one in ours.items())
