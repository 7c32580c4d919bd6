"""What does not count, as pictures show it; maps of coverage where they stand."""

import dataclasses

import matplotlib as mpl
import numpy as np
import pytest
import shapely
from matplotlib.collections import PatchCollection, PolyCollection
from PIL import Image

from urbantwin.drawing.birdseye import birdseye_figure
from urbantwin.drawing.coverage import coverage_figure, coverage_picture
from urbantwin.drawing.labelled_frame import LabelledPoints, SensorPlace
from urbantwin.geometry import Pose
from urbantwin.lidar.sight import Coverage
from urbantwin.lidar.sight.cells import Cells


@pytest.fixture
def frame():
    boxes = np.array([[10, 0, 1, 4, 2, 1.5, 0.3], [0, 12, 1, 4, 2, 1.5, 1.0]], float)
    return LabelledPoints(
        "000001",
        0.1,
        np.array([[10, 0, 1, 0.5], [5, 5, 0, 0.1], [-20, -20, 0, 0.1]], np.float32),
        np.array([10, 40, 40]),
        np.array([1, 0, 0]),
        boxes,
        ("car", "car"),
        np.array([30, 2]),
        (SensorPlace("pole", "M", 8, np.zeros(2), Pose.from_ypr(np.zeros(3))),),
        difficulty=("easy", None),
        ignored={"unseen": shapely.box(-20, 2, -10, 8)},
    )


def boxes_of(figure):
    """Pattern of dashes (None: unbroken) and opacity of the outline of each box."""
    (boxes,) = [one for one in figure.axes[0].collections if type(one) is PolyCollection]
    dashes = [dash for _, dash in boxes.get_linestyle()]
    return list(zip(dashes, boxes.get_edgecolor()[:, 3], strict=True))


def test_boxes_that_do_not_count_are_broken_and_fainter(frame):
    counts, ignored = boxes_of(birdseye_figure(frame, reach_m=25))
    assert counts[0] is None
    assert ignored[0] is not None
    assert counts[1] > ignored[1]
    # Of a dataset without levels, the points on a box tell.
    old = dataclasses.replace(frame, difficulty=(), box_points=np.array([0, 2]))
    first, second = boxes_of(birdseye_figure(old, reach_m=25))
    assert first[0] is not None
    assert second[0] is None


def test_areas_that_do_not_count_are_hatched_where_they_are(frame):
    figure = birdseye_figure(frame, reach_m=25)
    (hatched,) = [
        one
        for one in figure.axes[0].collections
        if isinstance(one, PatchCollection) and one.get_hatch()
    ]
    (path,) = hatched.get_paths()
    low, high = path.vertices.min(axis=0), path.vertices.max(axis=0)
    assert (*low, *high) == (-20, 2, -10, 8)
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert {"easy", "unseen", "60 m²"} <= set(texts)


def test_coverage_is_drawn_where_it_is(tmp_path):
    shape = (40, 60)
    cells = Cells(-30.0, -20.0, 1.0, np.zeros((41, 61)), np.full(shape, 40, np.uint16))
    layers = {name: np.zeros((1, *shape), np.float32) for name in ("ground", "lying", "facing")}
    layers["ground"][0, 30:34, 50:56] = 1000.0  # 100 per frame; x 20 to 26, y 10 to 14.
    coverage = Coverage(cells, ("one",), 10.0, **layers)
    sensors = [("one", 0.0, 0.0)]
    path = coverage_picture(coverage, tmp_path / "a.png", sensors=sensors, attribution="© me")
    figure = coverage_figure(coverage, sensors=sensors)
    with Image.open(path) as image:
        picture = np.asarray(image.convert("RGB"), float)
    height, width = picture.shape[:2]
    map_of = figure.axes[0]
    expected = np.array(mpl.colormaps["viridis"](0.12 + 0.88 * 2 / 3)[:3]) * 255

    def colour(axes, x, y):
        right, up = axes.transData.transform((x, y)) / (100 * figure.get_size_inches())
        return picture[int((1 - up) * height), int(right * width)]

    np.testing.assert_allclose(colour(map_of, 23, 12), expected, atol=6)
    for axes, x, y in ((map_of, 23, 16), (map_of, 17, 12), (figure.axes[1], 23, 12)):
        assert colour(axes, x, y).max() < 60
    before = path.read_bytes()
    coverage_picture(coverage, path, sensors=sensors, attribution="© me")
    assert path.read_bytes() == before


def test_an_empty_map_is_drawn_all_the_same(tmp_path):
    cells = Cells(0.0, 0.0, 1.0, np.zeros((3, 3)), np.zeros((2, 2), np.uint16))
    nothing = np.zeros((1, 2, 2), np.float32)
    coverage = Coverage(cells, ("one",), 10.0, nothing, nothing, nothing)
    assert coverage_picture(coverage, tmp_path / "a.png").stat().st_size > 5000
