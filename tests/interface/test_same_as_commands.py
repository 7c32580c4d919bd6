"""The commands and the functions: the same options, the same defaults, the same bytes."""

import inspect
from collections.abc import Callable
from pathlib import Path

import pytest

import urbantwin as ut
from urbantwin.cli import app, main

from ..reliability.small_site import bytes_of
from .conftest import Line

COMMANDS = {one.callback.__name__: one.callback for one in app.registered_commands}
#: Where the command's name is that of a package.
PYTHON_NAMES = {"traffic": "drive", "view": "look"}
#: What stands for itself on a command line, and what only Python has.
OF_COMMANDS = {"quiet", "as_json", "shown", "list_presets"}
OF_PYTHON = {"progress", "note"}


def plain(default: object) -> object:
    """The value that a default means: nothing given is ``None`` for typer, ``()`` in Python."""
    return None if default in ((), None) else str(default)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_function_has_the_options_and_defaults_of_its_command(command: str) -> None:
    options = inspect.signature(COMMANDS[command]).parameters
    function = getattr(ut, PYTHON_NAMES.get(command, command))
    parameters = inspect.signature(function).parameters
    assert set(options) - OF_COMMANDS == set(parameters) - OF_PYTHON
    for name, parameter in parameters.items():
        if name in OF_PYTHON:
            continue
        wanted = options[name].default
        if wanted is inspect.Parameter.empty:
            # Only where a result goes has a default in Python that the command does not have.
            assert parameter.default is inspect.Parameter.empty or name == "out", name
        else:
            assert plain(parameter.default) == plain(wanted), name


def test_the_functions_of_the_commands_are_documented() -> None:
    for command in COMMANDS:
        function = getattr(ut, PYTHON_NAMES.get(command, command))
        text = inspect.getdoc(function) or ""
        for name in inspect.signature(function).parameters:
            assert f"    {name}: " in text, (command, name)


def test_what_nobody_placed_lies_beside_what_it_is_made_from(line: Line) -> None:
    folder = line.site.parent / "two-avenues"
    assert line.twin.folder == folder / "twin"
    assert line.motion.folder == folder / "motion"
    assert line.dataset.folder == folder / "dataset"
    assert {path.name for path in folder.iterdir()} == {"twin", "motion", "dataset"}


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("twin", lambda line: ["build", line.site, "--no-pictures"]),
        ("motion", lambda line: ["traffic", line.twin.folder]),
        (
            "dataset",
            lambda line: (
                ["record", line.twin.folder, line.motion.folder, "--stop", 0.5]
                + ["--workers", 1, "--no-pictures"]
            ),
        ),
    ],
)
def test_a_command_writes_the_bytes_that_python_writes(
    line: Line, tmp_path: Path, kind: str, arguments: Callable[[Line], list[object]]
) -> None:
    out = tmp_path / kind
    assert main([*map(str, arguments(line)), "-o", str(out), "--quiet"]) == 0
    assert bytes_of(out) == bytes_of(getattr(line, kind).folder)


def test_a_twin_of_a_folder_is_a_twin_at_hand(line: Line, tmp_path: Path) -> None:
    coverages = [
        ut.coverage(twin, tmp_path / name, cell=2.0, pictures=False, progress=False)
        for name, twin in (("folder", line.twin.folder), ("hand", line.twin))
    ]
    assert bytes_of(coverages[0].folder) == bytes_of(coverages[1].folder)
    assert coverages[0].summary()["street_m2"] > 0


def test_the_seed_is_the_sites_where_nobody_gives_one(line: Line) -> None:
    assert line.dataset.manifest["seeds"]["record"] == line.twin.site["traffic"]["seed"] == 1
