"""The report as a whole, on real sweeps and on folders that are wrong."""

import importlib
import json

import numpy as np
import pytest
from pyarrow import feather

from urbantwin.errors import InputError
from urbantwin.fidelity import compare
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.measure import RealFrame

from ..real_files import SWEEPS, argoverse_log


@pytest.fixture(autouse=True)
def one_pair_drawn(monkeypatch):
    """Of the worst pairs; the page has a test of its own."""
    monkeypatch.setattr(importlib.import_module("urbantwin.fidelity.compare"), "_WORST", 1)


@pytest.fixture
def no_page(monkeypatch):
    """Figures alone: nothing is drawn."""
    compared = importlib.import_module("urbantwin.fidelity.compare")
    monkeypatch.setattr(compared, "_draw", lambda report, found, folder: None)


SENSOR = (1.35, 0.0, 1.64)  # the upper of the two lidars in the vehicle's frame, about


def thin(array, share, seed):
    return array[np.random.default_rng(seed).random(len(array)) < share]


@pytest.fixture(scope="module")
def sweeps(shared_data, tmp_path_factory):
    """Return folders: two real sweeps, the same in the other order, and another site."""
    root = tmp_path_factory.mktemp("sweeps")
    files = [argoverse_log(shared_data) / name for name in SWEEPS]
    tables = [feather.read_table(file) for file in files]
    clouds = [
        np.column_stack([t[c].to_numpy().astype(np.float32) for c in ("x", "y", "z", "intensity")])
        for t in tables
    ]
    for name, frames in (("real", clouds), ("other", clouds[::-1])):
        (root / name).mkdir()
        for index, frame in enumerate(frames):
            np.save(root / name / f"{index}.npy", thin(frame, 0.12, index))
    (root / "elsewhere").mkdir()
    kitti = np.fromfile(shared_data / "lidar/kitti/000008.bin", np.float32).reshape(-1, 4)
    for index in range(2):
        thin(kitti, 0.4, index).tofile(root / "elsewhere" / f"{index}.bin")
    return root


@pytest.mark.thorough
@pytest.mark.usefixtures("no_page")
def test_real_is_near_real_and_far_from_another_site(sweeps, tmp_path):
    report = compare(
        sweeps / "real",
        sweeps / "other",
        tmp_path / "report",
        arbitrary=sweeps / "elsewhere",
        origin=SENSOR,
    )
    twin, control = report.twin, report.arbitrary
    assert control is not None
    # Sweeps 0.1 s apart of a car in a street: the static world is the same.
    assert twin["hausdorff_p95_m"].mean < 1.2
    assert twin["point_to_mesh_median_m"].mean < 0.15
    assert twin["js_range"].mean < 0.02
    assert twin["js_height"].mean < 0.02
    # The median and not the mean of point to mesh: of clouds thinned to an eighth, the mean is
    # set by far points that have no neighbour left (their held-out mean is 0.25 m as well).
    for name in ("hausdorff_p95_m", "point_to_mesh_median_m", "js_mean"):
        assert control[name].mean > 5 * twin[name].mean
        assert report.reduction_percent[name] == pytest.approx(
            (1 - twin[name].mean / control[name].mean) * 100
        )
        assert report.reduction_percent[name] > 80
    # The anchor: the first real sweep against the second is what "other" holds too.
    anchor = report.real_against_real["js_occupancy"]
    assert anchor.frames == 1
    assert anchor.mean == pytest.approx(twin["js_occupancy"].mean, rel=0.05)

    def no_constant(text):
        raise AssertionError(f"{text} in report.json")

    written = json.loads((tmp_path / "report/report.json").read_text(), parse_constant=no_constant)
    assert written["kind"] == "report"
    assert written["aggregate"]["js_mean"]["mean"] == twin["js_mean"].mean
    assert len(written["frames"]) == 2
    assert written["folders"]["real"]["intensity_full_scale"] == 255
    assert written["folders"]["arbitrary"]["intensity_full_scale"] == 1
    assert set(written["definitions"]) == set(written["aggregate"])
    assert written["headline"]["whole"]["js_mean"]["twin"] == twin["js_mean"].mean
    low, high = report.whole.reduction_ci95["hausdorff_p95_m"]
    assert low <= report.reduction_percent["hausdorff_p95_m"] <= high
    assert str(tmp_path) not in (tmp_path / "report/report.json").read_text()


def write_folder(folder, count, shift=0.0, columns=4):
    folder.mkdir()
    for index in range(count):
        points = np.random.default_rng(index).uniform(-20, 20, (500, columns)).astype(np.float32)
        points[:, 0] += shift
        points[:, 3:] = np.abs(points[:, 3:]) / 20
        np.save(folder / f"frame_{index}.npy", points)
    return folder


def test_identical_folders_and_same_bytes(tmp_path):
    real = write_folder(tmp_path / "real", 2)
    told = []
    report = compare(
        real, real, tmp_path / "a", arbitrary=None, progress=lambda done, what: told.append(done)
    )
    zero = [n for n in report.twin if not n.startswith(("point_to_mesh", "beam"))]
    assert all(report.twin[name].p95 == pytest.approx(0, abs=1e-9) for name in zero)
    # Nine tenths of the points are the surface's own corners.
    assert report.twin["point_to_mesh_median_m"].mean == pytest.approx(0, abs=1e-7)
    assert told == sorted(told)
    assert told[-1] == 1
    compare(real, real, tmp_path / "b", arbitrary=None)
    for name in ("report.json", "report.png", "report.html"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.mark.usefixtures("no_page")
def test_pairs_and_notes(tmp_path):
    real = write_folder(tmp_path / "real", 12)
    synthetic = write_folder(tmp_path / "synthetic", 3, shift=0.5, columns=3)
    report = compare(real, synthetic, tmp_path / "out", arbitrary=write_folder(tmp_path / "x", 1))
    # frame_2 and not frame_10 is the third.
    assert [frame.real for frame in report.frames] == ["frame_0.npy", "frame_1.npy", "frame_2.npy"]
    assert report.twin["js_intensity"] is None
    assert report.twin["js_mean"].frames == 3
    assert report.arbitrary["js_mean"].frames == 1
    assert report.arbitrary["js_mean"].mean_ci95 is None
    assert report.reduction_percent["js_intensity"] is None
    notes = "\n".join(report.notes)
    assert "real: 9 further clouds" in notes
    assert "synthetic: has no intensity" in notes
    assert "arbitrary: only 1 clouds" in notes
    low, high = report.twin["js_mean"].mean_ci95
    assert low <= report.twin["js_mean"].mean <= high


@pytest.mark.usefixtures("no_page")
def test_a_bad_frame_is_named_and_the_rest_compared(tmp_path):
    real = write_folder(tmp_path / "real", 3)
    synthetic = write_folder(tmp_path / "synthetic", 3)
    (synthetic / "frame_1.npy").write_bytes((synthetic / "frame_1.npy").read_bytes()[:900])
    np.save(real / "frame_2.npy", np.full((5, 4), np.nan, np.float32))
    report = compare(real, synthetic, tmp_path / "out", arbitrary=None)
    assert [frame.real for frame in report.frames] == ["frame_0.npy"]
    assert len(report.problems) == 2
    assert "frame_1.npy" in "".join(report.problems)

    before = sorted(tmp_path.rglob("*"))
    np.save(synthetic / "frame_0.npy", np.zeros((5, 4), np.float32))
    with pytest.raises(InputError, match="no pair"):
        compare(real, synthetic, tmp_path / "none", arbitrary=None)
    with pytest.raises(InputError, match="is also an input"):
        compare(real, real, real, arbitrary=None)
    assert sorted(tmp_path.rglob("*")) == before


def corner(rng, car_at):
    """Return a street corner as a fixed sensor meets it, and a car somewhere on the street."""
    same = np.random.default_rng(99)  # the beams: where they go is the same in every frame
    street = same.uniform([-25, -25, -4], [25, 25, -4], (2500, 3))
    wall = same.uniform([-10, 12, -4], [20, 12, 4], (1500, 3))
    still = np.concatenate([street, wall])
    car = rng.uniform([-2.2, -0.9, -3.9], [2.2, 0.9, -2.5], (300, 3)) + [*car_at, 0]
    return np.concatenate([still + rng.normal(scale=0.02, size=still.shape), car])


def write_corner(folder, seed, lacks=0.0, turn=0.0, late=0.0, count=5):
    folder.mkdir()
    rng = np.random.default_rng(seed)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    for index in range(count):
        points = corner(rng, (-20 + 8 * index, -4 + late))
        points = points[points[:, 0] < 25 - lacks]
        points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
        np.save(folder / f"{index}.npy", points.astype(np.float32))
    return folder


@pytest.mark.usefixtures("no_page")
def test_actors_are_told_apart_and_what_lacks_is_found(tmp_path):
    real = write_corner(tmp_path / "real", 0)
    # The twin's cars drive 1.5 m to the side; of its street the last 10 m are missing.
    twin = write_corner(tmp_path / "twin", 1, lacks=10.0, late=1.5)
    report = compare(real, twin, tmp_path / "out", arbitrary=None)
    assert report.split_by == "background model"
    actors, still = (report.parts[part].twin for part in ("foreground", "background"))
    assert 1.2 < actors["hausdorff_p95_m"].mean < 2.5
    assert still["hausdorff_p95_synthetic_to_real_m"].mean < 1.5
    # 10 of 50 m of the street lie up to 10 m from the twin's: the 95th percentile is beyond 5.
    assert 5 < still["hausdorff_p95_real_to_synthetic_m"].mean < 10
    for place in report.missing[:5]:
        assert place["x"] > 15
        assert place["distance_m"] > 0.5
    assert not any("rotated" in note for note in report.notes)


@pytest.mark.thorough
@pytest.mark.usefixtures("no_page")
def test_a_turned_recording_is_told(tmp_path):
    real = write_corner(tmp_path / "real", 0, count=1)
    report = compare(
        write_corner(tmp_path / "twin", 1, turn=90, count=1), real, tmp_path / "out", arbitrary=None
    )
    assert [note for note in report.notes if "look rotated by 90 degrees" in note]


@pytest.mark.usefixtures("no_page")
def test_real_against_real_of_other_frames_within_a_box(tmp_path):
    rng = np.random.default_rng(11)
    for name, far in (("real", 0.0), ("earlier", 0.1), ("twin", 0.3)):
        (tmp_path / name).mkdir()
        for frame in range(2):
            near = rng.uniform([5, -5, -1], [9, 5, 1], (400, 3)) + [far, 0, 0]
            beyond = rng.uniform([30, -5, -1], [40, 5, 1], (400, 3)) * (1 + far)
            np.save(tmp_path / name / f"{frame}.npy", np.concatenate([near, beyond])[:, :3])
    asked = {"arbitrary": None, "within": (10, 6, 2)}
    real, anchor, protocol = tmp_path / "real", tmp_path / "earlier", "urbantwin-challenge"
    report = compare(
        real, tmp_path / "twin", tmp_path / "a", anchor=anchor, protocol=protocol, **asked
    )
    # What is told of the anchor is what its frames beside the real ones have, cropped by hand.
    found = []
    for frame in range(2):
        pair = [np.load(folder / f"{frame}.npy")[:400] for folder in (real, anchor)]
        found.append(RealFrame(Frame(pair[0])).measure(Frame(pair[1])).figures)
    for name in ("hausdorff_p95_m", "js_range", "chamfer_m"):
        expected = np.mean([one[name] for one in found])
        assert report.real_against_real[name].mean == pytest.approx(expected, abs=1e-12)
    assert report.twin["chamfer_m"].mean > report.real_against_real["chamfer_m"].mean
    assert all(frame.points["real"]["compared"] == 400 for frame in report.frames)
    scores = report.protocol["scores"]
    assert set(scores) == {"twin", "twin_fitted", "real_against_real"}
    assert any("not between neighbours" in note for note in report.notes)
    with pytest.raises(InputError, match="are no half extents"):
        compare(real, anchor, tmp_path / "c", within=(10, 0, 2))
    with pytest.raises(InputError, match="no point within"):
        compare(real, anchor, tmp_path / "c", within=(1, 1, 1), arbitrary=None)
