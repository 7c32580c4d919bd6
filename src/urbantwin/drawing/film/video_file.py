"""Video files: GIF by Pillow, MP4 by ffmpeg, which runs as a separate program."""

from __future__ import annotations

import importlib
import importlib.util
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from urbantwin.errors import InputError, StageError
from urbantwin.extras import how_to_install
from urbantwin.progress import Progress, untold

__all__ = ["check_video_file", "write_video"]

#: Time unit of a GIF: hundredths of a second; players slow down rates above 50 Hz.
_TICK_S = 0.01
#: Number of pictures from which the colours of a GIF are chosen.
_SAMPLES = 5

Picture = NDArray[np.uint8]


def check_video_file(path: Path) -> None:
    """Raise an error if a film cannot be written to a file.

    Raises:
        InputError: the name does not end in ``.mp4`` or ``.gif``, or there is no ffmpeg.
    """
    kind = path.suffix.lower()
    if kind not in (".mp4", ".gif"):
        raise InputError("is no film", file=path, expected="a name that ends in .mp4 or .gif")
    if kind == ".mp4" and _ffmpeg() is None:
        raise InputError(
            "needs ffmpeg, which is not installed",
            file=path,
            expected=f"{how_to_install('film')}, an ffmpeg on the PATH, or a name in .gif",
        )


def write_video(
    path: Path,
    times_s: Sequence[float],
    picture: Callable[[float], Picture],
    *,
    rate_hz: float,
    keep: Sequence[tuple[int, int, int]] = (),
    tell: Progress = untold,
) -> None:
    """Write a film; a GIF of the same pictures has the same bytes.

    Args:
        path: the ``.mp4`` (H.264, supported by all players) or ``.gif``.
        times_s: times of the pictures, at least one.
        picture: returns the picture (height, width, 3) of a time, 0..255; sides of an MP4 are even.
        rate_hz: pictures per second.
        keep: colours that a GIF must contain exactly.
        tell: called with the share of the pictures that is done, and the current task.

    Raises:
        InputError: see `check_video_file`.
        StageError: ffmpeg failed.
    """
    check_video_file(path)
    gif = path.suffix.lower() == ".gif"
    total = len(times_s) + (len(_sampled(times_s)) if gif else 0)
    made = 0

    def counted(time_s: float) -> Picture:
        nonlocal made
        tell(made / total, "pictures")
        made += 1
        return picture(time_s)

    if gif:
        _write_gif(path, times_s, counted, rate_hz, keep)
    else:
        _write_mp4(path, map(counted, times_s), rate_hz)


def _sampled(times_s: Sequence[float]) -> list[int]:
    """Return the numbers of the pictures from which a GIF's palette is chosen."""
    return sorted({round(k * (len(times_s) - 1) / (_SAMPLES - 1)) for k in range(_SAMPLES)})


def _write_gif(
    path: Path,
    times_s: Sequence[float],
    picture: Callable[[float], Picture],
    rate_hz: float,
    keep: Sequence[tuple[int, int, int]],
) -> None:
    samples = np.concatenate([picture(times_s[number]) for number in _sampled(times_s)])
    # One palette for all pictures: static areas keep their colour, and are not stored again.
    chosen = Image.fromarray(samples).quantize(255 - len(keep), method=Image.Quantize.MEDIANCUT)
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for one in keep for value in one] + (chosen.getpalette() or []))

    def reduced(pixels: Picture) -> Image.Image:
        return Image.fromarray(pixels).quantize(palette=palette, dither=Image.Dither.NONE)

    first, *rest = times_s
    # The hundredths of a second are shared out so that the film does not run away from the clock.
    ends = np.round(np.arange(1, len(times_s) + 1) / rate_hz / _TICK_S).astype(int)
    lasting = np.diff(ends, prepend=0) * 10
    reduced(picture(first)).save(
        path,
        format="GIF",
        save_all=True,
        append_images=(reduced(picture(time_s)) for time_s in rest),
        duration=lasting.tolist(),
        loop=0,
        disposal=1,
    )


def _write_mp4(path: Path, pictures: Iterable[Picture], rate_hz: float) -> None:
    several = iter(pictures)
    first = next(several)
    height, width = first.shape[:2]
    program = _ffmpeg()
    assert program is not None
    command = [program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", f"{rate_hz:g}", "-i", "-", "-an"]
    command += ["-c:v", "libx264", "-preset", "medium", "-crf", "20", "-pix_fmt", "yuv420p"]
    command += ["-movflags", "+faststart", "-fflags", "+bitexact", "-f", "mp4", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            with suppress(BrokenPipeError):  # the reason is on its stderr
                process.stdin.write(first.tobytes())
                for one in several:
                    process.stdin.write(one.tobytes())
            with suppress(BrokenPipeError):
                process.stdin.close()
            said = process.stderr.read().decode(errors="replace").strip()
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise StageError(f"ffmpeg failed: {said.splitlines()[-1] if said else process.returncode}")


def _ffmpeg() -> str | None:
    """Return the program: that of the package ``imageio-ffmpeg``, or one on the PATH."""
    if importlib.util.find_spec("imageio_ffmpeg") is not None:
        with suppress(RuntimeError):  # the package carries none for this machine
            return str(importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe())
    return shutil.which("ffmpeg")
