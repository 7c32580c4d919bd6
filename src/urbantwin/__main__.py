"""``python -m urbantwin`` is the command ``urbantwin``."""

from urbantwin.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
