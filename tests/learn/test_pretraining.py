"""Pre-training: what is asked for, that it goes on after an interruption, and what is refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import urbantwin as ut

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.fidelity.frame import Frame  # noqa: E402
from urbantwin.fidelity.readers import Recording  # noqa: E402
from urbantwin.geometry import Pose  # noqa: E402
from urbantwin.learn import Design, Recipe, pretrained, unlabelled_frames  # noqa: E402
from urbantwin.learn.frames import levelled  # noqa: E402
from urbantwin.learn.grid import Grid  # noqa: E402
from urbantwin.learn.next_sweep import followed, next_sweep  # noqa: E402
from urbantwin.learn.pillars import pillars_of  # noqa: E402
from urbantwin.learn.pretraining import TASKS, hidden_of, next_of  # noqa: E402
from urbantwin.progress import untold  # noqa: E402

pytestmark = pytest.mark.xdist_group("learn")


@pytest.fixture(autouse=True)
def one_thread() -> None:
    """Other tests run beside."""
    torch.set_num_threads(1)


def place(mover_x: float) -> NDArray[np.float64]:
    """A square of 50 m with walls and posts 2 m high, and someone 1.8 m high at a place."""
    across = np.arange(-24.8, 25, 0.8) + 0.2
    ground = np.stack([*np.meshgrid(across, across), np.zeros((63, 63))], -1).reshape(-1, 3)
    draw = np.random.default_rng(4)
    feet = draw.integers(-58, 58, (60, 2)) * 0.4 + 0.2
    up = np.arange(0.2, 2.1, 0.2)
    posts = np.column_stack([np.repeat(feet, len(up), axis=0), np.tile(up, len(feet))])
    mover = np.column_stack([np.full(9, mover_x), np.full(9, 3.0), np.linspace(0.2, 1.8, 9)])
    return np.concatenate([ground, posts, mover])


def sweep(points: NDArray[np.float64], ego: Pose | None, *, told: bool = True) -> Frame:
    """What a sensor 1.7 m above the ground sees of it, which may tell where it was."""
    world_SE3_frame = Pose(np.eye(3), np.array([0, 0, 1.7])) if ego is None else ego
    seen = world_SE3_frame.inverse().apply(points)
    return Frame(seen, world_SE3_frame=world_SE3_frame if told else None)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three sweeps of a sensor that stands, and one of another place."""
    folder = tmp_path_factory.mktemp("bare") / "recording"
    (folder / "points").mkdir(parents=True)
    for number in range(4):
        points = sweep(place(number * 1.0), None).points
        if number == 3:
            points = points @ np.diag([1.0, -1.0, 1.0])
        np.save(folder / f"points/{number:06}.npy", np.pad(points, ((0, 0), (0, 1))).astype("f4"))
    return folder


def test_blocks_are_hidden_and_what_was_in_them_is_asked_for() -> None:
    draw = np.random.default_rng(5)
    grid = Grid.around(0, 0, 12.8, 0.4)
    points = draw.uniform((-12, -12, 0), (12, 12, 2), (3000, 3)).astype("f4")
    whole = pillars_of(points, grid)
    hidden = hidden_of(whole, grid.cells, draw)
    column, row = np.floor((points[:, :2].astype(float) - grid.low) / grid.cell_m).astype(int).T
    high = np.zeros((grid.cells, grid.cells))
    np.maximum.at(high, (row, column), points[:, 2] / 2)
    assert np.array_equal(hidden.occupied > 0, high > 0)
    assert np.abs(hidden.highest - high).max() < 1e-6
    assert 0.35 < hidden.asked.mean() < 0.65
    shown = np.zeros(grid.cells**2, bool)
    shown[hidden.pillars.cell] = True
    assert np.array_equal(shown.reshape(high.shape), (high > 0) & ~hidden.asked)
    blocks = hidden.asked.reshape(16, 4, 16, 4).mean(axis=(1, 3))
    assert set(np.unique(blocks)) == {0, 1}


def test_the_next_sweep_is_asked_for_where_this_one_is() -> None:
    first, second = place(0.0), place(1.2)
    turned = Pose.from_ypr((1.6, -0.8, 1.7), yaw=0.3, pitch=0.01)
    far = Pose.from_ypr((1e6, 2e6, 50.0), yaw=2.0)  # wherever the world has its origin
    start = far @ Pose(np.eye(3), np.array([0, 0, 1.7]))
    here = Frame(sweep(first, None).points, world_SE3_frame=start)
    there = Frame(sweep(second, turned).points, world_SE3_frame=far @ turned)
    level = levelled(here, 24.0)
    found = next_sweep(here, level, there, 24.0)
    assert found is not None

    wanted = second[np.abs(second[:, :2] - (1.6, -0.8)).max(axis=1) < 24.0]
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() < 0.03  # the ground is found in each sweep

    grid = Grid.around(0, 0, 12.8, 0.4)
    shown = pillars_of(level.frame.points, grid)
    question = next_of(shown, pillars_of(found, grid), grid.cells)
    assert question.pillars is shown
    assert question.asked.all()
    high = np.zeros((grid.cells, grid.cells))
    near = np.abs(wanted[:, :2]).max(axis=1) < 12.6
    # A hair north-east: no point lies on an edge of two cells.
    column, row = np.floor((wanted[near, :2] + 1e-3 - grid.low) / grid.cell_m).astype(int).T
    np.maximum.at(high, (row, column), np.maximum(wanted[near, 2], 1e-9))
    inner = slice(1, -1)
    assert np.array_equal(question.occupied[inner, inner] > 0, high[inner, inner] > 0)
    assert np.abs(2 * question.highest - high)[inner, inner].max() < 0.03


def test_sweeps_of_other_places_or_without_poses_do_not_follow() -> None:
    one = sweep(place(0.0), None, told=False)
    level = levelled(one, 24.0)
    assert next_sweep(one, level, sweep(place(1.0), None, told=False), 24.0) is not None
    ridden = Pose.from_ypr((1.5, 0.5, 1.7))
    assert next_sweep(one, level, sweep(place(1.0), ridden, told=False), 24.0) is None
    assert next_sweep(one, level, sweep(place(1.0), None), 24.0) is None
    known = sweep(place(0.0), None)
    assert next_sweep(known, level, sweep(place(1.0), ridden), 24.0) is not None

    recording = Recording(Path("x"), "own", tuple("abcde"), lambda _: one)
    assert followed(recording, tuple("abcde")) == [True, True, True, True, False]
    assert followed(recording, ("a", "b", "d", "e")) == [True, False, True, False]
    assert followed(recording, ()) == []


@pytest.mark.parametrize("task", TASKS)
def test_an_interrupted_pretraining_ends_in_the_same_weights(
    bare: Path, tmp_path: Path, task: str
) -> None:
    design, following = Design((), 16.0, 0.8), task == "next-sweep"
    seen = unlabelled_frames([bare], design, tmp_path / "frames", untold, following=following)
    assert seen.followed == ((0, 1) if following else ())
    recipe = Recipe(steps=5, batch=2, window_m=19.2, seed=4, kept_every_s=0)
    whole, *_ = pretrained(seen, design, recipe, tmp_path / "whole", untold, task)

    def interrupts(at: int) -> Callable[[float, str], None]:
        def tell(share: float, doing: str) -> None:
            if doing.startswith(f"step {at} "):
                raise KeyboardInterrupt

        return tell

    state = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        pretrained(seen, design, recipe, state, interrupts(3), task)
    # Several processes are what training from labels is tested with, which is the same loop.
    parts, steps, loss = pretrained(seen, design, recipe, state, untold, task)
    assert steps == 5
    assert np.isfinite(loss)
    for name, one in whole.state_dict().items():
        assert torch.equal(one, parts.state_dict()[name]), name


def test_the_task_is_one_that_is_known_and_needs_sweeps_that_follow(
    bare: Path, tmp_path: Path
) -> None:
    given = {"steps": 2, "reach": 12, "progress": False}
    made = ut.model.pretrain(bare, tmp_path / "next", task="next-sweep", **given)
    assert made.trained["task"] == "next-sweep"
    with pytest.raises(ut.InputError, match=r"unknown task 'nxt'.*masked, next-sweep"):
        ut.model.pretrain(bare, tmp_path / "x", task="nxt", **given)
    lone = tmp_path / "lone" / "points"
    lone.mkdir(parents=True)
    (lone / "000000.npy").write_bytes((bare / "points/000000.npy").read_bytes())
    with pytest.raises(ut.InputError, match="none of 1 frames is followed"):
        ut.model.pretrain(lone.parent, tmp_path / "x", task="next-sweep", **given)
