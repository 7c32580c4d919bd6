"""The command line, generated from the functions of `urbantwin.interface`."""

from urbantwin.cli.app import main

__all__ = ["main"]
