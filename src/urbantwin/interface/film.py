"""Films of motions, to inspect traffic before recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from urbantwin.artefact import check_file, replaced_file
from urbantwin.errors import InputError
from urbantwin.interface.command import command
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.number_text import finite_number
from urbantwin.progress import between

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from urbantwin.interface.twin import Twin

__all__ = ["Film", "film"]


@dataclass(frozen=True)
class Film(Artefact):
    """A written film; it can be passed as its file.

    Attributes:
        path: the file.
        pictures: number of pictures.
        seconds: duration of the film, seconds.
        width: width, pixels.
        height: height, pixels.
    """

    path: Path
    pictures: int
    seconds: float
    width: int
    height: int

    def summary(self) -> Summary:
        """Return path, pictures, duration and size."""
        return Summary(
            path=str(self.path),
            pictures=self.pictures,
            seconds=self.seconds,
            size=f"{self.width} x {self.height}",
        )


@command
def film(
    motion: Motion | AnyPath,
    out: AnyPath | None = None,
    *,
    twin: Twin | AnyPath | None = None,
    view: Annotated[str, "NAME"] = "both",
    start: float = 0.0,
    stop: float | None = None,
    fps: float = 10.0,
    speed: float = 1.0,
    width: int = 1280,
    at: Annotated[str | None, "X,Y"] = None,
    radius: float | None = None,
    overwrite: bool = False,
    progress: ShowProgress = True,
) -> Film:
    """Film a motion from above and from a street corner.

    Args:
        motion: motion, or its folder.
        out: ``.mp4`` or ``.gif`` to write; ``film.mp4`` beside the motion if not given, or
            ``film.gif`` without ffmpeg.
        twin: twin of the motion; the one beside it if not given.
        view: view: ``above``, ``corner`` or ``both``, side by side.
        start: first moment, seconds of the motion.
        stop: last moment, seconds; the end of the motion if not given.
        fps: pictures per second, 0.1 to 50.
        speed: seconds of the motion per second of the film.
        width: width of the pictures, pixels.
        at: middle of the picture, ``X,Y`` in metres of the site; its anchor if not given.
        radius: radius of the view from above, metres; 100 or the whole region if not given.
        overwrite: replace a file that urbantwin did not write, or that was changed or made
            read-only.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the motion, the twin or a value cannot be used, or MP4 needs ffmpeg.
        StageError: ffmpeg failed.

    Example:
        >>> ut.traffic.film("out/motion", "film.gif", stop=10)
        $ urbantwin traffic film urbantwin-demo/motion -o film.gif --stop 10
    """
    from urbantwin.drawing.film import (
        check_video_file,
        film_colours,
        film_pictures,
        plan_film,
        write_video,
    )
    from urbantwin.drawing.pictures import attributions
    from urbantwin.interface.twin import Twin

    opened = Motion.open(motion)
    place = _place(opened, out)
    check_video_file(place)
    ground = Twin.open(beside(opened, "twin") if twin is None else twin)
    check_file(place, kind="film", inputs=[opened.folder, ground.folder])
    if ground.sha256 != opened.manifest["twin_sha256"]:
        raise InputError(
            "is not the twin that the motion was driven on",
            file=ground.folder,
            expected="that twin, by --twin",
        )
    plan = plan_film(
        opened,
        ground,
        view=view,
        start_s=start,
        stop_s=stop,
        rate_hz=fps,
        speed=speed,
        width=width,
        at=None if at is None else _middle(at),
        radius_m=radius,
    )
    shape = (0, 0)
    with shown_stage("film", progress) as tell, replaced_file(place, kind="film") as path:
        tell(0.0, "drawing the static scene")
        picture = film_pictures(
            plan, opened, ground, attribution=" · ".join(attributions(ground.manifest))
        )

        def drawn(time_s: float) -> NDArray[np.uint8]:
            nonlocal shape
            made = picture(time_s)
            shape = made.shape[:2]
            return made

        write_video(
            path,
            plan.times_s,
            drawn,
            rate_hz=plan.rate_hz,
            keep=film_colours(),
            tell=between(tell, 0.2, 1.0),
        )
    count = len(plan.times_s)
    return Film(place, count, round(count / plan.rate_hz, 3), shape[1], shape[0])


def _middle(text: str) -> tuple[float, float]:
    """Return the point of a text ``X,Y``.

    Raises:
        InputError: the text has another form.
    """
    numbers = [finite_number(one) for one in text.split(",")]
    if len(numbers) != 2 or numbers[0] is None or numbers[1] is None:
        raise InputError(f"{text!r:.40}", place="at", expected="X,Y in metres of the site")
    return numbers[0], numbers[1]


def _place(motion: Motion, out: AnyPath | None) -> Path:
    """Return the path of the film."""
    from urbantwin.drawing.film import check_video_file

    if out is not None:
        return Path(out)
    place = beside(motion, "film.mp4")
    try:
        check_video_file(place)
    except InputError:
        return place.with_suffix(".gif")
    return place
