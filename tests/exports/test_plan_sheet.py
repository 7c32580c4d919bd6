"""The plan of a real place: legible, complete, the same every time."""

import itertools
import re
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from shapely.affinity import rotate

from urbantwin.drawing.pictures import title_of
from urbantwin.drawing.plan import plan_figure
from urbantwin.drawing.plan_style import PAPER
from urbantwin.errors import InputError
from urbantwin.exports import export_twin

from ..thorough import further


def figure_of(twin):
    sensors = [(one.name, one.east_m, one.north_m) for one in twin.rig_spec().sensors]
    return plan_figure(
        twin.roads, twin.region, model=twin.lane_model, sensors=sensors, title=title_of(twin),
        look=PAPER,
    )  # fmt: skip


def boxes(figure):
    """Every text on the sheet with the pixels that it covers, turned as it is."""
    figure.draw_without_rendering()  # which sets the legend out
    renderer = figure.canvas.get_renderer()
    found = []
    for text in [*figure.texts, *figure.axes[0].texts, *figure.legends[0].get_texts()]:
        if not text.get_text():
            continue
        angle = text.get_rotation()
        text.set_rotation(0)
        box = text.get_window_extent(renderer)
        text.set_rotation(angle)
        x, y = text.get_transform().transform(text.get_unitless_position())
        flat = shapely.box(box.x0 + 1, box.y0 + 1, box.x1 - 1, box.y1 - 1)
        found.append((text.get_text(), rotate(flat, angle, origin=(x, y))))
    return found


@pytest.mark.parametrize("name", ["small_twin", *further("perth_twin")])
def test_no_text_covers_another_or_leaves_the_sheet(request, name):
    twin = request.getfixturevalue(name)
    figure = figure_of(twin)
    found = boxes(figure)
    sheet = shapely.box(0, 0, *figure.canvas.get_width_height())
    for (one, first), (other, second) in itertools.combinations(found, 2):
        assert not first.intersects(second), (one, other)
    for text, box in found:
        assert sheet.covers(box), text
    named = {road.name for road in twin.roads.roads if road.name}
    assert named & {text for text, _ in found}
    # Names stand beside the lanes, not on them.
    axes = figure.axes[0]
    for text, box in found:
        if text in named:
            on_map = shapely.transform(box, axes.transData.inverted().transform)
            assert on_map.intersection(twin.roads.carriageway(0)).area < 0.25 * on_map.area, text


@pytest.mark.thorough
def test_svg_and_png_are_the_same_every_time(small_twin, tmp_path):
    for name in ("one", "two"):
        export_twin(small_twin, "plan", tmp_path / name)
    export_twin(small_twin, "plan", tmp_path / "alone.svg")
    for name in ("plan.svg", "plan.png", "plan.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    svg = (tmp_path / "one" / "plan.svg").read_text()
    assert (tmp_path / "alone.svg").read_text() == svg
    assert not re.search(r"\b20\d\d-\d\d-\d\d|matplotlib v", svg)
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    picture = imread(tmp_path / "one" / "plan.png")
    assert min(picture.shape[:2]) >= 1500


def test_stop_lines_zebras_and_signals_are_on_the_sheet(small_twin, tmp_path):
    twin = small_twin
    figure = figure_of(twin)
    export_twin(twin, "plan", tmp_path / "plan.png")
    picture = imread(tmp_path / "plan.png")[..., :3]
    to_pixel = figure.axes[0].transData.transform

    def colour(x, y):
        column, row = to_pixel((x, y))
        return picture[len(picture) - 1 - round(row), round(column)]

    # Across a zebra, half of the way is paint; between lines and studs it is brighter than a road.
    crossings = [lane for lane in twin.roads.lanes if lane.kind == "crossing"]
    asphalt = np.array(to_rgb(PAPER.lanes["driving"]))
    assert crossings
    for lane in crossings:
        if twin.region.contains(lane.polygon):
            line = shapely.LineString(lane.centre[:, :2])
            places = [line.interpolate(s).coords[0] for s in np.arange(1.0, line.length - 1, 0.1)]
            seen = np.array([colour(*place) for place in places])
            if lane.marking == "zebra":
                assert 0.35 < np.mean(seen.min(axis=1) > 0.9) < 0.65
            else:
                assert np.mean((seen > asphalt + 0.02).all(axis=1)) > 0.8
    red = np.array([211, 40, 28]) / 255
    close = np.abs(picture - red).max(axis=2) < 0.1
    assert close.sum() > 20 * len({head.lane for head in twin.roads.signals})


def test_what_stands_in_the_way_is_left_alone(small_twin, tmp_path):
    (tmp_path / "mine").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        export_twin(small_twin, "plan", tmp_path / "mine")
    (tmp_path / "folder.svg").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        export_twin(small_twin, "plan", tmp_path / "folder.svg")
    assert (tmp_path / "mine").read_text() == "mine"
