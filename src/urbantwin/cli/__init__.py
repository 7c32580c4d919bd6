"""The command line: one file per command, no logic."""

from urbantwin.cli.app import app, main

__all__ = ["app", "main"]
