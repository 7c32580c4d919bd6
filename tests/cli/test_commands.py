"""Commands that need no twin: help, the catalogue, usage errors, the two streams."""

import inspect
import json
import os
import pty
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin import __version__
from urbantwin.cli.commands import GROUPS, MAIN_ROAD, command_at, every_command

Run = Callable[..., Any]
VERBS = set(
    "Build Check Compare Detect Divide Drive Explain Film Find Fit Judge Label List Make Map "
    "Measure Print Record Run Search Show Simulate Track Train Turn Write".split()
)


def test_help_is_one_screen_with_every_command_and_is_quick(run_program: Run) -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    outcome = run_program("--help")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) < 80
    listed = [line.split()[0] for line in lines if line.startswith("  ")]
    assert [name for name in listed if name in {*MAIN_ROAD, *GROUPS}] == [*MAIN_ROAD, *GROUPS]
    assert "..." not in outcome.out
    # Of the processor, whatever else the machine does: 0.2 s.
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 1.5


def test_starting_imports_nothing_heavy() -> None:
    program = (
        "import sys, urbantwin.cli; "
        "print([name for name in ('numpy', 'osmium', 'pyarrow', 'matplotlib', 'embreex') "
        "if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("group", "name"), every_command())
def test_every_command_explains_itself(run_here: Run, group: str, name: str) -> None:
    words = [group, name] if group else [name]
    outcome = run_here(*words, "--help")
    assert outcome.code == 0
    command = command_at(group, name)
    title = command.title.removesuffix(".")
    # A verb and an object.
    assert len(title) <= 55
    assert title.split()[0].rstrip(",") in VERBS
    assert f"  {title}." in outcome.out
    assert outcome.out.rstrip().splitlines()[-2:] == ["Example:", f"  {command.example}"]
    assert command.example.startswith(" ".join(["urbantwin", *words]))
    assert "--quiet" in outcome.out
    assert "--json" in outcome.out
    for one in command.parameters:
        assert one.help.endswith(".")
        assert not re.match("(?i)(of|that|which|who) ", one.help), one
    assert max(map(len, outcome.out.splitlines())) <= 100


@pytest.mark.parametrize(("group", "name"), every_command())
def test_a_functions_options_are_those_of_its_command(run_here: Run, group: str, name: str) -> None:
    function = getattr(getattr(ut, group) if group else ut, name)
    parameters = inspect.signature(function).parameters
    read = {one.name: one for one in command_at(group, name).parameters}
    assert list(read) == list(parameters)
    for one, parameter in zip(read.values(), parameters.values(), strict=True):
        assert one.required == (parameter.default is parameter.empty)
        assert one.required or one.default == parameter.default
        assert one.kind or one.name == "progress"


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_alone_lists_its_commands(run_here: Run, group: str) -> None:
    outcome = run_here(group)
    assert outcome.code == 0
    listed = outcome.out.split("Commands:")[1].splitlines()
    assert [line.split()[0] for line in listed if line.strip()] == list(GROUPS[group][1])


def test_limits_are_those_of_the_function_in_python_too(run_here: Run, tmp_path: Path) -> None:
    with pytest.raises(ut.InputError, match=r"--seconds: -5; expected 0\.1 to 86400"):
        ut.drive(tmp_path, seconds=-5)
    outcome = run_here("drive", tmp_path, "--seconds", "-5")
    assert outcome.err == "error: --seconds: -5.0; expected 0.1 to 86400\n"


def test_a_command_of_a_group_says_where_it_is(run_here: Run) -> None:
    outcome = run_here("coverage", "twin/")
    assert outcome.code == 2
    assert "urbantwin rig coverage" in outcome.err
    assert outcome.err.count("\n") == 1


def test_the_version_is_the_packages(run_here: Run) -> None:
    assert run_here("--version").out == f"urbantwin {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("fly",), "fly"),
        (("traffic", "replay", "tracks.csv"), "--twin"),
        (("rig", "fly"), "fly"),
        (("record", "twin"), "MOTION"),
        (("build", "-o", "twin"), "SITE"),
        (("drive", "twin", "-o", "m", "--seconds", "-5"), "--seconds"),
        (("drive", "twin", "-o", "m", "--seed", "-1"), "--seed"),
        (("record", "twin", "motion", "-o", "d", "--workers", "0"), "--workers"),
        (("init", "here", "--osm", "a.osm", "--lat", "91", "--lon", "0"), "--lat"),
        (("init", "here", "--osm", "a.osm", "--lat", "1"), "--lon"),
        (("init", "here", "--osm", "a.osm", "--lat", "1", "--lon", "1", "--at-junction"), "--at-j"),
    ],
)
def test_a_wrong_usage_is_one_line(
    run_here: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...], named: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    outcome = run_here(*arguments)
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.startswith("error: ")
    assert outcome.err.count("\n") == 1
    assert named in outcome.err
    assert not list(tmp_path.iterdir())


def test_the_catalogue_agrees_with_its_files(run_here: Run) -> None:
    folder = Path(__file__).parents[2] / "src" / "urbantwin" / "lidar" / "sensors"
    on_disk = {}
    for path in folder.rglob("*.yaml"):
        entry = yaml.safe_load(path.read_text())
        on_disk[entry["name"]] = len(entry["channels"])
    listed = json.loads(run_here("catalogue", "sensors", "--json").out)["sensors"]
    assert {entry["name"]: entry["channels"] for entry in listed} == on_disk
    table = run_here("catalogue", "sensors").out.splitlines()
    assert sorted(line.split()[0] for line in table[1:]) == sorted(on_disk)
    assert run_here("catalogue", "sensors", "--quiet").out.split() == [
        entry["name"] for entry in listed
    ]


def test_one_sensor_is_shown_with_its_channels_and_sources(run_here: Run) -> None:
    shown = json.loads(run_here("catalogue", "sensors", "VLP-16", "--json").out)
    # Velodyne VLP-16 user manual, table 9-1.
    assert sorted(shown["elevation_deg"]) == pytest.approx(list(range(-15, 16, 2)), abs=0.05)
    assert shown["sources"]
    assert shown["maker"] in run_here("catalogue", "sensors", "VLP-16").out


def test_show_prints_everything_known_of_a_sensor(run_here: Run) -> None:
    page = run_here("catalogue", "sensors", "VLS-128").out
    # Velodyne VLS-128 user manual: table F-1, 6.1, 9.3.1.
    assert "0.18 x 0.09 deg" in page
    assert "retroreflectors" in page
    assert "53.3 us" in page
    assert "unknown (no public document" in page
    assert "0-7; 8-15; 16-23" in page
    assert "1800 x 10 (18000 columns/s)" in page
    shown = json.loads(run_here("catalogue", "sensors", "VLS-128", "--json").out)
    assert shown["blocks"][1] == list(range(8, 16))
    assert shown["column_rates_hz"] == [18000] * 3
    assert shown["beam_divergence_deg"] == [0.18, 0.09]
    assert len(shown["firing_time_us"]) == 128
    assert shown["range_min_m"] is None
    assert "range_min_m" in shown["unknown"]


def test_an_unknown_sensor_names_the_nearest(run_here: Run) -> None:
    outcome = run_here("catalogue", "sensors", "OS1-129")
    assert outcome.code == 2
    assert "OS1-129" in outcome.err
    assert "OS1-128" in outcome.err
    assert outcome.err.count("\n") == 1


def test_a_closed_pipe_is_quiet(tmp_path: Path) -> None:
    command = f"{sys.executable} -m urbantwin catalogue sensors OS1-128 | head -n 1"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("OS1-128")
    assert done.stderr == ""


def test_a_missing_right_is_one_line(run_here: Run, tmp_path: Path, two_avenues: Path) -> None:
    if os.geteuid() == 0:
        blocked = Path("/proc/nothing")  # where root itself can make no folder
    else:
        blocked = tmp_path / "closed"
        blocked.mkdir(mode=0o500)
    outcome = run_here("build", two_avenues / "site.yaml", "-o", blocked / "twin")
    assert outcome.code == 2
    assert "cannot be written" in outcome.err.strip().splitlines()[-1]
    assert "Traceback" not in outcome.err


def test_a_terminal_gets_a_bar_and_a_file_gets_lines(tmp_path: Path) -> None:
    program = """
import time
from urbantwin.interface.stage import shown_stage
with shown_stage("paint") as progress:
    for step in range(12):
        time.sleep(0.11)
        progress(step / 12, f"coat {step}")
"""
    plain = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    lines = plain.stderr.splitlines()
    assert lines[0].startswith("paint: ")
    assert "coat" in lines[0]
    assert lines[-1].startswith("paint: done in ")
    assert len(lines) <= 3
    assert "\x1b" not in plain.stderr
    assert plain.stdout == ""

    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm"}
    with subprocess.Popen([sys.executable, "-c", program], stderr=theirs, env=environment) as child:
        os.close(theirs)
        drawn = b""
        while True:
            try:
                part = os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            drawn += part
        child.wait()
    os.close(ours)
    assert b"\x1b[" in drawn
    assert b"100%" in drawn


def test_clouds_are_described_by_their_points(run_here: Run, tmp_path: Path) -> None:
    points = np.array([[1, 2, 3, 0.5], [-4, 5, 6, 0.25], [7, -8, 9, 1]], np.float32)
    np.save(tmp_path / "cloud.npy", points)
    told = json.loads(run_here("info", tmp_path / "cloud.npy", "--json").out)
    assert told["kind"] == "cloud"
    assert told["points"] == 3
    assert told["lowest"] == [-4, -8, 3]
    assert told["highest"] == [7, 5, 9]


def test_inputs_are_described(run_here: Run, two_avenues: Path) -> None:
    told = json.loads(run_here("info", two_avenues / "two-avenues.osm", "--json").out)
    text = (two_avenues / "two-avenues.osm").read_text()
    assert told["nodes"] == text.count("<node ")
    assert told["ways"] == text.count("<way ")
    assert told["signals"] == text.count('v="traffic_signals"') - text.count('k="crossing"')
    told = json.loads(run_here("info", two_avenues / "two-avenues-dem.tif", "--json").out)
    assert told["kind"] == "dem"
    assert told["crs"] == "EPSG:25832"
    told = json.loads(run_here("info", two_avenues / "site.yaml", "--json").out)
    assert told["kind"] == "site"
    assert [item["licence"] for item in told["inputs"]] == ["CC0-1.0", "CC0-1.0"]
    assert run_here("info", two_avenues / "site.yaml", "--quiet").out == ""


def test_what_is_unknown_is_one_line(run_here: Run, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    for path in (tmp_path / "notes.txt", tmp_path, tmp_path / "missing"):
        outcome = run_here("info", path)
        assert outcome.code == 2
        assert outcome.err.startswith(f"error: {path}: ")
        assert outcome.err.count("\n") == 1
