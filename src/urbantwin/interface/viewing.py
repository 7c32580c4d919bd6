"""The viewer: a page served on this machine, or saved as one file."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from urbantwin.artefact import check_file
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.place import AnyPath
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Result, Summary

if TYPE_CHECKING:
    from urbantwin.web import PageServer, SavedPage, Shown

__all__ = ["View", "view"]


class View(Result):
    """A view: a page being served, or written files.

    A page is served until `close` or the end of its ``with`` block.

    Attributes:
        address: address of the page; None if it is only saved.
        path: path of the saved page; None if it is served.
        rerun: the rerun recording; None if not requested.

    Example:
        >>> with ut.view("out/dataset") as page:
        ...     page.address
    """

    def __init__(
        self,
        shown: Shown,
        *,
        server: PageServer | None = None,
        saved: SavedPage | None = None,
        rerun: Path | None = None,
    ) -> None:
        self._shown, self._server, self._saved = shown, server, saved
        self.address = None if server is None else server.address
        self.path = None if saved is None else saved.path
        self.rerun = rerun

    @property
    def document(self) -> dict[str, Any]:
        """The page's document: sides, frames, sensors, events."""
        return self._shown.document()

    def packet(self, name: str) -> bytes:
        """Return a packet of the page, such as ``points/0/3``; see docs/reference/formats.md.

        Raises:
            KeyError: no packet has this name.
            InputError: the frame cannot be read.
        """
        return self._shown.packet(name)

    def close(self) -> None:
        """Stop serving."""
        if self._server is not None:
            self._server.close()

    def __enter__(self) -> View:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop serving."""
        self.close()

    def wait(self, ready: Callable[[], None] = lambda: None) -> None:
        """Serve until Ctrl-C, SIGTERM or SIGHUP, then close.

        Returns at once if nothing is served.

        Args:
            ready: called as soon as the signal handlers are set, to print the address.
        """
        if self._server is None:
            ready()
            return
        # The lock of an Event could be held by the waiting thread when a signal arrives.
        over: SimpleQueue[None] = SimpleQueue()
        before: dict[int, Any] = {}

        def end(_number: int, _frame: FrameType | None) -> None:
            over.put(None)

        if threading.current_thread() is threading.main_thread():
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # no SIGHUP on Windows
                number = getattr(signal, name, None)
                if number is None:
                    continue
                if signal.getsignal(number) not in (signal.SIG_IGN, None):
                    before[number] = signal.signal(number, end)
        try:
            ready()
            over.get()
        finally:
            self.close()
            for heard, former in before.items():
                signal.signal(heard, former)

    def __repr__(self) -> str:
        """Return the title and the address or path."""
        where = self.address or self.path or self.rerun
        return f"View of {self._shown.title} ({where})"

    def summary(self) -> Summary:
        """Return title, frames, notes and addresses."""
        document = self._shown.document()
        found: dict[str, Any] = {"shows": self._shown.title, "kind": self._shown.kind}
        if self._shown.sides:
            found["frames"] = [len(side["frames"]) for side in document["sides"]]
        damaged = [
            f"{frame['name']}: {frame['error']}"
            for side in document["sides"]
            for frame in side["frames"]
            if frame["error"]
        ]
        if damaged:
            found["damaged"] = damaged[:20]
        if self._shown.notes:
            found["notes"] = self._shown.notes
        if self._saved is not None:
            found["frames"] = self._saved.frames
            if self._saved.left_out:
                found["left_out"] = (
                    f"{self._saved.left_out} frames, for the page's size; "
                    "--frames and --every choose others"
                )
            found["size"] = f"{self._saved.bytes / 1e6:.1f} MB"
            found["page"] = str(self._saved.path)
        if self.rerun is not None:
            found["rerun"] = str(self.rerun)
        if self.address is not None:
            found["address"] = self.address
        return Summary(found)


@command
def view(
    path: AnyPath,
    other: AnyPath | None = None,
    *,
    save: AnyPath | None = None,
    frames: Annotated[str | None, "A:B"] = None,
    every: Annotated[int, Ge(1)] = 1,
    detections: AnyPath | None = None,
    report: AnyPath | None = None,
    twin: AnyPath | None = None,
    motion: AnyPath | None = None,
    port: int = 0,
    browser: bool = True,
    rerun: AnyPath | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> View:
    """Show a result or real frames in the browser.

    A page is served on 127.0.0.1 until the `View` is closed, or saved as one file. Twin, motion and
    coverage are found beside a dataset. docs/guide/sensors.md describes the page.

    Args:
        path: twin, motion, dataset, folder of real frames in any known layout, detections or report
            of ``compare`` beside their data, or a folder with a twin, a motion and a dataset in it.
        other: frames to show beside those of ``path`` with the same camera.
        save: HTML file to write instead of serving the page.
        frames: frames from number A to before B, counted from 0; all if not given, in a saved page
            as many as fit into 40 MB.
        every: show only every N-th of the frames.
        detections: detections, shown over the labels of ``path``: true positives, misses, false
            positives.
        report: report of ``compare`` whose worst places are listed.
        twin: twin to show frames in; the one beside them if not given.
        motion: motion whose signals are shown; the one beside the frames if not given.
        port: port of the server; 0 for any that is free.
        browser: open the page in the desktop's browser, where there is a desktop.
        rerun: recording for rerun to write, ``NAME.rrd``.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: an input is missing, damaged or cannot be shown, the port is not available, or
            rerun is not installed.

    Example:
        >>> ut.view("out/dataset", save="page.html", frames="0:20").path
        $ urbantwin view urbantwin-demo/dataset --save page.html --frames 0:20
    """
    from urbantwin.web import PageServer, open_shown, write_page, write_rerun
    from urbantwin.web.chosen_frames import ChosenFrames
    from urbantwin.web.page_document import page_file
    from urbantwin.web.rerun_file import check_rerun_file
    from urbantwin.web.wanted import Wanted

    wanted = Wanted(
        Path(path),
        _path(other),
        twin=_path(twin),
        motion=_path(motion),
        detections=_path(detections),
        report=_path(report),
        frames=ChosenFrames.of(frames, every),
    )
    inputs = [wanted.path, wanted.other, wanted.detections, wanted.report]
    target, recording = _path(save), _path(rerun)
    if target is not None:
        if target.suffix.lower() not in (".html", ".htm"):
            raise InputError("is not a name of a page", file=target, expected="NAME.html")
        check_file(target, kind="page", inputs=inputs)
    if recording is not None:
        check_rerun_file(recording, inputs)
    if recording is None or target is not None:
        page_file("page.js")
    with shown_stage("view", progress, brief=True) as tell:
        shown = open_shown(wanted, tell)
        if recording is not None:
            write_rerun(shown, recording, inputs=inputs, tell=tell)
        saved = None
        if target is not None:
            chosen = frames is not None or every > 1
            saved = write_page(shown, target, chosen=chosen, inputs=inputs, tell=tell)
    if target is not None or recording is not None:
        return View(shown, saved=saved, rerun=recording)
    found = View(shown, server=PageServer(shown, port))
    if browser and _on_a_desktop():
        _open(found.address or "", progress)
    return found


def _path(path: AnyPath | None) -> Path | None:
    return None if path is None else Path(path)


def _on_a_desktop() -> bool:
    """Return whether this is a local desktop session: a terminal, and a display or macOS."""
    if not (sys.stdout is not None and sys.stdout.isatty()):
        return False
    remote = os.environ.get("SSH_CONNECTION")
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return not remote and (sys.platform == "darwin" or bool(display))


def _open(address: str, progress: ShowProgress) -> None:
    import webbrowser

    opened = False
    with suppress(webbrowser.Error, OSError):
        opened = webbrowser.open(address)
    if not opened:
        tell_line("view: no browser opened; open the address by hand", progress)
