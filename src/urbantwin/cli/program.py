"""Commands of click, made from the functions that they call."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import click

from urbantwin import __version__
from urbantwin.cli.commands import GROUPS, MAIN_ROAD, command_at
from urbantwin.cli.console import Console
from urbantwin.interface.command import Parameter

__all__ = ["Group", "program"]

_CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
#: Not options: `--quiet` says whether progress is shown.
_OF_PYTHON = ("progress",)
#: What ``-o`` is short for: the first of these that a command has.
_OUTPUTS = ("out", "save", "page")
#: How the negative of a switch is written, where it is not ``--no-NAME``.
_NEGATIVES = {"fused": "separate"}
#: The headings of help, with their parameters; what stands nowhere here is under "Options".
_HEADINGS = {
    "Output": "out to version save page pictures picture report overwrite storage split shares gap "
    "thin rerun csv flow keep_clock keep_names force browser port layouts drawn fps speed width",
    "Sensors": "rig nodes sensor fused ride effects backend background fuse columns rate pose "
    "points_in elevations intensity_scale interval within only ego",
    "Time": "start stop every seconds time_of_day step",
    "Weather and light": "weather visibility wet_ground sun_elevation sun_azimuth",
    "Training": "steps minutes batch cell reach intensity without heads in_order second_look "
    "drives judging events task",
    "Network": "use also sources cache offline key_env allow_key",
    "Speed": "workers ray device plan most",
}
_HEADING_OF = {name: title for title, names in _HEADINGS.items() for name in names.split()}


class Group(click.Group):
    """Commands whose functions are imported on first use."""

    def __init__(self, name: str, group: str = "", **settings: Any) -> None:  # noqa: ANN401
        super().__init__(
            name, context_settings=_CONTEXT, invoke_without_command=True, callback=_show_help,
            subcommand_metavar="COMMAND",
            **settings,
        )  # fmt: skip
        self.part = group
        self.names = GROUPS[group][1] if group else (*MAIN_ROAD, *GROUPS)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, in the order of help."""
        return list(self.names)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command or a group, or nothing."""
        if cmd_name not in self.names:
            return None
        if not self.part and cmd_name in GROUPS:
            return Group(cmd_name, cmd_name, help=f"{GROUPS[cmd_name][0]}.")
        return _Leaf(self.part, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that is meant; say in which group it is if it is in another."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            places = [
                f"urbantwin {group} {args[0]}" for group in GROUPS if args[0] in GROUPS[group][1]
            ]
            if places:
                raise click.UsageError(
                    f"no command {args[0]!r}: {' or '.join(places)}", ctx
                ) from error
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the first line of every command."""
        commands = [
            (name, command_at(self.part, name).title.rstrip("."))
            for name in self.names
            if self.part or name in MAIN_ROAD
        ]
        with formatter.section("Commands"):
            formatter.write_dl(commands)
        if not self.part:
            with formatter.section("Groups of commands"):
                formatter.write_dl([(name, title) for name, (title, _) in GROUPS.items()])


class _Leaf(click.Command):
    """One command: the options and the help of a function."""

    def __init__(self, group: str, name: str) -> None:
        self.group, self.source = group, command_at(group, name)
        self.taken = [one for one in self.source.parameters if one.name not in _OF_PYTHON]
        output = next((one for one in _OUTPUTS if one in {p.name for p in self.taken}), "")
        super().__init__(
            name,
            context_settings=_CONTEXT,
            callback=self.call,
            help=_plain(f"{self.source.title}\n\n{self.source.description}"),
            params=[
                *(_parameter(one, short=one.name == output) for one in self.taken),
                click.Option(["--quiet", "-q"], is_flag=True, help="Print nothing but errors."),
                click.Option(
                    ["--json", "as_json"],
                    is_flag=True,
                    help="Print the result as one JSON document.",
                ),
            ],
        )

    def call(self, *, quiet: bool, as_json: bool, **given: Any) -> None:  # noqa: ANN401
        """Call the function with what was given, and print its result."""
        for one in self.taken:
            one.check(given[one.name])
        function = getattr(import_module(self.source.module), self.source.name)
        asked = {name: value for name, value in given.items() if value not in (None, ())}
        Console(quiet=quiet, as_json=as_json).result(function(**asked, progress=not quiet))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings, and the example."""
        rows: dict[str, list[tuple[str, str]]] = {"Input": [], **{one: [] for one in _HEADINGS}}
        for one, made in zip(self.taken, self.params, strict=False):
            heading = "Input" if isinstance(made, click.Argument) else _HEADING_OF.get(one.name)
            rows.setdefault(heading or "Options", []).append(_row(one, made))
        general = [
            record for made in [*self.params[len(self.taken) :], self.get_help_option(ctx)]
            if made and (record := made.get_help_record(ctx))
        ]  # fmt: skip
        for heading, written in {**rows, "General": general}.items():
            if written:
                with formatter.section(heading):
                    formatter.write_dl(written, col_max=26)
        with formatter.section("Example"):
            formatter.write(f"{'':{formatter.current_indent}}{self.source.example}\n")


def _parameter(one: Parameter, *, short: bool) -> click.Parameter:
    if one.positional:
        return click.Argument(
            [one.name], required=one.required, nargs=-1 if one.many else 1, metavar=_metavar(one)
        )
    name = one.option
    if one.kind == "bool":
        negative = f"/--{_NEGATIVES.get(one.name, f'no-{name[2:]}')}"
        switch = name + (negative if one.default is not False else "")
        return click.Option([switch, one.name], is_flag=True, default=None)
    kind: Any = {"int": click.INT, "float": click.FLOAT}.get(str(one.kind), click.STRING)
    return click.Option(
        [name, *(["-o"] if short else []), one.name], nargs=one.size, multiple=one.many,
        type=click.Choice(one.kind) if isinstance(one.kind, tuple) else kind,
        required=one.required, metavar=_metavar(one),
    )  # fmt: skip


def _metavar(one: Parameter) -> str:
    """Return how help writes a value."""
    if one.metavar:
        return one.metavar
    if one.positional:
        name = one.name.upper() + ("..." if one.many else "")
        return name if one.required else f"[{name}]"
    if isinstance(one.kind, tuple):
        return "|".join(one.kind)
    return " ".join(
        [{"path": "PATH", "int": "N", "float": "X", "str": "TEXT"}[one.kind]] * one.size
    )


def _row(one: Parameter, made: click.Parameter) -> tuple[str, str]:
    """Return how an argument or option is written, and its help with limits and default."""
    if isinstance(made, click.Argument):
        written = str(made.metavar)
    else:
        names = sorted(made.opts, key=len)
        written = ", ".join(names)
        if made.secondary_opts:
            written += " / " + ", ".join(made.secondary_opts)
        elif one.kind != "bool":
            written += f" {made.metavar}"
    notes = list(_notes(one))
    text = _plain(one.help)
    if "." not in text.partition(" ")[0]:  # no name of a file
        text = text[:1].upper() + text[1:]
    return written, text + (f"  [{'; '.join(notes)}]" if notes else "")


def _notes(one: Parameter) -> Iterator[str]:
    if one.required and not one.positional:
        yield "required"
    if one.limits:
        yield one.limits
    if one.default is True:
        yield "default: yes"
    elif one.default not in (None, False, (), ""):
        values = one.default if isinstance(one.default, tuple) else (one.default,)
        yield "default: " + " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in values)
    if one.many and not one.positional:
        yield "may be repeated"


def _plain(text: str) -> str:
    """Return a docstring's text without its marks for code."""
    return text.replace("``", "").replace("`", "")


@click.pass_context
def _show_help(context: click.Context) -> None:
    """Print the help of a group that is given no command."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def program() -> Group:
    """Return the whole command line."""
    whole = Group("urbantwin", help="Turn a street intersection into LiDAR data with labels.")
    return click.version_option(__version__, message="urbantwin %(version)s")(whole)
