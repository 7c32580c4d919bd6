"""A small site, what every command makes of it undisturbed, and how the commands are called."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "two-avenues"
SENSOR = ["--sensor", "VLP-16", "--columns", "900"]


@dataclass(frozen=True)
class Command:
    """A command of the program.

    Attributes:
        name: of the command.
        output: name of what it writes.
        arguments: from the stand and the output to the command line.
        resumes: whether an interrupted run leaves scratch to go on from.
        control: whether it records the arbitrary site, into the user's cache.
        in_place: whether its output is a dataset that it changes, which must be there.
        key: among all commands; its name if empty.
    """

    name: str
    output: str
    arguments: Callable[[Stand, Path], list[object]]
    resumes: bool = False
    control: bool = False
    in_place: bool = False
    key: str = ""


def _record(stand: Stand, out: Path) -> list[object]:
    options = ["--workers", "2", "--no-pictures"]
    return ["record", stand.twin, stand.motion, "-o", out, *options]


def _run(stand: Stand, out: Path) -> list[object]:
    return ["run", stand.site, "-o", out, "--workers", "2", "--no-pictures"]


def _compare(stand: Stand, out: Path) -> list[object]:
    control = ["--arbitrary", "none", "--workers", "2"]
    return ["compare", stand.real, stand.dataset, "-o", out, *control]


def _compare_control(stand: Stand, out: Path) -> list[object]:
    return ["compare", stand.real, stand.dataset, "-o", out, "--workers", "1"]


def _tune(stand: Stand, out: Path) -> list[object]:
    options = ["--fit", "pose,noise", "--trials", "6", "--no-report", "--workers", "1"]
    return ["rig", "tune", stand.real, stand.twin, "-o", out, *options]


def _place(stand: Stand, out: Path) -> list[object]:
    options = ["--wish", stand.wish, "--layouts", "4", "--workers", "2"]
    return ["rig", "place", stand.twin, stand.motion, "-o", out, *options]


def _export(to: str) -> Callable[[Stand, Path], list[object]]:
    return lambda stand, out: ["export", stand.dataset, "--to", to, "-o", out]


COMMANDS = {
    one.key or one.name: one
    for one in (
        Command("record", "dataset", _record, resumes=True),
        Command(
            "build",
            "twin",
            lambda stand, out: ["build", stand.site, "-o", out, "--no-pictures"],
        ),
        Command(
            "traffic",
            "motion",
            lambda stand, out: ["drive", stand.twin, "-o", out, "--no-pictures"],
        ),
        Command("run", "out", _run, resumes=True),
        Command("compare", "report", _compare),
        Command("compare", "report", _compare_control, control=True, key="compare-control"),
        Command("tune", "tuned", _tune, resumes=True),
        Command("place", "placement", _place, resumes=True),
        Command(
            "background",
            "measured.npz",
            lambda stand, out: ["rig", "background", stand.real, *SENSOR, "-o", out],
        ),
        Command(
            "sequence",
            "sequence",
            lambda stand, out: ["dataset", "sequence", stand.dataset, "-o", out, "--flow"],
            resumes=True,
        ),
        Command(
            "export",
            "carla",
            lambda stand, out: ["export", stand.twin, "--to", "carla", "-o", out],
        ),
        Command(
            "card",
            "card",
            lambda stand, out: ["dataset", "card", stand.dataset, "-o", out, "--no-pictures"],
        ),
        Command(
            "check",
            "weak.html",
            lambda stand, out: ["site", "check", stand.site, "-o", out],
        ),
        Command(
            "view",
            "page.html",
            lambda stand, out: ["view", stand.dataset, "--frames", "0:3", "--save", out],
        ),
        Command(
            "split",
            "divided",
            lambda stand, out: ["dataset", "split", out, "--shares", "60,20,20", "--gap", "0.1"],
            in_place=True,
        ),
        Command("export", "nuscenes", _export("nuscenes"), key="export-nuscenes"),
        Command("export", "frames.mcap", _export("mcap"), key="export-mcap"),
    )
}


#: What makes an older output of an older twin or dataset.
_OF_OLDER: dict[str, Callable[[Stand], list[object]]] = {
    "sequence": lambda stand: ["dataset", "sequence", stand.dataset, "--csv"],
    "carla": lambda stand: ["export", stand.older("twin"), "--to", "carla"],
    "card": lambda stand: ["dataset", "card", stand.older("dataset"), "--no-pictures"],
    "weak.html": lambda stand: ["site", "check", stand.smaller],
    "placement": lambda stand: [*_place(stand, Path())[:4], "--wish", stand.wish, "--layouts", "2"],
    "page.html": lambda stand: ["view", stand.older("dataset")],
    "nuscenes": lambda stand: ["export", stand.older("dataset"), "--to", "nuscenes"],
    "frames.mcap": lambda stand: ["export", stand.older("dataset"), "--to", "mcap"],
    "measured.npz": lambda stand: ["rig", "background", stand.dataset, *SENSOR],
}


@dataclass
class Stand:
    """The inputs of the commands, and what the commands make of them.

    Args:
        folder: where all of it is.
        closed_loop: whether its streets are closed to a loop, which takes six times as long.
    """

    folder: Path
    closed_loop: bool = False
    durations_s: dict[str, float] = field(default_factory=dict)

    @cached_property
    def site(self) -> Path:
        """One sensor and 20 frames within 40 m of the middle of the example."""
        shutil.copytree(EXAMPLE, self.folder / "site")
        path = self.folder / "site" / "site.yaml"
        fields = yaml.safe_load(path.read_text())
        fields |= {"region": {"radius_m": 40}, "closed_loop": self.closed_loop}
        fields["traffic"] |= {"duration_s": 2.0, "warmup_s": 5}
        sensor = {"name": "corner", "model": "VLP-16", "columns": 900, "yaw_deg": 135}
        sensor |= {"east_m": 12, "north_m": -12, "height_m": 4.0}
        fields["rig"] |= {"rate_hz": 10, "sensors": [sensor]}
        path.write_text(yaml.safe_dump(fields))
        return path

    @cached_property
    def wish(self) -> Path:
        """Two places and a sensor that a search chooses from."""
        places = [
            {"name": name, "east_m": east, "north_m": north}
            for name, east, north in (("corner", 12.0, -12.0), ("opposite", -12.0, 12.0))
        ]
        path = self.folder / "place.yaml"
        model = {"model": "VLP-16", "price": 4000, "columns": 900}
        fields = {"candidates": {"kinds": [], "places": places}, "models": [model], "step_s": 0.5}
        path.write_text(yaml.safe_dump(fields))
        return path

    @property
    def smaller(self) -> Path:
        """The same place, a little smaller."""
        site = self.site.with_name("older.yaml")
        site.write_text(self.site.read_text().replace("radius_m: 40", "radius_m: 35"))
        return site

    @property
    def twin(self) -> Path:
        """The twin of the site."""
        return self.expected("build")

    @property
    def motion(self) -> Path:
        """Its motion."""
        return self.expected("traffic")

    @property
    def dataset(self) -> Path:
        """Its dataset."""
        return self.expected("record")

    @cached_property
    def real(self) -> Path:
        """What stands for real frames: eleven of another seed."""
        out = self.folder / "real"
        options = ["--seed", "11", "--stop", "1.0", "--workers", "1", "--no-pictures"]
        return self._made("real", ["record", self.twin, self.motion, "-o", out, *options])

    def older(self, output: str) -> Path:
        """Return an older artefact, which differs from what the command makes."""
        out = self.folder / "older" / output
        if output == "out":
            for part in ("twin", "motion", "dataset"):
                shutil.copytree(self.older(part), out / part, dirs_exist_ok=True)
            return out
        if out.exists():
            return out
        if output == "divided":
            return shutil.copytree(self.dataset, out)
        return self._made(f"older/{output}", [*self._older_of(output, out), "-o", out])

    def _older_of(self, output: str, out: Path) -> list[object]:
        if output == "twin":
            arguments: list[object] = ["build", self.smaller, "--no-pictures"]
        elif output == "motion":
            arguments = ["drive", self.twin, "--seconds", "0.3", "--no-pictures"]
        elif output == "dataset":
            arguments = [*_record(self, out), "--stop", "0.3", "--seed", "3"]
        elif output == "report":
            control = ["--arbitrary", "none", "--workers", "1"]
            arguments = ["compare", self.dataset, self.real, *control]
        elif output == "tuned":
            options = ["--fit", "noise", "--trials", "2", "--no-report"]
            arguments = ["rig", "tune", self.real, self.twin, *options]
        else:
            arguments = _OF_OLDER[output](self)
        return arguments

    def expected(self, key: str) -> Path:
        """Return what a command makes undisturbed."""
        command = COMMANDS[key]
        name = f"expected/{key}/{command.output}"
        out = self.folder / name
        if not out.exists():
            arguments = command.arguments(self, out)  # makes what the command reads
            if command.in_place:
                shutil.copytree(self.older(command.output), out)
            if "--workers" in arguments:  # one gives the same bytes, and need not be started
                arguments[arguments.index("--workers") + 1] = "1"
            code, err = self.ran(arguments)
            assert code == 0, err
        return out

    def take(self, line: Path) -> None:
        """Take the twin from where `make_line` made it: it has the bytes of the command's."""
        shutil.copytree(line / "site" / "two-avenues" / "twin", self.folder / "expected/build/twin")

    def duration_s(self, key: str) -> float:
        """Return how long a command takes as a program, everything that it needs being there."""
        self.expected(key)
        if key not in self.durations_s:
            command = COMMANDS[key]
            out = self.folder / "timed" / key / command.output
            if command.in_place:
                shutil.copytree(self.older(command.output), out)
            arguments = command_line(command.arguments(self, out))
            began = time.monotonic()
            subprocess.run(arguments, env=self.environment(), check=True, capture_output=True)
            self.durations_s[key] = time.monotonic() - began
        return self.durations_s[key]

    def environment(self, place: Path | None = None) -> dict[str, str]:
        """Return the surroundings of a process whose temporary folder and cache are its own."""
        here = place or self.folder
        for name in ("tmp", "cache"):
            (here / name).mkdir(parents=True, exist_ok=True)
        return os.environ | {
            "PYTHONPATH": str(ROOT / "src"),
            "TMPDIR": str(here / "tmp"),
            "XDG_CACHE_HOME": str(here / "cache"),
            # matplotlib's list of fonts, which is not ours, takes seconds
            "MPLCONFIGDIR": str(self.folder / "matplotlib"),
        }

    def ran(self, arguments: list[object], place: Path | None = None) -> tuple[int, str]:
        """Run a command in this process, which saves the imports; return its code and stderr."""
        with (
            pytest.MonkeyPatch.context() as patch,
            tempfile.TemporaryFile("w+", encoding="utf-8") as err,
        ):
            for name, value in self.environment(place).items():
                patch.setenv(name, value)
            patch.setattr(tempfile, "tempdir", None)
            before = os.dup(2)
            os.dup2(err.fileno(), 2)  # of its workers too
            try:
                with redirect_stderr(err), redirect_stdout(err):
                    code = main([*map(str, arguments), "--quiet"])
                    err.flush()
            finally:
                os.dup2(before, 2)
                os.close(before)
            err.seek(0)
            return code, err.read()

    def _made(self, name: str, arguments: list[object]) -> Path:
        out = self.folder / name
        if not out.exists():
            code, err = self.ran(arguments)
            assert code == 0, err
        return out


def make_line(folder: Path) -> None:
    """Make the site's twin, motion and a dataset beside it, by Python's functions."""
    twin = ut.build(Stand(folder).site, pictures=False, progress=False)
    motion = ut.drive(twin, progress=False)
    ut.record(twin, motion, stop=0.5, workers=1, pictures=False, progress=False)


def command_line(arguments: list[object]) -> list[str]:
    """Return how the program is started."""
    return [sys.executable, "-m", "urbantwin", *map(str, arguments), "--quiet"]


def bytes_of(path: Path) -> dict[str, str]:
    """Return the SHA-256 of every file at a path, and the names of empty folders, by name."""
    if path.is_file():
        return {"": hashlib.sha256(path.read_bytes()).hexdigest()}
    found = {}
    for one in sorted(path.rglob("*")):
        if one.is_file():
            found[str(one.relative_to(path))] = hashlib.sha256(one.read_bytes()).hexdigest()
        elif not any(one.iterdir()):
            found[str(one.relative_to(path))] = "empty folder"
    return found
