"""Detectors: what they are told and say, and that training finds, goes on and refuses."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import urbantwin as ut

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.artefact import write_inventory  # noqa: E402
from urbantwin.artefact.output import kind_of  # noqa: E402
from urbantwin.detections import joined  # noqa: E402
from urbantwin.fidelity.readers import open_recording  # noqa: E402
from urbantwin.learn import (  # noqa: E402
    Design,
    LabelledFrames,
    Model,
    Recipe,
    labelled_frames,
    read_model,
    trained,
    write_model,
)
from urbantwin.learn.augmentation.placement import Placement  # noqa: E402
from urbantwin.learn.augmentation.sizes import resized  # noqa: E402
from urbantwin.learn.compiled.box_points import points_in_boxes  # noqa: E402
from urbantwin.learn.decoding import boxes_of_maps  # noqa: E402
from urbantwin.learn.frames import IGNORED, LevelFrame, level_frame_from  # noqa: E402
from urbantwin.learn.grid import Grid  # noqa: E402
from urbantwin.learn.heads import OUTPUTS, class_heads  # noqa: E402
from urbantwin.learn.labelling import write_labelled  # noqa: E402
from urbantwin.learn.loss import detection_loss, target_arrays, targets_in  # noqa: E402
from urbantwin.learn.model import first_weights  # noqa: E402
from urbantwin.learn.onnx_file import write_onnx  # noqa: E402
from urbantwin.learn.sample import Varied  # noqa: E402
from urbantwin.learn.targets import ClassTarget, targets_of  # noqa: E402
from urbantwin.learn.views import VIEWS, View  # noqa: E402
from urbantwin.progress import untold  # noqa: E402

from ..thorough import further  # noqa: E402

pytestmark = pytest.mark.xdist_group("learn")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Other tests run beside."""
    torch.set_num_threads(1)


NAMES = ("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian")
HEADS = class_heads(NAMES)


def maps_of(targets: list[ClassTarget]) -> list[NDArray[np.float32]]:
    """What a network says that is right everywhere."""
    found = []
    for target in targets:
        said = np.zeros((OUTPUTS, *target.heat.shape), np.float32)
        heat = np.clip(target.heat, 1e-6, 1 - 1e-6)
        said[0] = np.log(heat / (1 - heat))
        flat = said[1:].reshape(OUTPUTS - 1, -1)
        flat[:, target.cell] = target.box.T
        flat[-2:, target.cell] = flat[-2:, target.cell] * 8 - 4
        found.append(said)
    return found


def test_boxes_come_out_as_they_were_told() -> None:
    draw = np.random.default_rng(1)
    grid = Grid.around(0, 0, 25.6, 0.4)
    across = np.arange(-20, 21, 13.0)
    plan = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2) + draw.uniform(
        -0.3, 0.3, (16, 2)
    )
    number = np.arange(16) % 6
    size = np.array([HEADS[one].usual for one in number]) * draw.uniform(0.9, 1.1, (16, 3))
    yaw = draw.uniform(-np.pi, np.pi, 16)
    box = np.column_stack([plan, size[:, 2] / 2 + 0.1, size, yaw])
    found = boxes_of_maps(maps_of(targets_of(box, number, grid, HEADS)), grid, HEADS, 0.5)
    assert len(found.box) == 16
    for one, which in zip(found.box, found.number, strict=True):
        own = np.argmin(np.hypot(*(box[:, :2] - one[:2]).T))
        assert which == number[own]
        off = one - box[own]
        off[6] = np.arctan2(np.sin(off[6]), np.cos(off[6]))
        assert np.abs(off).max() < 1e-5


@pytest.mark.parametrize("view", VIEWS)
def test_what_is_said_of_a_frame_seen_from_another_side_is_turned_back(view: View) -> None:
    draw = np.random.default_rng(5)
    grid = Grid.around(0, 0, 25.6, 0.4)
    across = np.arange(-20, 21, 13.0)
    plan = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2)
    plan = plan + draw.uniform(-0.3, 0.3, plan.shape)
    number = np.arange(16) % 6
    size = np.array([HEADS[one].usual for one in number])
    box = np.column_stack([plan, size[:, 2] / 2, size, draw.uniform(-np.pi, np.pi, 16)])
    there = Placement(yaw=view.quarters * np.pi / 2, mirrored=view.mirrored)
    points = draw.normal(0, 9, (50, 3)).astype(np.float32)
    np.testing.assert_allclose(view.points(points), there.points(points), atol=1e-5)
    seen = maps_of(targets_of(there.boxes(box), number, grid, HEADS))
    found = boxes_of_maps([view.back(one) for one in seen], grid, HEADS, 0.5)
    assert len(found.box) == 16
    for one, which in zip(found.box, found.number, strict=True):
        own = np.argmin(np.hypot(*(box[:, :2] - one[:2]).T))
        off = one - box[own]
        off[6] = np.arctan2(np.sin(off[6]), np.cos(off[6]))
        assert which == number[own]
        assert np.abs(off).max() < 1e-5


@pytest.mark.parametrize("name", ["car", "bus", "bicycle", "pedestrian"])
def test_finer_pillars_and_larger_vehicles_change_no_weight_of_boxes_and_centres(name: str) -> None:
    number = [one.name for one in HEADS].index(name)
    draw = np.random.default_rng(8)
    plan = np.stack(np.meshgrid(*[np.arange(-20, 21, 10.0)] * 2), -1).reshape(-1, 2)
    plan = plan + draw.uniform(-1, 1, plan.shape)
    size = np.tile(HEADS[number].usual, (len(plan), 1))
    yaw = draw.uniform(-np.pi, np.pi, len(plan))
    box = np.column_stack([plan, size[:, 2] / 2, size, yaw])
    losses = []
    for cell_m in (0.2, 0.4):
        grid, heads = Grid.around(0, 0, 25.6, cell_m), class_heads(NAMES, cell_m)
        targets = targets_of(box, np.full(len(box), number), grid, heads)[number : number + 1]
        wanted = targets_in(
            {key: torch.from_numpy(one) for key, one in target_arrays([targets]).items()}, 1
        )
        # Everywhere a centre with a likelihood of 0.1, and boxes that are off.
        said = torch.zeros((1, OUTPUTS, *targets[0].heat.shape))
        said[:, 0] = np.log(0.1 / 0.9)
        flat = said[0, 1:].reshape(OUTPUTS - 1, -1)
        flat[:, wanted[0].cell] = wanted[0].box.T + 1
        head = heads[number : number + 1]
        losses.append((detection_loss([said], wanted, head, [1.0])[0] / len(box)).tolist())
        # Who is four times as many weighs half as much each.
        many = detection_loss([said], wanted, head, [4.0])[0] / len(box)
        assert many.tolist() == pytest.approx([one / 2 for one in losses[-1]])
        # Of each object 8 of the 10 values are off by 1.
        off = sum(head[0].box_weights[:8])
        assert losses[-1][1] == pytest.approx(3 * off, rel=0.1)
    fine, coarse = losses
    assert fine[0] == pytest.approx(coarse[0], rel=0.01)


def test_who_is_ignored_and_where_nothing_counts_teaches_nothing() -> None:
    grid = Grid.around(0, 0, 12.8, 0.4)
    box = np.array([[0.0, 0, 0.8, 4.5, 1.85, 1.6, 0.3]])
    target = targets_of(box, np.array([-1]), grid, HEADS)[0]
    assert target.objects == 0
    assert 0 < (target.counts == 0).sum() < 40
    nowhere = np.zeros((grid.cells, grid.cells), bool)
    target = targets_of(box, np.array([0]), grid, HEADS, nowhere)[0]
    assert target.objects == 0
    assert not target.counts.any()
    assert not target.weight.any()


def test_who_is_resized_keeps_his_ground_his_place_and_his_points() -> None:
    draw = np.random.default_rng(7)
    plan = np.stack(np.meshgrid(*[np.arange(-30, 31, 10.0)] * 2), -1).reshape(-1, 2)
    number = np.arange(len(plan)) % 3 - 1  # ignored, a car, a pedestrian
    size = np.where(number[:, None] == 1, [[0.7, 0.6, 1.8]], [[4.5, 1.8, 1.5]])
    yaw = draw.uniform(-np.pi, np.pi, len(plan))
    box = np.column_stack([plan, size[:, 2] / 2 + 0.05, size, yaw])
    owner = np.repeat(np.arange(len(box)), 20)
    inside = draw.uniform(-0.5, 0.5, (len(owner), 3)).astype(np.float32)

    def placed(box: np.ndarray) -> np.ndarray:
        mine, c, s = box[owner], np.cos(box[owner, 6]), np.sin(box[owner, 6])
        x, y, z = (inside * mine[:, 3:6]).T
        return mine[:, :3] + np.column_stack([x * c - y * s, x * s + y * c, z])

    ground = np.column_stack([draw.uniform(-35, 35, (500, 2)), np.full(500, -0.3)])
    points = np.concatenate([placed(box), ground]).astype(np.float32)
    ring = np.zeros(len(points), np.int32)
    nowhere = np.zeros((0, 3)), np.ones((1, 1), bool)
    frame = LevelFrame(points, ring, ring.astype(np.uint8), nowhere[0], box, number, nowhere[1])
    got = resized(frame, ("car", "pedestrian"), draw)
    assert np.abs(got.points[: len(owner)] - placed(got.box)).max() < 1e-4
    assert np.array_equal(got.points[len(owner) :], points[len(owner) :])
    same = [0, 1, 6]
    assert np.array_equal(got.box[:, same], box[:, same])
    np.testing.assert_allclose(got.box[:, 2] - got.box[:, 5] / 2, 0.05)
    ratio = got.box[:, 3:6] / box[:, 3:6]
    assert np.all(ratio[number == -1] == 1)
    np.testing.assert_allclose(ratio[:, 0], ratio[:, 1])
    assert 0.78 <= ratio[number == 0, 0].min() < 0.88
    assert 1.0 < ratio[number == 0, 0].max() <= 1.1
    assert np.all(np.abs(ratio[number == 1] - 1) <= 0.08)


def test_points_stay_in_their_boxes_when_a_frame_is_turned_mirrored_and_scaled() -> None:
    draw = np.random.default_rng(2)
    box = np.array([[5.0, -3, 0.8, 4.5, 1.8, 1.6, 0.7], [-8, 2, 0.9, 0.7, 0.6, 1.8, -2.0]])
    points = np.concatenate([draw.normal(one[:3], 0.6, (50, 3)) for one in box])
    there = Placement(2.0, 1.0, 1.1, mirrored=True, scale=1.04)
    before = points_in_boxes(points.astype(np.float32), box, 0.0)
    after = points_in_boxes(there.points(points), there.boxes(box), 0.0)
    assert 20 < (before >= 0).sum() < 100
    assert (before == after).mean() > 0.99  # float32 at the faces


@pytest.mark.parametrize("spread", [25.0, 4000.0])
def test_each_point_is_of_the_first_box_that_holds_it(spread: float) -> None:
    draw = np.random.default_rng(11)
    box = np.column_stack([
        draw.normal(0, spread, (60, 2)), draw.uniform(0, 1, 60), draw.uniform(0.4, 12, (60, 2)),
        draw.uniform(1, 3, 60), draw.uniform(-4, 4, 60),
    ])  # fmt: skip
    about = box[draw.integers(0, 60, 20_000), :3]
    points = (about + draw.normal(0, 3, about.shape)).astype(np.float32)
    wanted = np.full(len(points), -1)
    for number in range(59, -1, -1):
        x, y, z, length, width, height, yaw = box[number]
        plan = shapely.affinity.rotate(
            shapely.box(x - length / 2, y - width / 2, x + length / 2, y + width / 2),
            yaw, use_radians=True,
        ).buffer(0.1, join_style="mitre")  # fmt: skip
        inside = shapely.contains_xy(plan, points[:, 0], points[:, 1])
        wanted[inside & (np.abs(points[:, 2] - z) <= height / 2 + 0.1)] = number
    got = points_in_boxes(points, box, 0.1)
    assert (wanted >= 0).sum() > 2000
    assert (got == wanted).mean() > 0.9999  # on an edge
    assert (points_in_boxes(points, box[:0], 0.1) == -1).all()


def surface(box: NDArray[np.float64], draw: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Points on the sides and the roof of a box."""
    at = draw.uniform(-0.5, 0.5, (count, 3))
    side = draw.integers(0, 3, count)
    ends = np.where(draw.random(count) < 0.5, -0.5, 0.5)
    at[np.arange(count), side] = np.where(side == 2, 0.5, ends)
    at *= box[3:6]
    c, s = np.cos(box[6]), np.sin(box[6])
    return at @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + box[:3]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames in the OpenPCDet layout: boxes on a slope, seen from a mast 5 m above it."""
    folder = tmp_path_factory.mktemp("street") / "dataset"
    for name in ("points", "labels", "semantic"):
        (folder / name).mkdir(parents=True)
    draw = np.random.default_rng(3)
    for number in range(2):
        plan = np.array([[-6.0, -6], [-7, 6], [1, -1], [6, 7], [7, -6]])
        plan += draw.uniform(-1, 1, plan.shape)
        size = np.tile([4.5, 1.85, 1.6], (5, 1)) * draw.uniform(0.9, 1.1, (5, 1))
        height = 0.05 * plan[:, 0] - 5 + size[:, 2] / 2
        box = np.column_stack([plan, height, size, draw.uniform(-np.pi, np.pi, 5)])
        ground = draw.uniform(-12, 12, (3500, 3))
        ground[:, 2] = 0.05 * ground[:, 0] - 5 + draw.normal(0, 0.01, 3500)
        points = np.concatenate([ground, *(surface(one, draw, 300) for one in box)])
        intensity = np.zeros((len(points), 1))
        np.save(folder / f"points/{number:06}.npy", np.hstack([points, intensity]).astype("f4"))
        semantic = np.repeat([40, 10], [3500, len(points) - 3500]).astype("<u4")
        semantic.tofile(folder / f"semantic/{number:06}.label")
        rows = [" ".join(f"{value:.4f}" for value in one) + " car" for one in box]
        (folder / f"labels/{number:06}.txt").write_text("\n".join(rows) + "\n")
    return folder


def same_in_onnxruntime(model: Model, file: Path) -> None:
    """Another program says the same of other pillars, more of them."""
    onnxruntime = pytest.importorskip("onnxruntime", reason="needs onnxruntime")
    cells = Grid.around(0, 0, model.design.range_m, model.design.cell_m).cells
    draw = torch.Generator().manual_seed(7)
    pillars = 900
    features = torch.randn((pillars, 16, 8), generator=draw)
    points = torch.randint(1, 17, (pillars,), generator=draw)
    cell = torch.randperm(cells**2, generator=draw)[:pillars]
    with torch.inference_mode():
        wanted = model.network(features, points, cell, torch.zeros((1, 0, cells, cells)))
    session = onnxruntime.InferenceSession(file)
    given = {"features": features.numpy(), "points": points.numpy(), "cell": cell.numpy()}
    if model.design.points:
        told = torch.randn((500, 3), generator=draw)
        at = torch.randint(0, cells**2, (500,), generator=draw)
        given |= {"told": told.numpy(), "at": at.numpy()}
        with torch.inference_mode():
            wanted = model.network(features, points, cell, torch.zeros((1, 0, cells, cells)),
                                   told, at)  # fmt: skip
    for one, said in zip(wanted, session.run(None, given), strict=True):
        assert np.abs(one.numpy() - said).max() < 1e-4


@pytest.mark.parametrize("cell_m", [0.5, *further(0.25)])
def test_it_finds_what_it_was_shown(street: Path, tmp_path: Path, cell_m: float) -> None:
    design = Design(("car",), 12.0, cell_m, points=("car", "road"))
    frames = labelled_frames([street], design, tmp_path / "frames", untold)
    assert frames.objects == (10,)
    same = Varied(placed=False, beams=False, objects=False, sizes=False, clutter=False)
    recipe = Recipe(steps=240, batch=2, window_m=24.0, varied=same)
    network, *_ = trained(frames, design, recipe, tmp_path / "state", untold)
    folder = tmp_path / "model"
    folder.mkdir()
    write_model(folder, Model(design, network, {}))
    found = ut.model.detect(
        street, tmp_path / "detections", model=folder, least=0.3, progress=False
    ).found
    for number, name in enumerate(found.frames):
        rows = (street / f"labels/{name}.txt").read_text().splitlines()
        wanted = np.array([[float(word) for word in row.split()[:7]] for row in rows])
        said = found.of(number).box
        apart = np.linalg.norm(wanted[:, None, :3] - said[None, :, :3], axis=2)
        assert apart.min(axis=1).max() < 0.5
    with pytest.raises(ut.InputError, match=r"/detections: 2 frames are too few .* at least 10"):
        ut.model.detect(
            street, tmp_path / "d", model=folder, standing=tmp_path / "detections", progress=False
        )
    judged = ut.model.evaluate(folder, street, tmp_path / "report", progress=False)
    assert (tmp_path / "report-detections" / "detections.json").is_file()
    assert judged.manifest["frames"] == 2
    of_points = judged.manifest["semantic"]
    assert of_points["classes"]["road"]["points"] == 7000
    assert of_points["looked_at"] == 1.0
    right = wrong = 0
    for name in found.frames:
        told = [np.fromfile(one / "semantic" / f"{name}.label", "<u4")
                for one in (street, tmp_path / "detections")]  # fmt: skip
        right += int(((told[0] == 10) & (told[1] == 10)).sum())
        wrong += int(((told[0] == 10) ^ (told[1] == 10)).sum())
    assert of_points["classes"]["car"]["iou"] == pytest.approx(right / (right + wrong))
    assert of_points["mean_iou"] > 0.85
    model = read_model(folder)  # with the head for points
    write_onnx(tmp_path, model)
    same_in_onnxruntime(model, tmp_path / "model.onnx")


@pytest.mark.thorough
def test_what_was_learned_without_labels_begins_a_detector(street: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(street / "points", bare / "points")
    first = ut.model.pretrain(bare, tmp_path / "first", steps=2, reach=12, progress=False)
    with pytest.raises(ut.InputError, match="has no output"):
        ut.model.detect(street, tmp_path / "d", model=first, progress=False)
    given = {"reach": 12, "classes": ["car"], "progress": False}
    with pytest.raises(ut.InputError, match=r"has cell_m 0.4 m.*expected.*cell_m 0.5"):
        ut.model.train(street, tmp_path / "m", weights=first, steps=1, cell=0.5, **given)
    known = read_model(first.folder).network.state_dict()
    weights = first_weights(first.folder, Design(("car",), 12.0)).weights
    assert set(weights) == {name for name in known if not name.startswith("heads")}
    assert all(torch.equal(known[name], one) for name, one in weights.items())
    one = ut.model.train(street, tmp_path / "one", weights=first, steps=1, **given)
    two = ut.model.train(street, tmp_path / "two", weights=one, steps=1, **given)
    assert two.trained["start"] not in (None, one.trained["start"])
    began = first_weights(one.folder, Design(("bus", "car"), 12.0)).weights
    head = read_model(one.folder).network.state_dict()["heads.0.1.weight"]
    assert torch.equal(began["heads.1.1.weight"], head)
    assert "heads.0.1.weight" not in began


def test_what_a_teacher_is_sure_of_is_a_label_and_what_it_doubts_does_not_count(
    tmp_path: Path,
) -> None:
    draw = np.random.default_rng(1)
    bare = tmp_path / "bare" / "points"
    bare.mkdir(parents=True)
    for number in range(3):
        np.save(
            bare / f"{number:06}.npy", draw.uniform(-9, 9, (9000, 4)).astype("f4") * [1, 1, 0, 0]
        )
    box = [
        [2.0, 1, 0.1, 4, 2, 1.5, 0.5],
        [-3, 4, 0.1, 4.2, 1.9, 1.4, 2],
        [5, -6, 0.1, 0.6, 0.6, 1.8, 0],
    ]
    rows = [(np.array(box) + 0.1 * k, ["car", "car", "pedestrian"], np.array([0.9, 0.2, 0.6]))
            for k in range(3)]  # fmt: skip
    recording = open_recording(bare.parent)
    found = joined(recording.names, rows)
    folder = tmp_path / "labelled"
    folder.mkdir()
    counts = write_labelled(folder, recording, found, sure=0.5, made_by={}, tell=untold)
    assert counts == {"car": 3, "doubted": 3, "pedestrian": 3}
    again = open_recording(folder)
    assert again.names == recording.names
    for number, (wanted, names, _) in enumerate(rows):
        frame = again.read(number)
        assert np.allclose(frame.points, recording.read(number).points)
        assert frame.boxes is not None
        assert np.abs(frame.boxes.box - wanted).max() < 1e-4
        assert frame.boxes.class_names == ("car", "other", "pedestrian")
        level = level_frame_from(frame, ("car", "pedestrian"), 12, file=folder)
        assert level.number.tolist() == [0, IGNORED, 1]
        assert names[1] == "car"


@pytest.mark.thorough
def test_a_model_labels_frames_that_another_learns_from(street: Path, tmp_path: Path) -> None:
    given = {"steps": 1, "reach": 12, "classes": ["car"], "progress": False}
    teacher = ut.model.train(street, tmp_path / "teacher", **given)
    with pytest.raises(ut.InputError, match="--doubtful"):
        ut.model.label(teacher, street, tmp_path / "l", sure=0.1, doubtful=0.2, progress=False)
    made = ut.model.label(teacher, street, tmp_path / "labelled", sure=0.012, doubtful=0.01,
                          rate=10, progress=False)  # fmt: skip
    told = json.loads((made.folder / "labelling.json").read_text())
    assert told["made_by"]["tracked"] is True
    assert sum(made.labels.values()) == sum(
        len(one.read_text().splitlines()) for one in (made.folder / "labels").iterdir()
    )
    student = ut.model.train([street, made], tmp_path / "student", weights=teacher, **given)
    assert student.trained["frames"] == 4


def test_a_curriculum_goes_through_its_datasets_in_order(street: Path, tmp_path: Path) -> None:
    design = Design(("car",), 12.0)
    frames = labelled_frames([street, street, street], design, tmp_path / "frames", untold)
    asked: list[int] = []

    class Watched(LabelledFrames):
        def frame(self, number: int) -> LevelFrame:
            asked.append(number)
            return super().frame(number)

    watched = Watched(frames.folder, frames.rigs, frames.objects, frames.points)
    recipe = Recipe(steps=6, batch=2, window_m=19.2, in_order=True)
    trained(watched, design, recipe, tmp_path / "state", untold)
    assert [frames.rigs[number] for number in asked[-12:]] == [0] * 4 + [1] * 4 + [2] * 4
    with pytest.raises(ut.InputError, match="need a number of steps"):
        ut.model.train(street, tmp_path / "m", in_order=True, progress=False)


@pytest.mark.thorough
def test_frames_of_other_parts_are_not_learned_from(street: Path, tmp_path: Path) -> None:
    """Of a dataset with a split, training sees one part, and a judge the other."""
    split = shutil.copytree(street, tmp_path / "split")
    (split / "ImageSets").mkdir()
    for part, names in (("train", "000000\n"), ("val", "000001\n"), ("test", "")):
        (split / f"ImageSets/{part}.txt").write_text(names)
    given = {"steps": 1, "reach": 12, "classes": ["car"], "progress": False}
    model = ut.model.train(split, tmp_path / "model", **given)
    assert (model.trained["frames"], model.trained["objects"]) == (1, {"car": 5})
    assert ut.model.train(split, tmp_path / "all", part="all", **given).trained["frames"] == 2
    assert (
        ut.model.pretrain(split, tmp_path / "p", steps=1, reach=12, progress=False).trained[
            "frames"
        ]
        == 1
    )
    (split / "points/000001.npy").write_bytes(b"no frame")  # training does not even open it
    ut.model.train(split, tmp_path / "model", **given)
    with pytest.raises(ut.InputError, match=r"test\.txt: names no frame for test"):
        ut.model.train(split, tmp_path / "m", part="test", **given)
    with pytest.raises(ut.InputError, match="unknown part"):
        ut.model.train(split, tmp_path / "m", part="validation", **given)
    shutil.copy(street / "points/000001.npy", split / "points")
    found = ut.model.detect(split, tmp_path / "d", model=model, part="val", progress=False).found
    assert found.frames == ("000001",)
    write_inventory(split)
    model = ut.model.train(split, tmp_path / "model", **given)
    for part, frames, noted in (("all", 2, True), ("train", 1, True), ("val", 1, False)):
        judged = ut.model.evaluate(model, split, tmp_path / f"r-{part}", part=part, progress=False)
        assert judged.manifest["frames"] == frames
        assert any("has learned from" in one for one in judged.manifest["notes"]) == noted
    (split / "ImageSets/train.txt").write_text("000009\n")
    with pytest.raises(ut.InputError, match="has no frame of its list"):
        ut.model.train(split, tmp_path / "m", **given)


@pytest.mark.thorough
def test_an_interrupted_training_ends_in_the_same_weights(street: Path, tmp_path: Path) -> None:
    design = Design(("car",), 16.0)
    frames = labelled_frames([street], design, tmp_path / "frames", untold)
    recipe = Recipe(steps=4, batch=2, window_m=19.2, seed=4, kept_every_s=0)
    whole, *_ = trained(frames, design, recipe, tmp_path / "whole", untold)

    def interrupts(at: int) -> Callable[[float, str], None]:
        def tell(share: float, doing: str) -> None:
            if doing.startswith(f"step {at} "):
                raise KeyboardInterrupt

        return tell

    state = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        trained(frames, design, recipe, state, interrupts(3))
    threads = Recipe(steps=4, batch=2, window_m=19.2, seed=4, workers=2)
    parts, *_ = trained(frames, design, threads, state, untold)
    for name, one in whole.state_dict().items():
        assert torch.equal(one, parts.state_dict()[name]), name
    other, *_ = trained(
        frames, design, Recipe(steps=1, batch=2, window_m=19.2, seed=5), tmp_path / "x", untold
    )
    assert not torch.equal(other.encoder.linear.weight, whole.encoder.linear.weight)


def test_bad_input_is_refused_in_a_line(street: Path, tmp_path: Path) -> None:
    with pytest.raises(ut.InputError, match="no box of class bus"):
        ut.model.train(street, tmp_path / "m", steps=1, classes=["bus", "car"], progress=False)
    with pytest.raises(ut.InputError, match="unknown class 'tank'"):
        ut.model.train(street, tmp_path / "m", steps=1, classes=["tank"], progress=False)
    with pytest.raises(ut.InputError, match="unknown without 'colour'"):
        ut.model.train(street, tmp_path / "m", steps=1, without=["colour"], progress=False)
    with pytest.raises(ut.InputError, match="no device"):
        ut.model.train(street, tmp_path / "m", steps=1, device="abacus", progress=False)
    model = ut.model.train(
        street, tmp_path / "m", steps=1, batch=1, classes=["car"], reach=12, progress=False
    )
    with pytest.raises(ut.InputError, match="is not there"):
        ut.model.detect(street, tmp_path / "d", model=street, progress=False)
    down = tmp_path / "down" / "points"
    down.mkdir(parents=True)
    for file in (street / "points").iterdir():
        np.save(down / file.name, np.load(file) * np.array([1, 1, -1, 1], "f4"))
    with pytest.raises(ut.InputError, match="z pointing down"):
        ut.model.detect(down.parent, tmp_path / "d", model=model, progress=False)
    assert kind_of(model.folder) == "model"
    assert not (model.folder / "training").exists()
    same_in_onnxruntime(read_model(model.folder), model.folder / "model.onnx")
    weights = model.folder / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-4] + b"\0\0\0\1")
    with pytest.raises(ut.InputError, match="SHA-256 differs"):
        read_model(model.folder)
    text = (model.folder / "model.yaml").read_text()
    (model.folder / "model.yaml").write_text(text.replace("- car", "- tank"))
    with pytest.raises(ut.InputError, match="names 'tank'"):
        read_model(model.folder)
    assert json.loads((model.folder / "model.json").read_text())["kind"] == "model"
