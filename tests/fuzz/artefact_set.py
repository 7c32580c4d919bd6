"""A small artefact of every kind, made once by the commands themselves, in a process of its own."""

import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import yaml

__all__ = ["EXAMPLE", "PLACE", "artefacts", "content", "make_artefacts"]

#: The variable that names the folder of artefacts that others made.
PLACE = "URBANTWIN_FUZZ_ARTEFACTS"

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "two-avenues"
_RIG = {
    "rate_hz": 5,
    "sensors": [
        {
            "name": "pole", "model": "VLP-16", "columns": 900,
            "east_m": 12, "north_m": -12, "height_m": 5, "yaw_deg": 135,
        }
    ],
}  # fmt: skip
_TRAFFIC = {
    "per_hour": {"car": 3000, "pedestrian": 2000},
    **{"duration_s": 1, "warmup_s": 10, "step_s": 0.1, "seed": 1},
}
_NODES = {
    "nodes": [
        {"name": "pole"},
        {
            "name": "roof", "ride": "car", "radio": {"latency_s": 0.02},
            "rig": {
                "ride": {"class": "car"}, "rate_hz": 5,
                "sensors": [{"name": "r", "model": "VLP-16", "columns": 900, "forward_m": 0.0,
                             "left_m": 0.0, "above_roof_m": 0.4}],
            },
        },
    ]
}  # fmt: skip
_QUICK = ("--no-pictures", "--quiet")
_PROGRAM = """
import json, sys
from urbantwin.cli import main
sys.exit(max(map(main, json.load(sys.stdin))))
"""


@cache
def artefacts() -> Path:
    """Return a folder with ``twin``, ``motion``, ``dataset``, ``fleet`` and ``coverage`` in it."""
    if PLACE in os.environ:
        return Path(os.environ[PLACE])
    folder = Path(tempfile.mkdtemp(prefix="fuzz-artefacts-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    make_artefacts(folder)
    return folder


def make_artefacts(folder: Path) -> None:
    """Make ``twin``, ``motion``, ``dataset``, ``fleet`` and ``coverage`` in an empty folder."""
    site = yaml.safe_load((EXAMPLE / "site.yaml").read_text())
    for name in ("osm", "dem"):
        site[name]["file"] = str(EXAMPLE / site[name]["file"])
    site |= {"region": {"radius_m": 40}, "closed_loop": False, "traffic": _TRAFFIC, "rig": _RIG}
    (folder / "site.yaml").write_text(yaml.safe_dump(site))
    (folder / "nodes.yaml").write_text(yaml.safe_dump(_NODES))
    twin, motion = folder / "twin", folder / "motion"
    commands = (
        ("build", folder / "site.yaml", "--out", twin, *_QUICK),
        ("drive", twin, "--out", motion, "--no-pictures", "--quiet"),
        ("record", twin, motion, "--out", folder / "dataset", "--stop", "0.2", "--workers", "1",
         *_QUICK),
        ("record", twin, motion, "--nodes", folder / "nodes.yaml", "--out", folder / "fleet",
         "--stop", "0.2", "--workers", "1", *_QUICK),
        ("rig", "coverage", twin, "--out", folder / "coverage", "--cell", "4", "--quiet"),
    )  # fmt: skip
    # Not in this process: its children are forked, and these commands start threads.
    words = json.dumps([list(map(str, command)) for command in commands])
    call = [sys.executable, "-c", _PROGRAM]
    subprocess.run(call, input=words, text=True, check=True, cwd=ROOT / "src", capture_output=True)


def content(name: str) -> bytes:
    """Return what a file of the artefacts holds."""
    return (artefacts() / name).read_bytes()
