"""A twin's traffic and sensors on a running CARLA server."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage
from urbantwin.interface.summary import Summary

__all__ = ["CarlaFrames", "carla"]


@dataclass(frozen=True)
class CarlaFrames:
    """Frames that CARLA recorded; it stands for its folder.

    Attributes:
        folder: where they are.
        told: what was set down and written.
    """

    folder: Path
    told: dict[str, Any]

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def summary(self) -> Summary:
        """Return what was set down and written in a few values."""
        return Summary(written=str(self.folder), **self.told)


def carla(
    package: AnyPath,
    out: AnyPath | None = None,
    *,
    host: str = "localhost",
    port: int = 2000,
    seconds: float = 10.0,
    progress: ShowProgress = True,
) -> CarlaFrames:
    """Drive a twin's traffic on a CARLA 0.9.16 server and record it with the twin's rig.

    Args:
        package: what `export` to ``carla`` wrote; its map is imported in CARLA.
        out: the folder to write; ``carla_frames`` beside the package when not given.
        host: the server's name.
        port: the server's port.
        seconds: how long, of simulated time.
        progress: show how far it is; or a function that is told (share, doing).

    Raises:
        InputError: it is not a package, or CARLA's Python package is not installed.
        StageError: no server answers, or it failed.
    """
    from urbantwin.exports.carla.live import drive

    place = beside(package, "carla_frames", out)
    with shown_stage("carla", progress) as tell:
        told = drive(Path(package), place, host=host, port=port, seconds=seconds, progress=tell)
    return CarlaFrames(place, told)
