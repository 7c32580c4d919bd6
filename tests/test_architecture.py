"""The floors of docs/architecture.md: a package imports only packages above it."""

import ast
import graphlib
import re
from collections.abc import Iterator
from pathlib import Path

from urbantwin.cli.commands import GROUPS

from .source_imports import MODULES, ROOT, SOURCE, imports_of

INTERFACE = "urbantwin.interface."


def floors() -> list[str]:
    """The packages in the order in which the document lists them."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    table = text.split("## The floors")[1].split("\n## ")[0]
    first_cells = re.findall(r"^\| (`.*?) \|", table, flags=re.MULTILINE)
    return [name for cell in first_cells for name in re.findall(r"`(\w+)`", cell)]


def names_a_group(module: Path) -> bool:
    """Whether a module names the functions of a group, which are imported when asked for."""
    return (
        module.parent.parent == SOURCE
        and module.name == "__init__.py"
        and (module.parent.name in GROUPS)
    )


def imported_packages(module: Path) -> Iterator[tuple[str, int]]:
    """Every part of urbantwin that a module imports, inside functions too, with the line."""
    for one in imports_of(module):
        if one.typing and names_a_group(module) and (one.source or "").startswith(INTERFACE):
            continue
        assert one.level == 0, f"{module}:{one.line}: a relative import"
        names = one.names if one.source is None else (one.source,)
        if one.source == "urbantwin":
            names = tuple(f"urbantwin.{name}" for name in one.names)
        for name in names:
            parts = name.split(".")
            if parts[0] == "urbantwin" and len(parts) > 1 and parts[1] != "__version__":
                yield parts[1], one.line


def test_the_document_lists_every_package_and_no_other() -> None:
    on_disk = {path.stem for path in SOURCE.glob("*.py")} - {"__init__", "__main__"}
    on_disk |= {path.parent.name for path in SOURCE.glob("*/__init__.py")}
    assert sorted(floors()) == sorted(on_disk)


def test_a_package_imports_only_packages_above_it() -> None:
    order = floors()
    wrong = []
    for module in MODULES:
        here = module.relative_to(SOURCE).parts[0].removesuffix(".py")
        if here == "__main__":  # ``python -m urbantwin``
            here = "cli"
        if here == "__init__":  # ``import urbantwin``
            here = "catalogue"
        for package, line in imported_packages(module):
            if package not in order:
                wrong.append(f"{module}:{line}: imports {package}")
            elif order.index(package) > order.index(here):
                wrong.append(f"{module}:{line}: {here} imports {package}, which is below it")
    assert not wrong, "\n".join(wrong)


def test_modules_import_each_other_in_no_circle() -> None:
    dotted = {".".join(("urbantwin", *one.relative_to(SOURCE).parts)): one for one in MODULES}
    modules = {name.removesuffix(".py").removesuffix(".__init__"): dotted[name] for name in dotted}
    needs: dict[str, set[str]] = {}
    for name, module in modules.items():
        imported = [one for one in imports_of(module) if not one.typing and one.source]
        pairs = [
            (f"{one.source}.{part}", str(one.source)) for one in imported for part in one.names
        ]
        needs[name] = {inner if inner in modules else outer for inner, outer in pairs}
    graphlib.TopologicalSorter(needs).prepare()  # CycleError names the circle


def test_a_package_of_a_groups_name_lists_its_commands_and_imports_none() -> None:
    for group, (_, commands) in GROUPS.items():
        file = SOURCE / group / "__init__.py"
        if file.is_file():
            upward = [one for one in imports_of(file) if (one.source or "").startswith(INTERFACE)]
            assert all(one.typing for one in upward)
            names = {name for one in upward for name in one.names}
            assert {name for name in names if name[0].islower()} == set(commands)


def test_the_commands_call_only_the_interface() -> None:
    allowed = {"cli", "interface", "errors", "progress", "interruption"}
    wrong = [
        f"{module}:{line}: imports {package}"
        for module in sorted((SOURCE / "cli").glob("*.py"))
        for package, line in imported_packages(module)
        if package not in allowed
    ]
    assert not wrong, "\n".join(wrong)


def test_only_the_command_line_prints_and_exits() -> None:
    # SUMO's worker is a program of its own: its stdout is how it speaks to us. Progress is shown
    # on stderr, for the commands and for Python alike.
    programs = {SOURCE / "__main__.py", SOURCE / "traffic" / "sumo" / "worker.py"}
    programs |= {SOURCE / "interface" / "stage.py", SOURCE / "exports" / "carla" / "live.py"}
    for module in MODULES:
        if module.is_relative_to(SOURCE / "cli") or module in programs:
            continue
        text = module.read_text()
        if "print(" not in text and "exit(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            match node:
                case (
                    ast.Call(func=ast.Name(id="print" | "exit"))
                    | ast.Call(func=ast.Attribute(value=ast.Name(id="sys"), attr="exit"))
                ):
                    raise AssertionError(f"{module}:{node.lineno}")


def test_the_walks_through_roads_name_functions_that_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    walks = " ".join(text.split("### Three walks")[1].split("\n## ")[0].split())
    steps = re.findall(r"`([\w/]+\.py)`: `(\w+)`", walks)
    assert len(steps) > 10
    for file, function in steps:
        tree = ast.parse((SOURCE / "roads" / file).read_text())
        names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert function in names, f"{file} has no {function}"
