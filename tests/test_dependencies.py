"""What the package imports is what it declares, and the lock files hold all of it."""

import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions

import pytest

from .source_imports import MODULES, ROOT, imports_of

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
#: Not imported: run as a program, loaded by ctypes, only its files are read, or optuna imports it.
ONLY_FILES = {"cmaes", "cmeel-assimp", "eclipse-sumo", "embreex", "tzdata"}
#: The package itself, and pydantic's other half, of which pydantic names the one version it needs.
NOT_DECLARED = {"urbantwin", "pydantic_core"}
#: Extras of what only some users need: modules that import them are imported where they are.
EXTRAS = ("carla", "warp", "learn", "ray", "rerun")


def plain(name: str) -> str:
    """A distribution's name as PyPI compares it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def named(requirements: list[str]) -> set[str]:
    return {plain(re.split(r"[^A-Za-z0-9._-]", line)[0]) for line in requirements}


@cache
def imported() -> dict[str, str]:
    """Top-level modules that the package imports, and a file that does."""
    found = {}
    for path in MODULES:
        for one in imports_of(path):
            if not one.typing:
                names = one.names if one.source is None else (one.source,)
                found |= {name.split(".")[0]: path.name for name in names}
    return found


def test_every_import_is_declared() -> None:
    declared = named(PROJECT["dependencies"])
    for extra in EXTRAS:
        declared |= named(PROJECT["optional-dependencies"][extra])
    owners = packages_distributions()
    for module, path in imported().items():
        if module in sys.stdlib_module_names or module in NOT_DECLARED:
            continue
        distributions = {plain(name) for name in owners.get(module, [module])}
        assert distributions & declared, f"{path} imports {module}, of {distributions}"


def test_every_declared_dependency_is_imported() -> None:
    owners = packages_distributions()
    used = {plain(name) for module in imported() for name in owners.get(module, [])}
    assert named(PROJECT["dependencies"]) - used <= ONLY_FILES


@pytest.mark.parametrize(
    ("lock", "extras"),
    [("requirements.lock", ("demo",)), ("requirements-dev.lock", ("demo", "dev"))],
)
def test_the_lock_files_hold_every_dependency(lock: str, extras: tuple[str, ...]) -> None:
    lines = (ROOT / lock).read_text().replace("\\\n", "").splitlines()
    pinned = r"^[a-z0-9.-]+==[^ ]+( ; .+?)?( +--hash=sha256:[0-9a-f]{64})+$"
    assert all(re.match(pinned, line) for line in lines)
    wanted = named(PROJECT["dependencies"])
    for extra in extras:
        wanted |= named(PROJECT["optional-dependencies"][extra])
    assert wanted <= named(lines)
