"""Films: what they show, where, and for how long."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.drawing import style
from urbantwin.drawing.film import film_colours
from urbantwin.drawing.film.from_corner import FromCorner, corner_camera
from urbantwin.drawing.film.signal_lamps import Lamps

from .conftest import Line

RADIUS_M, SIDE = 60.0, 400


@pytest.fixture(scope="module")
def above(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "above.gif"
    how = {"view": "above", "width": SIDE, "radius": RADIUS_M, "fps": 8.0}
    made = ut.traffic.film(line.motion, path, stop=0.5, progress=False, **how)
    assert (made.pictures, made.width) == (5, SIDE)
    return path


@pytest.mark.thorough
def test_a_gif_lasts_as_long_as_what_it_shows_and_has_the_same_bytes_again(
    line: Line, above: Path, tmp_path: Path
) -> None:
    with Image.open(above) as film:
        lasting = []
        for number in range(film.n_frames):
            film.seek(number)
            lasting.append(film.info["duration"])
    assert sum(lasting) == 620  # 5 pictures, 8 a second, in hundredths
    arguments = [
        "traffic",
        "film",
        str(line.motion.folder),
        "-o",
        str(tmp_path / "again.gif"),
        "--quiet",
    ]
    arguments += ["--view", "above", "--width", str(SIDE), "--radius", str(RADIUS_M)]
    assert main([*arguments, "--fps", "8", "--stop", "0.5"]) == 0
    assert (tmp_path / "again.gif").read_bytes() == above.read_bytes()


def test_an_actor_is_drawn_where_it_is_in_its_colour(line: Line, above: Path) -> None:
    rows = line.motion.at(0.0)
    near = rows[np.hypot(rows["x"], rows["y"]) < 0.9 * RADIUS_M]
    assert len(near) > 0
    with Image.open(above) as film:
        pixels = np.asarray(film.convert("RGB"), np.int64)
    for row in near:
        column = int(SIDE / 2 * (1 + row["x"] / RADIUS_M))
        line_of = int(SIDE / 2 * (1 - row["y"] / RADIUS_M))
        around = pixels[line_of - 1 : line_of + 2, column - 1 : column + 2].reshape(-1, 3)
        wanted = np.round(255 * style.actor_colour(str(row["class"])))
        assert np.abs(around - wanted).max(axis=1).min() <= 40, row


def test_every_class_stands_below_a_narrow_picture(line: Line, tmp_path: Path) -> None:
    path = tmp_path / "narrow.gif"
    ut.traffic.film(line.motion, path, view="above", width=200, stop=0.1, progress=False)
    with Image.open(path) as film:
        strip = np.asarray(film.convert("RGB"), np.int64)[200:].reshape(-1, 3)
    for name in set(line.motion.rows["class"].to_pylist()):
        wanted = np.round(255 * style.actor_colour(name))
        assert (np.abs(strip - wanted).max(axis=1) <= 20).sum() >= 100, name


def test_from_the_corner_an_actor_stands_where_it_is_unless_the_ground_hides_it(
    line: Line,
) -> None:
    camera = corner_camera(line.twin, np.zeros(2))
    view = FromCorner(line.twin, line.motion, camera, (240, 160))
    rows = line.motion.at(0.0)
    car = rows[rows["class"] == "car"][:1].copy()
    car["x"], car["y"] = 0.0, 0.0
    car["z"] = np.asarray(camera.target)[2]
    lamps = Lamps(line.motion)
    nothing = view.picture(rows[:0], lamps, 0.0, {}).astype(int)
    differs = np.abs(view.picture(car, lamps, 0.0, {}) - nothing).max(axis=2) > 25
    # The camera looks at it: it is in the middle, about as wide as 4.5 m are at its distance.
    at = np.argwhere(differs)
    assert np.abs(at.mean(axis=0) - [80, 120]).max() < 12
    pixel_m = 2 * camera.distance_m * np.tan(np.radians(camera.field_deg) / 2) / 240
    assert 1.5 < np.ptp(at[:, 1]) * pixel_m < 9.0
    car["z"] -= 5.0
    assert not (np.abs(view.picture(car, lamps, 0.0, {}) - nothing).max(axis=2) > 25).any()


def test_lamps_show_what_the_table_says(line: Line) -> None:
    table = line.motion.signals
    assert table.num_rows
    lamps = Lamps(line.motion)
    states = dict.fromkeys(range(len(lamps.places)), "")
    keys: list[tuple[object, ...]] = []
    for row in table.to_pylist():
        key = (row["signal"], row["link"], row["x"], row["y"])
        if key not in keys:
            keys.append(key)
        if row["time_s"] <= 2.0:
            states[keys.index(key)] = row["state"]
    shown = lamps.colours(2.0)
    green = {number for number, colour in enumerate(shown) if colour == (70, 220, 110)}
    assert green == {number for number, state in states.items() if state in ("G", "g")}


def test_an_mp4_has_every_picture(line: Line, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "film.mp4"
    ut.traffic.film(line.motion, path, view="above", width=160, stop=0.5, progress=False)
    assert ffmpeg.count_frames_and_secs(str(path))[0] == 6


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "film.avi"], "ends in .mp4 or .gif"),
        (["-o", "film.gif", "--view", "side"], "above, corner, both"),
        (["-o", "film.gif", "--at", "north"], "X,Y in metres"),
        (["-o", "film.gif", "--start", "5", "--stop", "4"], "times within the motion"),
        (["-o", "film.gif", "--fps", "500"], "0.1 to 50"),
    ],
)
def test_what_cannot_be_filmed_is_refused(
    line: Line,
    options: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["traffic", "film", str(line.motion.folder), *options]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_colours_that_say_something_are_not_mixed_up() -> None:
    colours = film_colours()
    assert len(set(colours)) == len(colours)
