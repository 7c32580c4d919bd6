"""Writes an output and kills itself at the n-th thing that it asks of the file system.

``python swap_program.py FOLDER KIND EXCHANGE OLDER FIRST LAST``: for each n a process is forked, so
the imports are paid for once, until one asks for fewer things and ends. Prints ``n ended`` or
``n killed`` a line.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path

from urbantwin.artefact import replaced_file, replaced_folder, scratch, write_json

KEY = "0123456789abcdef"
#: Events of Python's that change what is on a disk (https://docs.python.org/3/library/audit_events.html).
CHANGES = ("os.rename", "os.mkdir", "os.rmdir", "os.remove", "shutil.rmtree")


def write(target: Path, kind: str, number: int) -> None:
    """Write a small artefact: a folder, a folder that is resumed, or a file."""
    if kind == "file":
        with replaced_file(target, kind="obj") as path:
            path.with_suffix(".mtl").write_text(f"colours {number}")
            path.write_text(f"shape {number}")
        return
    key = KEY[:-1] + str(number) if kind == "resumed" else None
    with replaced_folder(target, kind="twin", key=key) as folder:
        (folder / "deep").mkdir(exist_ok=True)
        for name in ("deep/a", "b", "c"):
            (folder / name).write_text(f"{name} {number}")
        if number == 2:  # the older one has a file that the new one lacks
            (folder / "d").write_text("more")
        write_json(folder / "twin.json", {"kind": "twin", "number": number})


def kill_at(n: int, *, exchange: bool) -> None:
    """Let this process kill itself before the n-th change of the disk from now on."""
    count = 0

    def change(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_ACCMODE
        if event in CHANGES or writes:
            count += 1
            if count == n:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(change)
    exchanged = scratch._exchange

    def counted(one: Path, other: Path) -> bool:  # ctypes tells no audit hook
        change("os.rename", ())
        return exchange and exchanged(one, other)

    scratch._exchange = counted


def main() -> None:
    """Fork a process for every n."""
    folder, kind, exchange, older, first, last = sys.argv[1:]
    for n in range(int(first), int(last)):
        place = Path(folder) / str(n)
        place.mkdir()
        target = place / ("scene.obj" if kind == "file" else "twin")
        if older == "older":
            write(target, kind, 2)
        process = os.fork()
        if not process:
            kill_at(n, exchange=exchange == "exchange")
            write(target, kind, 1)
            os._exit(0)
        status = os.waitpid(process, 0)[1]
        how = "killed" if os.WIFSIGNALED(status) else "ended"
        shutil.copytree(place, Path(folder) / f"{n} left", symlinks=True)
        write(target, kind, 1)  # the next run
        sys.stdout.write(f"{n} {how} {os.waitstatus_to_exitcode(status)}\n")
        if how == "ended":
            break


if __name__ == "__main__":
    main()
