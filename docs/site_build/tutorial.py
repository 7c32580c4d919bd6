"""Run what ``docs/guide/tutorial.md`` says, in its order: every command and every piece of Python.

``python docs/site_build/tutorial.py FOLDER`` runs it as it stands and says how long each command
takes; with ``--small`` the same commands on a smaller site, with fewer steps of training, which is
what the tests do. What installs is not run: a test looks whether pip would find it.
"""

import argparse
import contextlib
import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path

import yaml

from urbantwin import cli

__all__ = ["SETTING_UP", "parts", "run"]

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "guide" / "tutorial.md"
#: Beginnings of commands that make the environment in which the others run.
SETTING_UP = ("make demo", "source ", "python -m pip install ")
_BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def parts(page: Path = PAGE) -> Iterator[tuple[str, str]]:
    """Yield the commands (``sh``) and the pieces of Python of the page, in its order."""
    for language, block in _BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "python":
            yield language, block
        else:
            for line in block.replace("\\\n", " ").splitlines():
                if command := line.partition(" #")[0].strip():
                    yield language, command


def run(folder: Path, *, small: bool = False) -> list[tuple[str, float]]:
    """Run the page in a folder, and return its commands with the seconds that each took.

    Raises:
        RuntimeError: a command failed, or is none of ours.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(ROOT / "examples")
    took = []
    with contextlib.chdir(folder):
        for language, text in parts():
            if text.startswith(SETTING_UP):
                continue
            begun = time.perf_counter()
            if language == "python":
                exec(compile(text, PAGE.name, "exec"), {})
            else:
                _command(text, small=small)
            took.append((text if language == "sh" else "(Python)", time.perf_counter() - begun))
    return took


def _command(text: str, *, small: bool) -> None:
    program, *arguments = shlex.split(text)
    if program != "urbantwin":
        raise RuntimeError(f"{PAGE.name}: nothing runs {program}")
    if small and "--minutes" in arguments:
        at = arguments.index("--minutes")
        arguments[at : at + 2] = ["--steps", "3"]
    if small and arguments[0] == "run":
        arguments += ["--workers", "1", "--no-pictures"]
    if (code := cli.main([*arguments, "--quiet"])) != 0:
        raise RuntimeError(f"{text} ended with {code}")
    if small and arguments[0] == "init":
        _make_small(Path("crossing") / "site.yaml")


def _make_small(site: Path) -> None:
    """Leave one small sensor, two seconds and little around of what `init` proposed."""
    told = yaml.safe_load(site.read_text(encoding="utf-8"))
    told["region"]["radius_m"] = 60
    told["closed_loop"] = False
    told["scene"] = {"clutter": "none"}
    told["traffic"] |= {"duration_s": 2, "warmup_s": 15}
    told["traffic"]["per_hour"] |= {"car": 1500, "bicycle": 1500, "pedestrian": 1500}
    (sensor,) = told["rig"]["sensors"]
    sensor |= {"model": "VLP-32C", "columns": 1800, "proposed": False}
    site.write_text(yaml.safe_dump(told), encoding="utf-8")


def main() -> None:
    """Read the options, run it, print the times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--small", action="store_true")
    told = parser.parse_args()
    for command, seconds in run(told.folder, small=told.small):
        print(f"{seconds:8.1f} s  {command}")


if __name__ == "__main__":
    main()
