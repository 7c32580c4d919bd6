"""The command line run: its exit code, and errors turned into one line."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence

import click

from urbantwin.cli.console import error_line, show_any_letter
from urbantwin.cli.program import program
from urbantwin.errors import InputError, UrbanTwinError, limit_reached
from urbantwin.interruption import EXIT_CODE as EXIT_INTERRUPTED
from urbantwin.interruption import unwinds

__all__ = ["main"]

EXIT_FAILED = 1
EXIT_WRONG_INPUT = 2


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
            if not sys.warnoptions:  # libraries' remarks to programmers, unless `python -W` asks
                warnings.simplefilter("ignore")
            given = list(sys.argv[1:] if arguments is None else arguments)
            commands = program()
            # Not `commands.main`, which writes an empty line when it is interrupted.
            with commands.make_context("urbantwin", given) as running:
                code = commands.invoke(running)
        sys.stdout.flush()
    except click.exceptions.Exit as end:  # after --help or --version
        code = end.exit_code
    except InputError as error:
        limit = limit_reached(error)
        error_line(limit or error)
        code = EXIT_FAILED if limit else EXIT_WRONG_INPUT
    except UrbanTwinError as error:
        error_line(limit_reached(error) or error)
        code = EXIT_FAILED
    except click.ClickException as error:  # a command, an option or a value that is not there
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "urbantwin"
        error_line(f"{error.format_message()} ({command} --help)")
        code = EXIT_WRONG_INPUT
    except BrokenPipeError:
        # The reader of stdout has gone (`| head`). Python flushes once more at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_FAILED
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
