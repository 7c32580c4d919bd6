"""Actors added to a motion: where they are told to be, on the slope, and nobody else changes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pytest

from urbantwin.errors import InputError
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.assets import asset, asset_mesh, sized_name
from urbantwin.traffic.insertion import inserted
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface, usual_asset
from urbantwin.twin import Twin

SECONDS = 4.0


@pytest.fixture(scope="module")
def motion(brief_twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    folder = tmp_path_factory.mktemp("inserted") / "motion"
    run_traffic(brief_twin, folder, seconds=SECONDS)
    return Motion.load(folder)


@pytest.fixture(scope="module")
def surface(brief_twin: Twin) -> TwinSurface:
    return TwinSurface(brief_twin)


def eastwards(asset_name: str = "car-sedan_black", y: float = -1.6) -> PrescribedPath:
    """From west to east at 10 m/s, from one second on."""
    times = np.array([1.0, 4.0])
    return PrescribedPath("car", asset_name, times, np.array([[-20.0, y], [10.0, y]]))


def test_everybody_else_stays_to_the_byte(
    motion: Motion, surface: TwinSurface, tmp_path: Path
) -> None:
    ten = [eastwards(usual_asset("car", k), y=-30.0 + 6 * k) for k in range(10)]
    changed, tracks = inserted(motion, ten, surface)
    last = int(motion.actors["track"].to_numpy().max())
    assert tracks == tuple(range(last + 1, last + 11))
    others = changed.actors.filter(pc.less_equal(changed.actors["track"], last)).combine_chunks()
    assert others.equals(motion.actors.combine_chunks())
    assert changed.signals.equals(motion.signals)
    changed.save(tmp_path / "changed")
    again = Motion.load(tmp_path / "changed")
    assert again.sha256() == changed.sha256()
    before = motion.manifest["classes"]["car"]["seen"]
    assert again.manifest["classes"]["car"]["seen"] == before + 10


def test_one_more_does_not_change_those_added_before(motion: Motion, surface: TwinSurface) -> None:
    one, (first,) = inserted(motion, [eastwards()], surface)
    two, tracks = inserted(one, [eastwards(y=3.0)], surface)
    both, together = inserted(motion, [eastwards(), eastwards(y=3.0)], surface)
    assert (first, *tracks) == together
    assert two.actors.equals(both.actors)


def test_it_drives_where_it_is_told_and_stands_on_the_slope(
    motion: Motion,
    surface: TwinSurface,
    slope: np.ndarray,
    records: Callable[..., np.recarray],
) -> None:
    changed, (track,) = inserted(motion, [eastwards()], surface)
    rows = records(changed.actors.filter(pc.equal(changed.actors["track"], track)))
    assert rows.time_s[0] == 1.0
    assert rows.time_s[-1] == pytest.approx(SECONDS - motion.step_s)
    assert rows.x == pytest.approx(-20 + 10 * (rows.time_s - 1.0))
    assert rows.speed == pytest.approx(10.0)
    assert rows.yaw == pytest.approx(0.0)
    assert rows.z == pytest.approx(rows.x * slope[0] + rows.y * slope[1], abs=0.01)
    assert rows.pitch == pytest.approx(-np.arctan(slope[0]), abs=1e-3)
    # Eastbound traffic keeps to the right: south of the middle, on the edges from the west.
    before_junction = rows.lane[rows.x < -15]
    assert set(before_junction) <= {"wc_1", "wc_2"}, set(before_junction)


def test_a_size_stretches_mesh_box_and_contacts(motion: Motion, surface: TwinSurface) -> None:
    name = sized_name("car-sedan_black", 5.2, 2.0, 1.6)
    changed, (track,) = inserted(motion, [eastwards(name)], surface)
    mesh = changed.mesh(name, 0)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([5.2, 2.0, 1.6], abs=1e-6)
    row = changed.at(2.0)
    row = row[row["track"] == track][0]
    assert (row["length"], row["width"], row["height"]) == (5.2, 2.0, 1.6)
    usual, sized = asset("car-sedan"), asset(name)
    assert np.ptp(sized.contacts[:, 0]) / np.ptp(usual.contacts[:, 0]) == pytest.approx(
        5.2 / usual.length
    )
    assert (asset_mesh(name).material == asset_mesh("car-sedan_black").material).all()


@pytest.mark.parametrize(
    ("problem", "change"),
    [
        ("unknown actor class 'tank'", {"actor_class": "tank"}),
        ("unknown asset", {"asset": "car-none"}),
        ("time does not go on", {"time_s": np.array([1.0, 1.0])}),
        ("not finite", {"xy": np.array([[0.0, np.nan], [1.0, 1.0]])}),
        ("places", {"xy": np.zeros((3, 2))}),
    ],
)
def test_what_is_no_path_is_refused(problem: str, change: dict[str, object]) -> None:
    path = {
        "actor_class": "car",
        "asset": "car-sedan",
        "time_s": np.array([0.0, 1.0]),
        "xy": np.zeros((2, 2)),
    }
    with pytest.raises(InputError, match=problem):
        PrescribedPath(**{**path, **change})  # type: ignore[arg-type]
