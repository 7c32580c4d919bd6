"""Optional packages: the extras of ``pyproject.toml``, missing in a plain installation."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["EXTRAS", "check_extra", "how_to_install"]

#: Modules that UrbanTwin imports, by extra.
EXTRAS = {
    "airborne": ("pyogrio",),
    "bags": ("lz4", "mcap", "mcap_protobuf", "rosbags", "velodyne_decoder", "zstandard"),
    "carla": ("carla",),
    "detector": ("onnx", "safetensors", "torch", "zstandard"),
    "e57": ("pye57",),
    "fbx": ("cmeel", "ufbx"),
    "film": ("imageio_ffmpeg",),
    "gltf": ("DracoPy", "meshopt"),
    "ray": ("ray",),
    "rerun": ("rerun",),
    "tune": ("cmaes", "optuna"),
    "usd": ("pxr",),
    "warp": ("warp",),
}


def how_to_install(extra: str) -> str:
    """Return the command that installs an extra."""
    return f"pip install 'urbantwin[{extra}]'"


def check_extra(
    extra: str,
    use: str,
    *,
    modules: Sequence[str] = (),
    file: str | Path | None = None,
    place: str | None = None,
) -> None:
    """Check that a task's optional packages are installed, without importing them.

    Args:
        extra: a key of `EXTRAS`.
        use: the task, as subject of the message: "reading E57".
        modules: modules of the extra that the task needs; all if empty.
        file: file that requires it, for the message.
        place: option or field that requires it, for the message.

    Raises:
        InputError: a package is missing; the message has the command that installs it.
    """
    missing = [module for module in modules or EXTRAS[extra] if not _is_installed(module)]
    if missing:
        raise InputError(
            f"{use} needs {', '.join(missing)}, not installed",
            file=file,
            place=place,
            expected=how_to_install(extra),
        )


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # blocked, or loaded without a spec
        return False
