"""The commands put together, and errors turned into one line and an exit code."""

from __future__ import annotations

import copy
import functools
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated

import typer
from typer.main import get_command

from urbantwin import __version__
from urbantwin.cli import (
    actors,
    align,
    background,
    build,
    calibrate,
    campaign,
    card,
    carla,
    check,
    compare,
    coverage,
    curriculum,
    demo,
    detect,
    discover,
    evaluate,
    explain,
    export,
    film,
    fuse,
    improve,
    init,
    inspect,
    label,
    observe,
    place,
    pretrain,
    record,
    replay,
    reproduce,
    run,
    sensors,
    sequence,
    split,
    study,
    suite,
    teach,
    track,
    traffic,
    train,
    tune,
    vary,
    verify,
    view,
)
from urbantwin.cli.console import error_line, show_any_letter
from urbantwin.errors import InputError, UrbanTwinError, limit_reached
from urbantwin.interruption import EXIT_CODE as EXIT_INTERRUPTED
from urbantwin.interruption import unwinds

__all__ = ["app", "main"]

EXIT_FAILED = 1
EXIT_WRONG_INPUT = 2

app = typer.Typer(
    name="urbantwin",
    invoke_without_command=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"urbantwin {__version__}")
        raise typer.Exit


@app.callback()
def urbantwin(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_print_version, help="Print it."),
    ] = False,
) -> None:
    """From a real street intersection to a LiDAR digital twin and labelled training data."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def _examples(lines: str) -> str:
    # \b keeps the line breaks of a paragraph of help.
    return "\b\nExamples:\n" + "".join(f"  {line}\n" for line in lines.strip().splitlines())


# In the order of a person's work, which is the order in which `--help` lists them.
for command, examples in (
    (demo.demo, demo.EXAMPLES),
    (init.init, init.EXAMPLES),
    (check.check, check.EXAMPLES),
    (run.run, run.EXAMPLES),
    (build.build, build.EXAMPLES),
    (traffic.traffic, traffic.EXAMPLES),
    (replay.replay, replay.EXAMPLES),
    (calibrate.calibrate, calibrate.EXAMPLES),
    (film.film, film.EXAMPLES),
    (record.record, record.EXAMPLES),
    (split.split, split.EXAMPLES),
    (sequence.sequence, sequence.EXAMPLES),
    (view.view, view.EXAMPLES),
    (vary.vary, vary.EXAMPLES),
    (suite.suite, suite.EXAMPLES),
    (curriculum.curriculum, curriculum.EXAMPLES),
    (study.study, study.EXAMPLES),
    (campaign.campaign, campaign.EXAMPLES),
    (coverage.coverage, coverage.EXAMPLES),
    (place.place, place.EXAMPLES),
    (align.align, align.EXAMPLES),
    (background.background, background.EXAMPLES),
    (discover.discover, discover.EXAMPLES),
    (observe.observe, observe.EXAMPLES),
    (teach.teach, teach.EXAMPLES),
    (pretrain.pretrain, pretrain.EXAMPLES),
    (train.train, train.EXAMPLES),
    (detect.detect, detect.EXAMPLES),
    (label.label, label.EXAMPLES),
    (improve.improve, improve.EXAMPLES),
    (track.track, track.EXAMPLES),
    (tune.tune, tune.EXAMPLES),
    (compare.compare, compare.EXAMPLES),
    (evaluate.evaluate, evaluate.EXAMPLES),
    (explain.explain, explain.EXAMPLES),
    (fuse.fuse, fuse.EXAMPLES),
    (export.export, export.EXAMPLES),
    (carla.carla, carla.EXAMPLES),
    (card.card, card.EXAMPLES),
    (inspect.inspect, inspect.EXAMPLES),
    (verify.verify, verify.EXAMPLES),
    (reproduce.reproduce, reproduce.EXAMPLES),
    (sensors.sensors, sensors.EXAMPLES),
    (actors.actors, actors.EXAMPLES),
):
    app.command(epilog=_examples(examples))(command)

_NAMES = frozenset(one.callback.__name__ for one in app.registered_commands if one.callback)


@functools.cache
def _program(name: str) -> Callable[..., object]:
    """Return what runs the command of a name; all of them if there is none of that name.

    The options of 40 commands take longer to put together than most of them to say what is wrong.
    """
    part = copy.copy(app)
    if name in _NAMES:
        part.registered_commands = [
            one for one in app.registered_commands if one.callback and one.callback.__name__ == name
        ]
    return get_command(part)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Returns:
        0 when all went well, 1 when a stage failed, 2 when something given was wrong,
        130 when it was interrupted: by Ctrl-C, SIGTERM or SIGHUP.
    """
    show_any_letter()
    with unwinds() as interruptions:
        try:
            try:
                code = _run(arguments)
            finally:
                interruptions.heard = False  # a second one must not cut what is said of the first
        except KeyboardInterrupt:
            code = EXIT_INTERRUPTED
        except Exception:
            if not interruptions.count:
                raise
            code = EXIT_INTERRUPTED  # a library made something else of it
        if interruptions.count:
            code = EXIT_INTERRUPTED
        if code == EXIT_INTERRUPTED:
            error_line("interrupted")
    return code


def _run(arguments: Sequence[str] | None) -> int:
    try:
        with warnings.catch_warnings():
            if (
                not sys.warnoptions
            ):  # libraries' remarks to programmers, unless asked for (python -W)
                warnings.simplefilter("ignore")
            given = list(sys.argv[1:] if arguments is None else arguments)
            program = _program(given[0] if given else "")
            code = program(given, prog_name="urbantwin", standalone_mode=False)
        sys.stdout.flush()
    except InputError as error:
        limit = limit_reached(error)
        error_line(limit or error)
        code = EXIT_FAILED if limit else EXIT_WRONG_INPUT
    except UrbanTwinError as error:
        error_line(limit_reached(error) or error)
        code = EXIT_FAILED
    except typer.TyperException as error:  # a command, an option or a value that is not there
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "urbantwin"
        error_line(f"{error.format_message()} ({command} --help)")
        code = EXIT_WRONG_INPUT
    except BrokenPipeError:
        # The reader of stdout has gone (`| head`). Python flushes once more at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_FAILED
    except typer.Abort:
        code = EXIT_INTERRUPTED
    except Exception as error:
        limit = limit_reached(error)
        if limit is None and not isinstance(error, OSError):
            raise
        shown: object = error
        if isinstance(error, OSError) and error.filename:
            shown = f"{error.filename}: {error.strerror}"
        error_line(limit or shown)
        code = EXIT_FAILED
    return code if isinstance(code, int) else 0
