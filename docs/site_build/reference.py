"""The reference: pages of mkdocstrings for the public names, and the commands' own help."""

import ast
from pathlib import Path

import click
import typer

import urbantwin
from urbantwin.cli import app

__all__ = ["command_page", "python_pages"]

PAGES = {
    "functions.md": ("Functions", "Each is a [command](commands.md), too."),
    "results.md": ("Results", "What functions return. Each stands for its folder or file."),
    "tables_and_errors.md": ("Tables and errors", "What results hold, and what is raised."),
}


def python_pages() -> dict[str, str]:
    """Return the pages of the public names of `urbantwin`, as mkdocstrings takes them.

    A module of the interface has a command's function and what it returns, so what stands beside a
    function is a result. The package's own imports are read, not followed: that is quicker.
    """
    names = {page: set[str]() for page in PAGES}
    for node in ast.walk(ast.parse(Path(urbantwin.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("urbantwin."):
            told = {alias.name for alias in node.names} & set(urbantwin.__all__)
            functions = {name for name in told if name[0].islower()}
            names["functions.md"] |= functions
            names["results.md" if functions else "tables_and_errors.md"] |= told - functions
    return {
        page: "\n".join(
            (f"# {title}\n\n{told}\n", *(f"::: urbantwin.{name}" for name in sorted(names[page])))
        )
        for page, (title, told) in PAGES.items()
    }


def command_page() -> str:
    """Return the help of every command."""
    group = typer.main.get_command(app)
    with click.Context(group, info_name="urbantwin") as context:
        parts = [
            "# Help of each command\n\nWhat `urbantwin COMMAND --help` prints; "
            "[a table](../commands.md) says what each is for."
        ]
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            with click.Context(command, info_name=f"urbantwin {name}", terminal_width=100) as own:
                parts.append(f"## {name}\n\n```text\n{command.get_help(own).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"
