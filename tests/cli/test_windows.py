"""On Windows the package imports, every command has its help, and writing is refused.

A process is made like Windows: what Python lacks there is missing for the package's own modules.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from urbantwin.cli.commands import every_command

from ..thorough import further

LIKE_WINDOWS = """
import builtins, importlib.util, signal

MISSING = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
really_import, really_find = builtins.__import__, importlib.util.find_spec


def lacking(name, globals=None, locals=None, fromlist=(), level=0):
    ours = (globals or {}).get("__name__", "").partition(".")[0] == "urbantwin"
    if ours and name.partition(".")[0] in MISSING:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return really_import(name, globals, locals, fromlist, level)


builtins.__import__ = lacking
importlib.util.find_spec = lambda name, package=None: (
    None if name in MISSING else really_find(name, package)
)
for name in ("SIGHUP", "pthread_kill", "pthread_sigmask"):
    delattr(signal, name)
"""
#: What a module names that may ask for what is missing.
ASKING = re.compile(
    r"\b(fcntl|grp|posix|pty|pwd|resource|syslog|termios|tty|import signal"
    r"|SIGHUP|pthread_kill|pthread_sigmask|find_spec|import_module)\b"
)
SRC = Path(__file__).parents[2] / "src"
COMMANDS = [",".join(filter(None, words)) for words in every_command()]


def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "ignore", "-c", LIKE_WINDOWS + program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def urbantwin(*arguments: str) -> subprocess.CompletedProcess[str]:
    return run("import sys; from urbantwin.cli import main; sys.exit(main())", *arguments)


def test_the_process_lacks_what_windows_lacks() -> None:
    done = run("exec('import fcntl', {'__name__': 'urbantwin.artefact'})")
    assert "No module named 'fcntl'" in done.stderr


def test_every_module_imports() -> None:
    """Those that name what is missing: the others import what every system has, and these."""
    # Modules beside SUMO's worker import one another by path.
    names = [
        ".".join(module.relative_to(SRC).with_suffix("").parts)
        for module in (SRC / "urbantwin").rglob("*.py")
        if module.name not in ("__main__.py", "worker.py")
        and ASKING.search(module.read_text(encoding="utf-8"))
    ]
    assert "urbantwin.artefact.scratch" in names
    done = run(
        "import importlib, sys\nfor name in sys.argv[1:]:\n    importlib.import_module(name)",
        *names,
    )
    assert done.returncode == 0, done.stderr


def test_every_command_has_its_help() -> None:
    done = run(
        "import sys; from urbantwin.cli import main; sys.exit(max("
        "main([*one.split(','), '--help']) for one in sys.argv[1:]))",
        *COMMANDS,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage: urbantwin") >= len(COMMANDS)


def test_a_command_that_only_reads_runs() -> None:
    done = urbantwin("catalogue", "sensors")
    assert done.returncode == 0, done.stderr
    assert "OS1" in done.stdout


@pytest.mark.parametrize("command", ["build", *further("run")])
def test_writing_is_refused_in_one_line(command: str, tmp_path: Path) -> None:
    site = Path(__file__).parents[2] / "examples" / "two-avenues" / "site.yaml"
    done = urbantwin(command, str(site), "-o", str(tmp_path / "out"), "-q")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert "Windows" in done.stderr
    assert not list(tmp_path.iterdir())
