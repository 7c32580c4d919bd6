"""The commands in the order of help: a main road, and groups of what is beside it."""

from __future__ import annotations

from importlib import import_module

from urbantwin.interface.command import Command, read_command

__all__ = ["GROUPS", "MAIN_ROAD", "command_at", "every_command"]

#: In the order of a person's work. Each is a function of the same name in `urbantwin`.
MAIN_ROAD = tuple("demo init build drive record run view compare export info".split())

#: Groups: what they are for, and their commands: functions in ``urbantwin.GROUP``.
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "site": ("Check a site's inputs, list places to begin with", ("check", "presets")),
    "traffic": (
        "Replay, fit to, observe and film traffic",
        ("replay", "calibrate", "observe", "film"),
    ),
    "rig": (
        "Place, find and tune sensors",
        ("coverage", "place", "align", "discover", "background", "tune"),
    ),
    "dataset": (
        "Split, describe, verify and reproduce datasets",
        ("split", "sequence", "card", "verify", "reproduce"),
    ),
    "model": (
        "Train, run and judge detectors",
        (
            "train",
            "pretrain",
            "detect",
            "label",
            "track",
            "evaluate",
            "teach",
            "improve",
            "fuse",
        ),
    ),
    "experiment": ("Run grids of recordings, compare them", ("run", "vary", "explain", "suite")),
    "catalogue": ("List sensors and actors", ("sensors", "actors")),
}


def command_at(group: str, name: str) -> Command:
    """Return the command of a group, ``""`` for the main road."""
    package = import_module(f"urbantwin.{group}" if group else "urbantwin")
    return read_command(vars(package)["_modules"][name], name)


def every_command() -> list[tuple[str, str]]:
    """Return group and name of every command, ``""`` for the group of the main road."""
    return [
        *(("", name) for name in MAIN_ROAD),
        *((group, name) for group, (_, names) in GROUPS.items() for name in names),
    ]
