"""Two sides with one camera: pairs, distances by scipy's tree, the worst places of a report."""

import json
import shutil

import numpy as np
import pytest
from scipy.spatial import cKDTree

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.web import open_shown
from urbantwin.web.beside import farthest_place, pairs_of_sides, worst_places
from urbantwin.web.chosen_frames import ChosenFrames
from urbantwin.web.side import FrameEntry
from urbantwin.web.wanted import Wanted


def places(shown, unpacked, name):
    header, arrays = unpacked(shown.packet(name))
    return np.array(header["origin"]) + header["step"] * arrays["position"], arrays


@pytest.fixture(scope="module")
def real(dataset, tmp_path_factory):
    """Clouds without labels, 5 frames, as a stranger may have them; a blob stands out of one."""
    folder = tmp_path_factory.mktemp("pair") / "real"
    folder.mkdir()
    for index in range(5):
        points = np.load(dataset / "points" / f"{index:06d}.npy")
        if index == 3:
            blob = np.tile([-9.0, -9.0, 2.0, 0.5], (400, 1)).astype("f4")
            blob[:, :3] += np.random.default_rng(1).normal(0, 0.1, (400, 3))
            points = np.vstack([points, blob])
        np.save(folder / f"sweep_{index}.npy", points)
    return folder


def test_each_point_knows_how_far_the_other_side_is(real, dataset, unpacked):
    shown = open_shown(Wanted(real, dataset))
    document = shown.document()
    assert document["kind"] == "pair"
    assert document["scene_frame"] == "points"
    assert [side["role"] for side in document["sides"]] == ["real", "synthetic"]
    assert document["pairs"] == [[index, index] for index in range(5)]
    first, second = np.load(real / "sweep_3.npy"), np.load(dataset / "points" / "000003.npy")
    here, arrays = places(shown, unpacked, "points/0/3")
    assert np.allclose(here, first[:, :3], atol=3e-3)
    assert np.allclose(arrays["away"], cKDTree(second[:, :3]).query(first[:, :3])[0], atol=1e-4)
    there, arrays = places(shown, unpacked, "points/1/3")
    assert np.allclose(there, second[:, :3], atol=3e-3)
    assert np.allclose(arrays["away"], cKDTree(first[:, :3]).query(second[:, :3])[0], atol=1e-4)


def test_the_twin_stands_where_the_points_are(real, dataset, unpacked):
    shown = open_shown(Wanted(real, dataset))
    corners, _ = places(shown, unpacked, "twin")
    manifest = json.loads((dataset / "dataset.json").read_text())
    dataset_SE3_site = np.array(manifest["dataset_SE3_site"])
    wanted = (dataset_SE3_site @ [25.0, 20.0, 6.0, 1.0])[:3]
    assert np.linalg.norm(corners - wanted, axis=1).min() < 3e-3
    assert np.allclose(
        shown.sensors[-1]["pose"],
        (dataset_SE3_site @ manifest["rig"]["sensors"][0]["site_SE3_sensor"]).ravel(),
        atol=1e-6,
    )


def test_a_report_lists_its_worst_places_and_leads_to_its_sides(real, dataset, tmp_path):
    shutil.copytree(real, tmp_path / "real")
    shutil.copytree(dataset, tmp_path / "dataset", ignore=lambda *_: ["pictures"])
    report = tmp_path / "report"
    ut.compare(
        tmp_path / "real", tmp_path / "dataset", report, arbitrary="none", workers=1,
        progress=False,
    )  # fmt: skip
    for wanted in (
        Wanted(tmp_path / "report"),
        Wanted(tmp_path / "real", tmp_path / "dataset", report=tmp_path / "report"),
    ):
        shown = open_shown(wanted)
        worst = [one for one in shown.worst if one["text"].startswith("frame ")]
        assert np.linalg.norm(np.array(worst[0]["at"]) - [-9.0, -9.0, 2.0]) < 1.0
        assert worst[0]["frame"] == 3
        assert next(one["frame"] for one in shown.events if one["kind"] == "worst pair") == 3
    page = (tmp_path / "report" / "report.html").read_text()
    assert "urbantwin view real dataset --report report" in " ".join(page.split())
    shutil.rmtree(tmp_path / "real")
    with pytest.raises(InputError, match="which is not beside it"):
        open_shown(Wanted(tmp_path / "report"))


def test_two_datasets_of_a_site_are_paired_by_time(dataset, unpacked):
    shown = open_shown(Wanted(dataset, dataset, frames=ChosenFrames.of("2:6", 2)))
    assert shown.pairs == [(0, 0), (1, 1)]
    assert shown.scene_frame == "site"
    _, arrays = places(shown, unpacked, "points/0/1")
    assert (arrays["away"] == 0).all()


def test_pairs_go_by_name_then_time_then_number():
    def entries(names, begin=0.0):
        return [FrameEntry(name, begin + 0.1 * index) for index, name in enumerate(names)]

    assert pairs_of_sides(entries("abcd"), entries("bcde"), same_clock=False) == [
        (1, 0), (2, 1), (3, 2),
    ]  # fmt: skip
    assert pairs_of_sides(entries("abc"), entries("xyz", 0.1), same_clock=True) == [(1, 0), (2, 1)]
    assert pairs_of_sides(entries("abc"), entries("wxyz"), same_clock=False) == [
        (0, 0), (1, 1), (2, 2),
    ]  # fmt: skip
    # The same names of other times are not the same frames.
    assert pairs_of_sides(entries("abc"), entries("abc", 0.1), same_clock=True) == [(1, 0), (2, 1)]


def test_the_worst_place_is_where_most_is_far():
    points = np.array([[0, 0, 0], [0.1, 0, 0], [9, 9, 1], [9.2, 9, 1], [30, 0, 0]], float)
    away = np.array([0.1, 0.1, 2.0, 2.0, 3.0])
    assert np.allclose(farthest_place(points, away), [9.1, 9, 1])


def test_what_does_not_go_together_is_refused(place, dataset):
    with pytest.raises(InputError, match="is a twin"):
        open_shown(Wanted(dataset, place / "twin"))


def test_a_map_s_coordinates_come_near_both_sides_alike(real, tmp_path, unpacked):
    far = np.array([583_710.25, 4_477_260.5, 32.0])
    for name, more in (("one", 0.0), ("two", 0.125)):
        (tmp_path / name).mkdir()
        for index in range(2):
            points = np.load(real / f"sweep_{index}.npy").astype(float)
            points[:, :3] += far + [more, 0, 0]
            np.save(tmp_path / name / f"{index}.npy", points)
    shown = open_shown(Wanted(tmp_path / "one", tmp_path / "two"))
    for index in range(2):
        wanted = np.load(real / f"sweep_{index}.npy")[:, :3]
        first, arrays = places(shown, unpacked, f"points/0/{index}")
        second, _ = places(shown, unpacked, f"points/1/{index}")
        assert np.abs(first).max() < 500.0  # 24 bits of the page's numbers are enough there
        assert np.allclose(first - first[0], wanted - wanted[0], atol=6e-3)
        assert np.allclose(second - first, [0.125, 0, 0], atol=6e-3)
        assert arrays["away"].max() <= 0.126
    assert np.abs(shown.ground_z) < 100


@pytest.mark.parametrize("number", [float("nan"), float("inf"), "nan", "x", None])
def test_a_report_with_a_place_that_is_none_is_refused(number):
    place = {
        "x": 1.0,
        "y": 2.0,
        "low": 0.0,
        "high": 1.0,
        "points_per_frame": 3.0,
        "distance_m": 0.5,
    }
    report = {"missing": [{**place, "x": number}], "frames": []}
    with pytest.raises(InputError, match="figures of another form"):
        worst_places(report, [(0, 0)], [FrameEntry("1", 0.0)], None, lambda *_: None)
