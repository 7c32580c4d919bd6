"""Whether torch is installed, and the device that it is to use."""

from __future__ import annotations

from urbantwin.errors import InputError

__all__ = ["check_torch"]


def check_torch(device: str) -> None:
    """Refuse what cannot be done without torch, or without a device.

    Raises:
        InputError: torch or what goes with it is not installed, or there is no such device.
    """
    try:
        import onnx  # noqa: F401
        import safetensors.torch  # noqa: F401
        import torch
    except ImportError as error:
        raise InputError(
            f"training and detecting need PyTorch ({error})",
            expected="pip install 'urbantwin[learn]' (docs/detectors.md says how without CUDA)",
        ) from None
    kind = device.split(":", maxsplit=1)[0]
    if kind not in {"cpu", "cuda"} or (kind == "cuda" and not torch.cuda.is_available()):
        raise InputError(
            f"no device {device!r:.40}",
            place="--device",
            expected="cpu, or cuda where there is one",
        )
