"""What the README and the page of commands say: short, true, with pictures, and it runs."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

import urbantwin
from urbantwin.drawing.scene import Camera
from urbantwin.lidar.catalogue import sensor_names
from urbantwin.site.presets import preset_names

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
TEXT = README.read_text()


def blocks(language: str) -> list[str]:
    """Return the fenced blocks of the README in a language; of shell where it is empty."""
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)


def test_it_is_read_in_minutes() -> None:
    assert 850 <= len(TEXT.split()) <= 1150


def test_its_parts_come_in_order() -> None:
    wanted = [
        "Five minutes", "Your own junction", "What you get", "How close to reality",
        "What it can do", "Limits", "Compared with", "Install", "Citation",
    ]  # fmt: skip
    assert re.findall(r"^## (.*)$", TEXT, re.MULTILINE) == wanted


def test_its_make_targets_exist() -> None:
    shell = [line for block in blocks("") for line in block.splitlines()]
    targets = {line.split()[1] for line in shell if line.startswith("make ")}
    targets |= set(re.findall(r"`make ([a-z]+)`", TEXT))
    assert {"demo", "test"} <= targets
    for target in sorted(targets):
        done = subprocess.run(
            ["make", target, "--dry-run"], cwd=ROOT, check=False, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr


def test_its_tree_is_that_of_a_data_set() -> None:
    (tree,) = (block for block in blocks("") if block.startswith("out/twin/"))
    inside = re.findall(r"^  (\S+)", tree, re.MULTILINE)
    described = (ROOT / "docs" / "architecture.md").read_text()
    for name in inside:
        if "*" not in name:
            assert f"`{name}" in described, name


def rows(heading: str) -> Iterator[list[str]]:
    """Yield the cells of the rows of the table below a heading."""
    part = TEXT.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|")]
    for line in lines[2:]:
        yield [cell.strip() for cell in line.strip("|").split("|")]


def test_its_figures_stand_on_the_pages_that_it_links_to() -> None:
    found = list(rows("How close to reality"))
    assert len(found) == 6
    for measured, ours, beside, link in found:
        path = re.search(r"\]\(([^)#]+)", link)
        assert path is not None
        page = (ROOT / path[1]).read_text()
        numbers = re.findall(r"\d+(?:\.\d+)?", f"{ours} {beside}")
        assert numbers, measured
        for number in numbers:
            assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", page), (
                measured,
                number,
            )


def test_it_says_eight_things_with_a_link_each() -> None:
    found = list(rows("What it can do"))
    assert len(found) == 8
    assert all("](docs/" in cells[1] for cells in found)


def test_its_counts_are_those_of_the_catalogues() -> None:
    assert "Thirty sensors" in TEXT
    assert len(sensor_names()) == 30
    assert "[\nnine places]" in TEXT or "[nine places]" in TEXT
    assert len(preset_names()) == 9
    assert f"version = {{{urbantwin.__version__}}}" in TEXT


def test_its_pictures_are_small_and_one_moves() -> None:
    names = re.findall(r"^!\[[^\]]{20,}\]\(([^)]+)\)$", TEXT, re.MULTILINE)
    assert all(not urlsplit(name).scheme for name in names)
    assert 4 <= len(names) <= 5
    assert sum((ROOT / name).stat().st_size for name in names) <= 1_500_000
    with Image.open(ROOT / names[0]) as movie:
        assert movie.n_frames > 20
        assert movie.info["loop"] == 0
        lasting = 0
        for number in range(movie.n_frames):
            movie.seek(number)
            movie.load()
            lasting += movie.info["duration"]
        assert 3000 <= lasting <= 5000
    assert (ROOT / names[0]).stat().st_size < 1_000_000


@pytest.fixture(scope="module")
def pictures() -> Iterator[ModuleType]:
    """The script that draws them."""
    sys.path.insert(0, str(ROOT / "docs" / "site_build"))
    import pictures

    yield pictures
    sys.path.remove(str(ROOT / "docs" / "site_build"))


def test_the_script_makes_those_pictures(pictures: ModuleType) -> None:
    source = Path(pictures.__file__).read_text(encoding="utf-8")
    for name in re.findall(r"\]\(docs/assets/(\w+)\.webp\)", TEXT):
        assert f'"{name}' in source


def test_points_are_drawn_where_the_scene_is(pictures: ModuleType) -> None:
    """A point on the ray through a pixel, as the picture of the twin casts it, is drawn there."""
    camera = Camera((3.0, -2.0, 1.0), 40.0, azimuth_deg=25.0, elevation_deg=33.0, field_deg=58.0)
    width, height = 64, 36
    rays = camera.rays(width, height).astype(np.float64)
    random = np.random.default_rng(1)
    columns, lines = random.integers(0, width, 40), random.integers(0, height, 40)
    points = camera.place + rays[lines, columns] * random.uniform(5, 90, (40, 1))
    places, ahead = pictures.View(camera, width, height).project(points)
    middles = (np.column_stack([columns, lines]) + 0.5) * pictures.FINER
    np.testing.assert_allclose(places, middles, atol=0.01)
    assert (ahead > 0).all()
    behind = 2 * camera.place - points
    assert (pictures.View(camera, width, height).project(behind)[1] < 0).all()


def test_near_points_hide_far_ones_and_boxes_are_outlined(pictures: ModuleType) -> None:
    camera = Camera((0.0, 0.0, 0.0), 20.0, azimuth_deg=0.0, elevation_deg=30.0, field_deg=60.0)
    view = pictures.View(camera, 80, 60)
    points = np.array([[0.0, 0.0, 0.0], camera.place / 2])
    colours = np.array([[255.0, 0.0, 0.0], [0.0, 255.0, 0.0]])
    red, green, _ = np.asarray(pictures.draw_points(view, points, colours, ()))[30, 40]
    assert green > 100 > red
    box = np.array([0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.3])
    corners = pictures.corners_of(box)
    assert sorted(np.ptp(corners, axis=0)) != [0, 0, 0]
    lengths = sorted(np.linalg.norm(corners[a] - corners[b]) for a, b in pictures.EDGES)
    np.testing.assert_allclose(lengths, [1.5] * 4 + [2.0] * 4 + [4.0] * 4)
    drawn = pictures.draw_points(view, np.zeros((0, 3)), np.zeros((0, 3)), [(corners, "car")])
    assert (np.asarray(drawn) == pictures.class_colour("car")).all(axis=2).sum() > 20


def test_the_page_of_extras_names_all_of_them() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = (ROOT / "docs" / "guide" / "install.md").read_text()
    ours = {"all", "bench", "dev", "docs"}
    named = set(re.findall(r"`([a-z0-9]+)`", page))
    assert declared["optional-dependencies"].keys() - ours <= named
    for text in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("**/*.md")):
        for extras in re.findall(r"(?:urbantwin|\.whl)\[([\w,]+)\]", text.read_text()):
            for extra in extras.split(","):
                assert extra == "NAME" or extra in declared["optional-dependencies"], text.name
