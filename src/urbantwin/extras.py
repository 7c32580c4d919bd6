"""Optional packages: the extras of ``pyproject.toml``, which a plain installation lacks."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

from urbantwin.errors import InputError

__all__ = ["EXTRAS", "check_extra", "how_to_install"]

#: Extra -> the modules of it that UrbanTwin imports.
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
    """Refuse a task whose optional packages are not installed; nothing is imported.

    Args:
        extra: a key of `EXTRAS`.
        use: what needs it, the subject of the message: "reading E57".
        modules: those of the extra that this task needs; all of them if empty.
        file: the file that asks for it, for the message.
        place: the option or field that asks for it, for the message.

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
    except (ImportError, ValueError):  # imports of it are blocked, or it was loaded without a spec
        return False
