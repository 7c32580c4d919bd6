"""One version everywhere, and a release that refuses what is not ready."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import urbantwin

ROOT = Path(__file__).parents[1]
COPIED = ("tools/release.sh", "CHANGELOG.md", "CITATION.cff", "src/urbantwin/__init__.py")
IDENTITY = {
    f"GIT_{role}_{name}": value
    for role in ("AUTHOR", "COMMITTER")
    for name, value in (("NAME", "Somebody"), ("EMAIL", "somebody@example.org"))
}


def newest_release() -> re.Match[str]:
    """Return the newest release of the changelog that is not under way: version, then date."""
    text = (ROOT / "CHANGELOG.md").read_text()
    found = re.search(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d{2}-\d{2})$", text, re.MULTILINE)
    assert found is not None
    return found


def test_one_version_everywhere() -> None:
    source = ast.parse((ROOT / "src/urbantwin/__init__.py").read_text())
    (stated,) = (
        node.value.value
        for node in source.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id == "__version__"
        and isinstance(node.value, ast.Constant)
    )
    assert urbantwin.__version__ == stated
    done = subprocess.run(
        [sys.executable, "-m", "urbantwin", "--version"],
        capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
    )  # fmt: skip
    assert done.stdout == f"urbantwin {stated}\n"
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == stated
    assert newest_release()[1] == stated
    assert str(citation["date-released"]) == newest_release()[2]


def test_a_release_is_read_in_two_minutes() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    for part in text.split("\n## [")[1:]:
        assert len(part.split()) <= 500, part.partition("]")[0]


def test_the_package_takes_its_version_from_there() -> None:
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" not in told["project"]
    assert told["project"]["dynamic"] == ["version"]
    assert told["tool"]["hatch"]["version"] == {"path": "src/urbantwin/__init__.py"}
    builder = pytest.importorskip("hatchling.builders.wheel")
    assert builder.WheelBuilder(str(ROOT)).metadata.version == urbantwin.__version__


def test_the_wheel_holds_the_licence_and_the_notice() -> None:
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {"LICENSE", "NOTICE"} <= set(told["license-files"])
    notice = (ROOT / "NOTICE").read_text()
    bundled = json.loads((ROOT / "web" / "package.json").read_text())["dependencies"]
    assert bundled.keys() == {"three"}  # a new package goes into NOTICE, too
    page = ROOT / "src/urbantwin/web/page/page.js"
    if not page.is_file():
        pytest.skip("the page is not built (make web)")
    head = page.read_text()[:2000]
    assert "Permission is hereby granted" in head
    holder = re.search(r"Copyright \(c\) .* three\.js authors", head)
    assert holder is not None
    assert holder[0] in notice


def test_the_notice_names_whose_tables_the_sensors_have() -> None:
    notice = (ROOT / "NOTICE").read_text()
    tables = (ROOT / "src/urbantwin/lidar/sensors").rglob("*.yaml")
    files = r"([\w-]+/[\w.-]+), (?:velodyne_pointcloud|tests|correction|config)\b"
    sources = {one for table in tables for one in re.findall(files, table.read_text())}
    assert len(sources) >= 4
    assert [one for one in sources if one not in notice] == []


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A repository with what `make release` looks at, all of it committed."""
    root = tmp_path / "checkout"
    for name in COPIED:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, root / name)
    git(root, "init", "--quiet")
    commit(root)
    return root


def git(root: Path, *arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=root, check=True, capture_output=True, text=True,
        env=os.environ | IDENTITY,
    ).stdout  # fmt: skip


def commit(root: Path) -> None:
    git(root, "add", "--all", "--force")
    git(root, "commit", "--quiet", "--message", "All of it")


def refused(root: Path) -> str:
    """Return the one line with which a release is refused; nothing is built or tagged."""
    tags = git(root, "tag")
    done = subprocess.run(
        [root / "tools/release.sh", sys.executable], check=False, capture_output=True, text=True,
        env=os.environ | IDENTITY,
    )  # fmt: skip
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stdout == ""
    assert git(root, "tag") == tags
    assert not (root / "dist").exists()
    assert not (root / "build").exists()
    (line,) = done.stderr.splitlines()
    return line


def test_a_release_refuses_what_is_not_committed(checkout: Path) -> None:
    (checkout / "new.txt").write_text("new")
    assert "not committed" in refused(checkout)


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("CHANGELOG.md", "] - ", "] ", "CHANGELOG.md has no heading"),
        ("CITATION.cff", "\nversion: ", "\nversion: 1", "CITATION.cff: version is not"),
        ("CITATION.cff", "date-released: 2", "date-released: 1", "date-released is not"),
        ("src/urbantwin/__init__.py", '__version__ = "', '__version__ = "1', "has no heading"),
        ("src/urbantwin/__init__.py", '__version__ = "', '__version__ = "x', "expected X.Y.Z"),
    ],
)
def test_a_release_refuses_versions_that_differ(
    checkout: Path, file: str, old: str, new: str, says: str
) -> None:
    text = (checkout / file).read_text()
    assert old in text
    (checkout / file).write_text(text.replace(old, new))
    commit(checkout)
    assert says in refused(checkout)


def test_a_release_refuses_a_tag_that_exists(checkout: Path) -> None:
    git(checkout, "tag", f"v{urbantwin.__version__}")
    assert "exists" in refused(checkout)


@pytest.mark.thorough
def test_a_release_is_built_checked_and_tagged(checkout: Path) -> None:
    """Of a small package: what it is made with comes from the package index."""
    (checkout / "README.md").write_text("# A package\n")
    (checkout / ".gitignore").write_text("build/\ndist/\n")
    (checkout / "pyproject.toml").write_text(
        '[build-system]\nrequires = ["hatchling"]\nbuild-backend = "hatchling.build"\n'
        '[project]\nname = "urbantwin"\ndynamic = ["version"]\nreadme = "README.md"\n'
        'requires-python = ">=3.11"\n'
        '[tool.hatch.version]\npath = "src/urbantwin/__init__.py"\n'
    )
    commit(checkout)
    done = subprocess.run(
        [checkout / "tools/release.sh", sys.executable],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | IDENTITY,
    )
    if "No matching distribution" in done.stderr or "Could not find a version" in done.stderr:
        pytest.skip("the package index cannot be reached")
    assert done.returncode == 0, done.stdout + done.stderr
    version = urbantwin.__version__
    made = {path.name for path in (checkout / "dist").iterdir()}
    assert made == {f"urbantwin-{version}.tar.gz", f"urbantwin-{version}-py3-none-any.whl"}
    assert git(checkout, "cat-file", "-t", f"v{version}").strip() == "tag"
    assert f"git push origin v{version}" in done.stdout
    assert git(checkout, "status", "--porcelain") == ""
    again = subprocess.run(
        [checkout / "tools/release.sh"], check=False, capture_output=True, text=True,
        env=os.environ | IDENTITY,
    )  # fmt: skip
    assert again.returncode == 2
    assert "exists" in again.stderr
