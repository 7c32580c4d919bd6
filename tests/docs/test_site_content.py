"""What the site's pages say: the tutorial runs, tables are those of the code, pictures are made."""

import importlib.metadata
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

import urbantwin
from urbantwin.cli.commands import GROUPS, every_command
from urbantwin.lidar.catalogue import sensor_names
from urbantwin.taxonomy import materials

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "docs" / "site_build"


@pytest.fixture(scope="module")
def scripts() -> Iterator[SimpleNamespace]:
    """The scripts that stand beside the pages."""
    sys.path.insert(0, str(BUILD))
    import basis
    import charts
    import gallery
    import reference
    import tutorial

    yield SimpleNamespace(
        basis=basis, charts=charts, gallery=gallery, reference=reference, tutorial=tutorial
    )
    sys.path.remove(str(BUILD))


@pytest.mark.thorough
def test_the_tutorial_ends_with_a_detector_that_runs(
    scripts: SimpleNamespace, tmp_path: Path
) -> None:
    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)
    took = scripts.tutorial.run(tmp_path, small=True)
    crossing = tmp_path / "crossing"
    assert (crossing / "model" / "model.onnx").is_file()
    assert (crossing / "detections" / "detections.parquet").is_file()
    assert (crossing / "tracked" / "detections.json").is_file()
    assert (crossing / "report").is_dir()
    assert not (crossing / "detector").exists()  # --plan makes nothing
    page = (ROOT / "docs" / "guide" / "tutorial.md").read_text()
    fences = re.findall(r"^```(\w*)$", page, re.MULTILINE)
    assert set(fences) <= {"sh", "python", ""}
    assert len(took) > 8


def test_what_sets_the_tutorial_up_exists(scripts: SimpleNamespace) -> None:
    for _, text in scripts.tutorial.parts():
        if text.startswith("make "):
            subprocess.run([*text.split(), "--dry-run"], cwd=ROOT, check=True, capture_output=True)
        elif text.startswith("python -m pip install "):
            for name in text.split()[4:]:
                assert importlib.metadata.version(name)
        elif text.startswith("source "):
            assert text == "source .venv/bin/activate"


def test_the_reference_has_every_public_name_and_every_command(scripts: SimpleNamespace) -> None:
    told = "\n".join(scripts.reference.python_pages().values())
    found = set(re.findall(r"^::: urbantwin\.([\w.]+)$", told, re.MULTILINE))
    assert {".".join(filter(None, words)) for words in every_command()} <= found
    public = {name for name in urbantwin.__all__ if not name.startswith("__")}
    assert public - set(GROUPS) == {name for name in found if "." not in name}
    commands = re.findall(r"^## ([a-z ]+)$", scripts.reference.command_page(), re.MULTILINE)
    assert [" ".join(filter(None, words)) for words in every_command()] == commands


def test_the_generated_tables_are_those_of_the_code(scripts: SimpleNamespace) -> None:
    for page in scripts.basis.PAGES:
        text = page.read_text()
        assert "<!-- made: " in text
        assert scripts.basis.with_tables(text) == text, "run python docs/site_build/basis.py"
    sensors = (ROOT / "docs" / "reference" / "sensors.md").read_text()
    for name in sensor_names():
        assert f" {name} |" in sensors
    table = (ROOT / "docs" / "method" / "materials.md").read_text()
    bases = Counter(re.findall(r"^\| `[\w-]+` \| [\d., ]+ \| (\w+) \|", table, re.MULTILINE))
    assert sum(bases.values()) == len(materials())


def test_the_charts_are_drawn_from_the_tables(scripts: SimpleNamespace) -> None:
    for chart in scripts.charts.CHARTS:
        drawn = (scripts.charts.ASSETS / f"{chart.name}.svg").read_text(encoding="utf-8")
        assert drawn == scripts.charts.draw(chart), "run python docs/site_build/charts.py"
        assert f"../assets/{chart.name}.svg" in (scripts.charts.RESULTS / chart.page).read_text()


def test_the_fields_of_the_files_have_their_limits(scripts: SimpleNamespace) -> None:
    page = scripts.reference.field_page()
    assert "| `label_range_m` | number from 1 to 1000 |  |" in page
    assert "| `frame` | `sensor`, `level`, `site` | `level` |" in page
    assert "## Traffic\n" in page
    assert "## GeometrySpec" not in page


def test_a_constant_has_its_comment(scripts: SimpleNamespace) -> None:
    found = {(one.file, one.name): one for one in scripts.basis.constants("site")}
    trucks = found["site/usual_traffic.py", "TRUCKS"]
    assert trucks.value == "0.04"
    assert trucks.kind == "estimate"
    walking = {one.name: one for one in scripts.basis.constants("roads")}["WALK_M_S"]
    assert walking.kind == "standard, law, paper or maker"
    assert "RiLSA" in walking.told
