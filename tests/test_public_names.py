"""What each package says of itself: a purpose, and a sorted list of public names that exist."""

import importlib
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "urbantwin"
PACKAGES = sorted(
    ".".join(("urbantwin", *path.parent.relative_to(SOURCE).parts))
    for path in SOURCE.rglob("__init__.py")
)
EMPTY_NAMES = {"base", "common", "core", "helpers", "misc", "tools", "util", "utils"}


def constants_classes_functions(name: str) -> tuple[int, str]:
    """The order in which ruff sorts public names, too (RUF022)."""
    return (0 if name.isupper() else 1 if name[0].isupper() else 2, name)


def test_packages_have_a_purpose_and_sorted_public_names() -> None:
    for name in PACKAGES:
        package = importlib.import_module(name)
        assert package.__doc__, f"{name}: no docstring"
        names = list(package.__all__)
        assert names == sorted(names, key=constants_classes_functions), name
        assert len(set(names)) == len(names), name
        for public in names:
            assert hasattr(package, public), f"{name}: {public}"


def test_modules_are_named_after_what_they_hold() -> None:
    named = {path.stem for path in SOURCE.rglob("*.py")} | {
        path.name for path in SOURCE.rglob("*") if path.is_dir()
    }
    assert not named & EMPTY_NAMES


def test_every_folder_with_modules_is_a_package() -> None:
    folders = {path.parent for path in SOURCE.rglob("*.py")}
    assert all((folder / "__init__.py").exists() for folder in folders)


def test_modules_stay_short() -> None:
    lengths = {path: len(path.read_text().splitlines()) for path in SOURCE.rglob("*.py")}
    assert max(lengths.values()) <= 500, max(lengths, key=lambda path: lengths[path])
