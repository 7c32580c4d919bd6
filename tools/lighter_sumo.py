"""Leave SUMO's larger wheels out of lock files with hashes: ``python tools/lighter_sumo.py LOCK``.

SUMO publishes two builds for Linux. The one for newer systems (manylinux_2_28) bundles 230 MB of
libraries with each of its two wheels, the one for older systems (manylinux2014) 80 MB; networks
and motions are the same to the byte. pip and uv prefer the former, unless a lock file has no hash
of it.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

SUMO = ("eclipse-sumo", "libsumo")


def larger_wheels(pins: list[str]) -> set[str]:
    """Return the SHA-256 of the larger wheels of pinned packages; uv asks the index for them."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "-", "--no-deps", "--universal"]
    command += ["--python-version=3.11", "--format=pylock.toml", "--quiet"]
    lock = subprocess.run(
        command, input="\n".join(pins), capture_output=True, text=True, check=True
    ).stdout
    wheels = [wheel for package in tomllib.loads(lock)["packages"] for wheel in package["wheels"]]
    larger = {
        wheel["hashes"]["sha256"]
        for wheel in wheels
        if "manylinux_2_28" in wheel["url"] and "manylinux2014" not in wheel["url"]
    }
    if len(larger) == sum("linux" in wheel["url"] for wheel in wheels):
        sys.exit("error: this version of SUMO has no build for manylinux2014")
    return larger


def without(lock: str, hashes: set[str]) -> str:
    """Return a lock file's text without some hashes."""
    for sha256 in hashes:
        lock = re.sub(rf" \\\n +--hash=sha256:{sha256}", "", lock)
    return lock


def main() -> None:
    """Rewrite the lock files that the arguments name."""
    for path in map(Path, sys.argv[1:]):
        lock = path.read_text()
        pins = re.findall(rf"^(?:{'|'.join(SUMO)})==[^ \\]+", lock, flags=re.MULTILINE)
        path.write_text(without(lock, larger_wheels(pins)))


if __name__ == "__main__":
    main()
