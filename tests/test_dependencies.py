"""What the package imports is what it declares, and the lock files hold all of it."""

import importlib.util
import re
import sys
import tomllib
from functools import cache
from importlib import metadata

import pytest

from urbantwin.extras import EXTRAS

from .source_imports import MODULES, ROOT, imports_of

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
#: Not imported: run as a program, loaded by ctypes, or only its files are read.
ONLY_FILES = {"eclipse-sumo", "embreex", "tzdata"}
#: The package itself, and pydantic's other half, of which pydantic names the one version it needs.
NOT_DECLARED = {"urbantwin", "pydantic_core"}
#: Extras for developers: nothing of them is imported by the package.
DEVELOPMENT = {"all", "dev", "docs"}
OPTIONAL = {
    extra: lines
    for extra, lines in PROJECT["optional-dependencies"].items()
    if extra not in DEVELOPMENT
}


def plain(name: str) -> str:
    """A distribution's name as PyPI compares it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def named(requirements: list[str]) -> set[str]:
    return {plain(re.split(r"[^A-Za-z0-9._-]", line)[0]) for line in requirements}


@cache
def packages_distributions() -> dict[str, list[str]]:
    """The distributions of every module that is installed, which takes a second to find."""
    return dict(metadata.packages_distributions())


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
    declared = named(PROJECT["dependencies"]).union(*map(named, OPTIONAL.values()))
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


def in_dev() -> list[str]:
    """Extras that the extra for developers contains: "urbantwin[airborne,bags]"."""
    (line,) = [one for one in PROJECT["optional-dependencies"]["dev"] if "urbantwin[" in one]
    return line[len("urbantwin[") : line.index("]")].split(",")


@pytest.mark.parametrize(
    ("lock", "extras"),
    [("requirements.lock", ()), ("requirements-dev.lock", (*in_dev(), "dev"))],
)
def test_the_lock_files_hold_every_dependency(lock: str, extras: tuple[str, ...]) -> None:
    lines = (ROOT / lock).read_text().replace("\\\n", "").splitlines()
    pinned = r"^[a-z0-9.-]+==[^ ]+( ; .+?)?( +--hash=sha256:[0-9a-f]{64})+$"
    assert all(re.match(pinned, line) for line in lines)
    wanted = named(PROJECT["dependencies"])
    for extra in extras:
        wanted |= named(PROJECT["optional-dependencies"][extra])
    assert wanted - {"urbantwin"} <= named(lines)


@pytest.mark.parametrize("extra", sorted(EXTRAS))
def test_an_extra_brings_the_modules_that_are_looked_for(extra: str) -> None:
    owners = packages_distributions()
    brought = named(PROJECT["optional-dependencies"][extra])
    brought |= {"cmeel"} & {name.split("-")[0] for name in brought}  # it brings itself for Assimp
    for module in EXTRAS[extra]:
        distributions = {plain(name) for name in owners.get(module, [module])}
        assert distributions & brought, f"{extra} does not bring {module}"


def test_all_brings_the_optional_formats_and_engines() -> None:
    lines = PROJECT["optional-dependencies"]["all"]
    extras = {extra for line in lines for extra in re.findall(r"[a-z0-9]+", line.split("]")[0])}
    assert extras - {"urbantwin"} == {
        *("airborne", "bags", "detector", "e57", "fbx", "film", "gltf", "ray", "tune")
    }


def test_a_lock_file_without_some_hashes_is_whole() -> None:
    """SUMO's larger wheels are left out by `tools/lighter_sumo.py`, wherever their hashes stand."""
    spec = importlib.util.spec_from_file_location("tool", ROOT / "tools" / "lighter_sumo.py")
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    hashes = [digit * 64 for digit in "abcd"]
    lock = "".join(f" \\\n    --hash=sha256:{one}" for one in hashes)
    left = tool.without(f"libsumo==1.28.0{lock}\nlxml==6.1.3\n", {hashes[0], hashes[3]})
    kept = "".join(f" \\\n    --hash=sha256:{one}" for one in hashes[1:3])
    assert left == f"libsumo==1.28.0{kept}\nlxml==6.1.3\n"
