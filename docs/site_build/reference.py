"""The reference: pages of mkdocstrings for the public names, and the commands' own help."""

from importlib import import_module

import click

from urbantwin.cli.commands import GROUPS, every_command
from urbantwin.cli.program import program

__all__ = ["command_page", "python_pages"]


def python_pages() -> dict[str, str]:
    """Return the pages of the public names: of the main road, and of each group.

    What a group's package names besides its commands and their results is not public.
    """
    pages = {"main_road.md": _page("urbantwin", "The main road", "What `ut` itself has.")}
    for group, (title, _) in GROUPS.items():
        pages[f"{group}.md"] = _page(f"urbantwin.{group}", f"ut.{group}", f"{title}.")
    return pages


def _page(package: str, title: str, told: str) -> str:
    module = import_module(package)
    names = [
        name
        for name in module.__all__
        if name not in GROUPS and not name.startswith("__")
        if package == "urbantwin" or _of_interface(vars(module)["_modules"].get(name, ""))
    ]
    names.sort(key=lambda name: (name[0].isupper(), name))
    return "\n".join((f"# {title}\n\n{told}\n", *(f"::: {package}.{name}" for name in names)))


def _of_interface(module: str) -> bool:
    return module.startswith("urbantwin.interface.")


def command_page() -> str:
    """Return the help of every command."""
    parts = [
        "# Help of each command\n\nWhat `urbantwin COMMAND --help` prints; "
        "[a table](../commands.md) says what each is for."
    ]
    whole = program()
    with click.Context(whole, info_name="urbantwin") as context:
        for group, name in every_command():
            above = whole.get_command(context, group) if group else whole
            assert isinstance(above, click.Group)
            command = above.get_command(context, name)
            assert command is not None
            words = f"{group} {name}".strip()
            with click.Context(command, info_name=f"urbantwin {words}", terminal_width=100) as own:
                parts.append(f"## {words}\n\n```text\n{command.get_help(own).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"
