"""The command ``urbantwin``, and ``python -m urbantwin``."""

import gc
from typing import NoReturn

from urbantwin.interruption import ends_at_once, leave

__all__ = ["main"]

ends_at_once()  # before the imports of the commands, which take a while
# What is imported stays, and a tenth of the time would go into looking for garbage in it: looked
# for after ten times as many objects as Python does by itself.
gc.set_threshold(7_000, 10, 10)


def main() -> NoReturn:
    """Run the command line, and end with its exit code; see `urbantwin.cli.main`."""
    from urbantwin.cli import main as run

    leave(run())


if __name__ == "__main__":
    main()
