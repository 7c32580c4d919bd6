"""Pictures show what is there, where it is, and come out the same every time."""

import json
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from PIL import Image

from urbantwin.dataset.card import PICTURES
from urbantwin.drawing import style
from urbantwin.drawing.birdseye import birdseye, birdseye_figure
from urbantwin.drawing.histogram import histogram
from urbantwin.drawing.labelled_frame import (
    LabelledPoints,
    SensorPlace,
    read_labelled_points,
)
from urbantwin.drawing.markings import markings
from urbantwin.drawing.pictures import figure_of_twin, pictures_of_dataset, pictures_of_twin
from urbantwin.drawing.plan import plan, plan_figure
from urbantwin.drawing.plan_style import DARK
from urbantwin.drawing.range_image import range_image, spread_rays
from urbantwin.drawing.scene import Camera, render, scene_picture
from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.processes import helpers
from urbantwin.roads import Junction, Lane, Road, RoadNetwork, SignalHead
from urbantwin.roads.marking import zebra
from urbantwin.scene.surface import PARTS
from urbantwin.taxonomy import material_id, semantic_classes, semantic_id

from ..box_tables import write_table
from ..interface.conftest import line

__all__ = ["line"]

COLUMNS = 90
ELEVATION_DEG = np.array([-30.0, -10.0, -20.0, 0.0])  # channels not in the order of their height


def frame_of_one_car(**changes):
    """A car at (10, 5) heading up, ground points under a sensor that is 4 m high and turned."""
    place = Pose.from_ypr([1.0, 2.0, 4.0], yaw=0.6)
    ring, column = (
        grid.ravel() for grid in np.meshgrid(np.arange(3), np.arange(COLUMNS), indexing="ij")
    )
    elevation = np.radians(ELEVATION_DEG[ring])
    # Each channel looks a little aside of the encoder's angle.
    azimuth = np.pi - (column + 0.3 * ring) / COLUMNS * 2 * np.pi
    beams = np.column_stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    points = place.apply(beams * (4.0 / -np.sin(elevation))[:, None])
    semantic = np.full(len(points), semantic_id("terrain"))
    semantic[7] = semantic_id("car")
    given = {
        "name": "000003",
        "time_s": 0.3,
        "points": np.column_stack([points, np.ones(len(points))]).astype(np.float32),
        "semantic": semantic,
        "instance": np.where(semantic == semantic_id("car"), 5, 0),
        "boxes": np.array([[10.0, 5.0, 0.75, 4.0, 2.0, 1.5, np.pi / 2]]),
        "classes": ("car",),
        "box_points": np.array([1]),
        "sensors": (SensorPlace("pole", "MODEL", COLUMNS, ELEVATION_DEG, place),),
        "sensor": np.zeros(len(points), int),
        "ring": ring,
        "column": column,
    }
    return LabelledPoints(**{**given, **changes})


def pixels_of(path, figure, xy):
    """Return the colours (N, 3) of a written picture at places (N, 2) of its first axes."""
    picture = imread(path)[..., :3]
    columns, rows = figure.axes[0].transData.transform(np.asarray(xy, float)).T
    return picture[len(picture) - 1 - np.round(rows).astype(int), np.round(columns).astype(int)]


def near(colours, colour, within=0.12):
    return np.abs(np.asarray(colours) - to_rgb(colour)).max(axis=-1) < within


def test_a_box_is_drawn_where_it_is(tmp_path):
    frame = frame_of_one_car()
    path = birdseye(frame, tmp_path / "a.png", reach_m=20)
    figure = birdseye_figure(frame, reach_m=20)
    car = style.actor_colour("car")
    # Heading along +y, so 4 m in y and 2 m in x: the middles of its four sides, and its nose.
    sides = [(9, 5.5), (11, 5.5), (10.4, 3), (10.4, 7)]
    assert near(pixels_of(path, figure, sides), car, 0.25).all()
    assert near(pixels_of(path, figure, [(10, 7.6)]), car, 0.25).all()
    beside = [(8.5, 5.5), (11.5, 5.5), (10.4, 2.5), (10, 2.4)]
    assert not near(pixels_of(path, figure, beside), car, 0.25).any()
    # The sensor's ring at its place.
    x, y = (
        figure.axes[0]
        .transData.inverted()
        .transform(figure.axes[0].transData.transform((1.0, 2.0)) + [3.5, 0])
    )
    assert near(pixels_of(path, figure, [(x, y)]), style.ACCENT).all()


def test_birdseye_points_have_their_class_colour(tmp_path):
    frame = frame_of_one_car()
    path = birdseye(frame, tmp_path / "a.png", reach_m=30)
    figure = birdseye_figure(frame, reach_m=30)
    terrain = style.class_colours([semantic_id("terrain")])[0]
    seen = pixels_of(path, figure, frame.points[(frame.ring == 1) & (frame.column > 10), :2])
    # Points are about a pixel large, so antialiasing dims them.
    assert np.median(seen[:, 1]) > 0.5
    assert (seen[:, 1] > seen[:, 2] + 0.15).mean() > 0.6
    assert terrain[1] > terrain[2]


@pytest.mark.parametrize("known_rays", [True, False])
def test_frame_without_objects_or_points(tmp_path, known_rays):
    nothing = {
        "points": np.zeros((0, 4), np.float32),
        "semantic": np.zeros(0, int),
        "instance": np.zeros(0, int),
        "boxes": np.zeros((0, 7)),
        "classes": (),
        "box_points": np.zeros(0, int),
    }
    rays = {name: np.zeros(0, int) if known_rays else None for name in ("sensor", "ring", "column")}
    frame = frame_of_one_car(**nothing, **rays)
    assert birdseye(frame, tmp_path / "a.png").stat().st_size > 5000
    with pytest.raises(InputError, match="has no points"):
        range_image(frame, tmp_path / "b.png")
    with pytest.raises(InputError, match="no sensor 3"):
        range_image(frame, tmp_path / "b.png", sensor=3)


def test_range_image_has_every_ray_in_its_cell():
    frame = frame_of_one_car()
    image = spread_rays(frame)
    assert image.range_m.shape == (4, COLUMNS)
    np.testing.assert_allclose(np.degrees(image.elevation), [0, -10, -20, -30])
    # Level rays meet no ground; each other cell is filled once, with the range of its channel.
    assert np.isnan(image.range_m[0]).all()
    for row, degrees in ((1, 10.0), (2, 20.0), (3, 30.0)):
        np.testing.assert_allclose(image.range_m[row], 4 / np.sin(np.radians(degrees)), rtol=1e-5)
    # The car's point is column 7 of channel 0, which looks lowest: the last row.
    assert np.argwhere(image.semantic == semantic_id("car")).tolist() == [[3, 7]]


def test_range_image_of_a_pattern_stands_where_its_points_are():
    """A pattern's ring and column are no directions: cells come from the points themselves."""
    frame = frame_of_one_car()
    (place,) = frame.sensors
    rose = replace(place, columns=9000, elevation_deg=np.zeros(1), has_pattern=True)
    image = spread_rays(
        frame_of_one_car(
            sensors=(rose,), ring=0 * frame.ring, column=np.arange(len(frame.points)) * 30
        )
    )
    rows, columns = np.nonzero(np.isfinite(image.range_m))
    assert len(rows) == len(frame.points)
    azimuth = 180 - columns * 360 / image.range_m.shape[1]
    assert azimuth.min() < -170 < 170 < azimuth.max()
    # Under a sensor 4 m high the range tells the elevation.
    step = np.degrees(image.elevation[0] - image.elevation[1])
    down = np.degrees(np.arcsin(4 / image.range_m[rows, columns]))
    assert np.abs(down + np.degrees(image.elevation[rows])).max() < step


def test_range_image_without_known_rays():
    frame = frame_of_one_car(ring=None, column=None, sensor=None)
    image = spread_rays(frame)
    assert np.isfinite(image.range_m).sum() == len(frame.points)
    assert np.argwhere(image.semantic == semantic_id("car"))[0, 1] in (7, 8)


def test_range_image_picture(tmp_path):
    path = range_image(frame_of_one_car(), tmp_path / "a.png", attribution="whose data")
    picture = imread(path)[..., :3]
    assert picture.shape == (840, 1600, 3)
    terrain = style.class_colours([semantic_id("terrain")])[0]
    # The lower image: three of four rows are terrain, between 12.5 % and 46 % of the height.
    lower = picture[int(840 * 0.56) : int(840 * 0.91), 100:1480]
    assert near(lower, terrain, 0.02).mean() > 0.7


def street(driving_side="right"):
    """Two lanes to the east and one to the west of 3 m, a zebra at x = 20, one signal."""

    def lane(name, kind, y, x0, x1, width=3.0, road=""):
        centre = np.array([[x0, y, 0.0], [x1, y, 0.0]])
        outline = np.zeros((0, 2))
        return Lane(name, road, kind, width, 13.9, centre, outline, 0, (), (), "")

    crossing = Lane(
        "c",
        "",
        "crossing",
        4.0,
        1.4,
        np.array([[20.0, -4.5, 0], [20, 4.5, 0]]),
        np.zeros((0, 2)),
        0,
        (),
        (),
        "j",
    )
    lanes = (
        lane("e0", "driving", -3.0, -40, 18, road="e"),
        lane("e1", "driving", 0.0, -40, 18, road="e"),
        lane("w0", "driving", 3.0, 18, -40, road="w"),
        lane("s", "sidewalk", -6.0, -40, 40, road="e"),
        crossing,
    )
    corner = np.array([[18.0, -4.5], [40, -4.5], [40, 4.5], [18, 4.5]])
    return RoadNetwork(
        driving_side,
        (
            Road("e", "High Street", (1,), "primary", ("s", "e0", "e1"), "a", "j"),
            Road("w", "High Street", (1,), "primary", ("w0",), "j", "a"),
        ),
        lanes,
        (Junction("j", "traffic_light", corner, 0),),
        (SignalHead("j", (0,), "e0", 17.0, -3.0, 0.0),),
        (),
    )


def ground(size=60.0, z=0.1):
    corners = np.array([[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]])
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )


def test_zebra_stripes_lie_across_the_way():
    (crossing,) = (lane for lane in street().lanes if lane.kind == "crossing")
    stripes = np.array(zebra(crossing))
    assert len(stripes) == 9  # 9 m of half a metre painted, half bare, even at both ends
    np.testing.assert_allclose(stripes[..., 0].min(axis=1), 18)
    np.testing.assert_allclose(stripes[..., 0].max(axis=1), 22)
    np.testing.assert_allclose(np.ptp(stripes[..., 1], axis=1), 0.5)
    np.testing.assert_allclose(stripes[..., 1].mean(), 0, atol=1e-12)


@pytest.mark.parametrize(("side", "border"), [("right", -1.5), ("left", -4.5)])
def test_paint_lies_between_lanes_and_above_the_ground(side, border):
    paint = markings(street(side), ground())
    assert np.allclose(paint.vertices[:, 2], 0.1 + 0.025)
    y = paint.triangles().mean(axis=1)[:, 1]
    length = np.ptp(paint.triangles()[..., 0], axis=1)
    # Lanes are listed from the kerb: the border of e0 towards e1 is on its inner side.
    np.testing.assert_allclose(y[np.isclose(length, 3.0)], border, atol=0.1)
    stop = paint.triangles()[np.isclose(length, 0.4)]
    np.testing.assert_allclose([stop[..., 1].min(), stop[..., 1].max()], [-4.5, -1.5])
    # 9 stripes of 4 x 0.5 m, dashes of 3 x 0.15 m and a stop line of 3 x 0.4 m.
    dashes = int(np.isclose(length, 3.0).sum() // 2)
    assert dashes == 6  # on 58 m, after 3 m and then every 9 m
    assert paint.areas().sum() == pytest.approx(9 * 2.0 + dashes * 0.45 + 1.2)
    assert len(markings(street(side), ground(size=1.0)).faces) == 0


def test_plan_shows_lanes_zebra_and_sensor(tmp_path):
    region = shapely.Point(0, 0).buffer(50)
    house = LabelledMesh.build(
        [[-20, 20, 9], [0, 20, 9], [0, 40, 9], [-20, 40, 9]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("building"),
        material_id("brick"),
    )
    island = LabelledMesh.build(
        [[-30, -25, 0.1], [-20, -25, 0.1], [-20, -20, 0.1], [-30, -20, 0.1]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("other-ground"),
        material_id("concrete"),
        PARTS["island"],
    )
    mesh = LabelledMesh.concatenate([house, island])
    given = {"mesh": mesh, "sensors": [("s", 0.0, 12.0)], "title": "Here"}
    path = plan(street(), region, tmp_path / "a.png", **given)
    figure = plan_figure(street(), region, **given)

    def at(x, y):
        return pixels_of(path, figure, [(x, y)])[0]

    assert near(at(-10, -3.9), DARK.lanes["driving"], 0.03)  # a lane beside its arrow
    assert near(at(-30, -6.0), DARK.lanes["sidewalk"], 0.03)
    assert near(at(30, 2.0), DARK.lanes["junction"], 0.03)
    assert near(at(20, 0.0), DARK.paint, 0.05)  # a stripe of the zebra
    assert near(at(20, 0.5), DARK.lanes["junction"], 0.08)  # between two stripes
    assert near(at(-10, 30), DARK.building, 0.03)
    assert near(at(-25, -22), DARK.lanes["island"], 0.03)
    assert near(at(0.5, 12), DARK.sensor, 0.05)
    assert near(at(-30, -30), DARK.ground, 0.03)  # nothing
    assert near(at(17.0, -3.0), DARK.signal, 0.05)
    # The border of the two lanes to the east is broken: three metres of line, six of gap.
    border = near(
        pixels_of(path, figure, [(x, -1.5) for x in np.arange(-39, 17, 0.25)]), "#ffffff", 0.3
    )
    assert 0.25 < border.mean() < 0.45
    assert np.abs(np.diff(border.astype(int))).sum() == 14  # 7 dashes on 58 m


def test_histogram_bars_have_lengths_of_their_logarithms(tmp_path):
    names = ["road", "building", "car"]
    path = histogram(
        {"road": 10000, "building": 100, "car": 0}, {"car": 100}, {"car": 10}, tmp_path / "a.png"
    )
    picture = imread(path)[..., :3]
    left = picture[:, : picture.shape[1] // 2]
    lengths = [
        near(left, style.class_colours([semantic_id(name)])[0], 0.02).any(axis=0).sum()
        for name in names
    ]
    # From 0.8 on a logarithmic scale; a class without points has no bar.
    expected = np.log(10000 / 0.8) / np.log(100 / 0.8)
    assert lengths[0] / lengths[1] == pytest.approx(expected, rel=0.02)
    assert lengths[2] == 0
    histogram({}, {}, {}, tmp_path / "b.png")


def test_colours_are_the_taxonomys_or_lighter():
    for one in semantic_classes().values():
        colour = style.class_colours([one.id])[0] * 255
        assert (colour >= np.array(one.colour) - 1e-9).all()
        assert colour @ [0.299, 0.587, 0.114] >= 89.9


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Moosacher Straße / Ñ", "Moosacher Straße / Ñ"),
        ("Советская улица", "Советская улица"),
        ("中山北路 / 南京西路", ""),
        ("16 中山 Road", "16 Road"),
    ],
)
def test_text_without_glyphs_is_left_out(text, shown, tmp_path):
    assert style.legible(text) == shown
    # matplotlib warns of a missing glyph, and warnings are errors here.
    birdseye(frame_of_one_car(), tmp_path / "a.png", title=text, attribution=[text, text])


def block(x, y, size, height):
    """A closed box standing on z = 0."""
    s = size / 2
    low = np.array([[x - s, y - s], [x + s, y - s], [x + s, y + s], [x - s, y + s]])
    vertices = np.vstack([np.c_[low, np.zeros(4)], np.c_[low, np.full(4, height)]])
    faces = [[4, 5, 6], [4, 6, 7]]
    for a in range(4):
        b = (a + 1) % 4
        faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    return LabelledMesh.build(vertices, faces, semantic_id("building"), material_id("brick"))


def test_scene_shows_shadow_where_the_sun_is_blocked():
    mesh = LabelledMesh.concatenate([ground(z=0.0), block(0, 0, 8, 10)])
    camera = Camera(distance_m=80, azimuth_deg=-90, elevation_deg=60, field_deg=40)
    picture = render(mesh, camera, 320, 240).astype(float)
    # Ground points by the camera's own rays.
    rays = camera.rays(320, 240).reshape(-1, 3).astype(float)
    hit = camera.place - rays * (camera.place[2] / rays[:, 2])[:, None]
    picture = picture.reshape(-1, 3)
    away = -camera.sun[:2] / np.linalg.norm(camera.sun[:2])
    reach = 10 / np.tan(np.arcsin(camera.sun[2]))  # of the shadow of a 10 m block

    def brightness(centre):
        return picture[np.linalg.norm(hit[:, :2] - centre, axis=1) < 0.7].mean()

    shadow, lit = brightness(away * (4 + 0.6 * reach)), brightness(away * (9 + 1.5 * reach))
    assert shadow < 0.75 * lit
    assert brightness(-away * 14) > 0.93 * lit


def test_scene_picture_frames_the_middle(tmp_path):
    # Walls on three sides: the camera must come from the fourth, or from high above.
    walls = [block(x, y, 30, 40) for x, y in ((0, -45), (-45, 0), (45, 0))]
    mesh = LabelledMesh.concatenate([ground(z=0.0), *walls])
    from urbantwin.drawing.scene import clear_camera

    camera = clear_camera(mesh)
    assert camera.place[1] > 30 or camera.elevation_deg > 45
    path = scene_picture(mesh, tmp_path / "a.png", size=(320, 200), title="Here", attribution=["x"])
    assert imread(path).shape[:2] == (200, 320)


def seen_beside_blocks(camera, xy, blocks):
    """Whether the segments from places on the ground (N, 2) to the camera miss boxes (slabs)."""
    way = camera.place - np.column_stack([xy, np.zeros(len(xy))])
    free = np.ones(len(xy), bool)
    for x, y, size, height in blocks:
        enter, leave = np.zeros(len(xy)), np.ones(len(xy))
        for axis, (low, high) in enumerate(
            [(x - size / 2, x + size / 2), (y - size / 2, y + size / 2), (0.0, height)]
        ):
            at = np.zeros(len(xy)) if axis == 2 else xy[:, axis]
            a, b = (low - at) / way[:, axis], (high - at) / way[:, axis]
            enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
        free &= enter >= leave
    return free


@pytest.mark.parametrize("side", [(-1, -1), (1, -1), (1, 1), (-1, 1)])
def test_no_roof_hides_the_junction(side):
    """A crossing of two streets between four blocks, one of them a tower, and other towers."""
    blocks = [(x * 28, y * 28, 40, 18.0) for x in (-1, 1) for y in (-1, 1) if (x, y) != side]
    blocks += [(side[0] * 28, side[1] * 28, 40, 70.0), (-side[0] * 90, side[1] * 30, 60, 60.0)]
    mesh = LabelledMesh.concatenate([ground(z=0.0), *(block(*one) for one in blocks)])
    from urbantwin.drawing.scene import clear_camera

    camera = clear_camera(mesh)
    y, x = np.meshgrid(np.arange(-30.0, 31.0, 2.0), np.arange(-7.0, 8.0, 2.0))
    streets = np.column_stack([x.ravel(), y.ravel()])
    streets = np.concatenate([streets, streets[:, ::-1]])
    assert seen_beside_blocks(camera, streets, blocks).mean() > 0.8
    again = clear_camera(mesh)
    assert np.array_equal(again.place, camera.place)


def write_dataset(folder, frames):
    """Write what `record` leaves of frames, as docs/architecture.md lays it out."""
    for name in ("points", "semantic", "rays"):
        (folder / name).mkdir(parents=True)
    rows = []
    for frame in frames:
        np.save(folder / "points" / f"{frame.name}.npy", frame.points)
        label = frame.semantic.astype("<u4") | (frame.instance.astype("<u4") << 16)
        label.tofile(folder / "semantic" / f"{frame.name}.label")
        rays = np.zeros(len(label), [("sensor", "u1"), ("ring", "<u2"), ("column", "<u2")])
        rays["ring"], rays["column"] = frame.ring, frame.column
        np.save(folder / "rays" / f"{frame.name}.npy", rays)
        for box, name, count in zip(frame.boxes, frame.classes, frame.box_points, strict=True):
            values = dict(
                zip(("x", "y", "z", "length", "width", "height", "yaw"), box, strict=True)
            )
            told = {"frame": frame.name, "track": 5, "class": name, "num_points": int(count)}
            rows.append({**told, **values})
    write_table(folder / "boxes.parquet", rows)
    place = np.eye(4)
    place[:3, :3] = frames[0].sensors[0].dataset_SE3_sensor.rotation
    place[:3, 3] = frames[0].sensors[0].dataset_SE3_sensor.translation
    there = {f"true_{axis}": float(place[k, 3]) for k, axis in enumerate("xyz")}
    turns = [{"frame": frame.name, "sensor": "pole", **there} for frame in frames]
    write_table(folder / "sweeps.parquet", turns)
    sensor = {
        "name": "pole",
        "model": "MODEL",
        "columns": COLUMNS,
        "site_SE3_sensor": place.tolist(),
        "sensor": {"elevation_deg": ELEVATION_DEG.tolist()},
    }
    manifest = {
        "kind": "dataset",
        "urbantwin": "test",
        "seeds": {"record": 0, "traffic": 0},
        "frame": "sensor",
        "dataset_SE3_site": np.eye(4).tolist(),
        "rig": {"rate_hz": 10.0, "sensors": [sensor]},
        "point_cloud_range": [0.0] * 6,
        "inputs": [{"name": "a.osm", "attribution": "© somebody"}],
        "counts": {
            "frames": len(frames),
            "train": len(frames),
            "val": 0,
            "points": 11,
            "points_by_class": {"terrain": 10, "car": 1},
            "boxes": {"car": 2},
            "boxes_with_points": {"car": 1},
        },
        "frames": [{"name": frame.name, "time_s": frame.time_s} for frame in frames],
    }
    (folder / "dataset.json").write_text(json.dumps(manifest))


@pytest.mark.thorough
def test_pictures_of_a_dataset_come_out_the_same(tmp_path):
    quiet = frame_of_one_car(name="000000", box_points=np.array([0]))
    write_dataset(tmp_path / "set", [quiet, frame_of_one_car()])
    frame = read_labelled_points(tmp_path / "set")
    assert (frame.name, frame.time_s, frame.classes) == ("000003", 0.3, ("car",))
    assert np.unique(frame.instance).tolist() == [0, 5]
    told = []
    first = pictures_of_dataset(tmp_path / "set", progress=lambda done, what: told.append(done))
    with helpers(2, int) as crew:
        helper = crew.pool.submit(os.getpid).result()
        assert helper != os.getpid()
        again = pictures_of_dataset(tmp_path / "set", tmp_path / "again", pool=crew.pool)
        os.kill(helper, signal.SIGKILL)
        alone = pictures_of_dataset(tmp_path / "set", tmp_path / "alone", pool=crew.pool)
    assert {path.name for path in first} == set(PICTURES) - {"scene.png"}
    for one, other, last in zip(first, again, alone, strict=True):
        assert one.read_bytes() == other.read_bytes() == last.read_bytes()
    assert told == sorted(told)
    with Image.open(first[0]) as picture:
        assert "Software" not in picture.info
        assert "Creation Time" not in picture.info
    with pytest.raises(InputError, match="no frame 000009"):
        read_labelled_points(tmp_path / "set", "000009")
    with pytest.raises(InputError, match="not found"):
        pictures_of_dataset(tmp_path / "nowhere")


@pytest.mark.thorough
def test_a_helper_that_is_ready_draws_what_this_process_would(line, tmp_path):
    with helpers(2, time.sleep, 0.5) as crew:
        assert crew.ready is None
        crew.first.result()
        assert crew.ready is crew.pool
        pictures_of_twin(line.twin, tmp_path / "with", pool=crew.ready)
    alone = style.save(figure_of_twin(line.twin, "scene"), tmp_path / "scene.png")
    assert (tmp_path / "with" / "scene.png").read_bytes() == alone.read_bytes()
    with helpers(1, int) as crew:
        assert crew.ready is None


def test_scene_and_plan_come_out_the_same(tmp_path):
    mesh = LabelledMesh.concatenate([ground(z=0.0), block(0, 0, 8, 10)])
    pairs = []
    for name in ("a", "b"):
        scene = scene_picture(mesh, tmp_path / f"{name}1.png", size=(240, 160), camera=Camera())
        region = shapely.Point(0, 0).buffer(50)
        pairs.append([scene.read_bytes(), plan(street(), region, tmp_path / "p.png").read_bytes()])
    assert pairs[0] == pairs[1]
