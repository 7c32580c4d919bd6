"""The reference: pages of mkdocstrings for the public names, and the commands' own help."""

import inspect
import re

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
    """Return the pages of the public names of `urbantwin`, as mkdocstrings takes them."""
    names = {page: list[str]() for page in PAGES}
    returned = _returned()
    for name in urbantwin.__all__:
        if name.startswith("__"):
            continue
        if not inspect.isclass(getattr(urbantwin, name)):
            names["functions.md"].append(name)
        else:
            names["results.md" if name in returned else "tables_and_errors.md"].append(name)
    return {
        page: "\n".join(
            (f"# {title}\n\n{told}\n", *(f"::: urbantwin.{name}" for name in names[page]))
        )
        for page, (title, told) in PAGES.items()
    }


def _returned() -> set[str]:
    """Return the names of what the functions return, as their signatures say."""
    signatures = (
        inspect.signature(value)
        for name in urbantwin.__all__
        if inspect.isfunction(value := getattr(urbantwin, name))
    )
    words = re.findall(r"\w+", " ".join(str(one.return_annotation) for one in signatures))
    return set(urbantwin.__all__) & set(words)


def command_page() -> str:
    """Return the help of every command."""
    group = typer.main.get_command(app)
    with click.Context(group, info_name="urbantwin") as context:
        parts = ["# Commands\n\nWhat `urbantwin COMMAND --help` prints."]
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            with click.Context(command, info_name=f"urbantwin {name}", terminal_width=100) as own:
                parts.append(f"## {name}\n\n```text\n{command.get_help(own).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"
