"""Check of torch and its device; memory layout, precision and determinism on a GPU."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from urbantwin.errors import InputError
from urbantwin.extras import check_extra, how_to_install

if TYPE_CHECKING:
    import torch
    from numpy.typing import NDArray

    _Network = TypeVar("_Network", bound=torch.nn.Module)

__all__ = ["check_torch", "copied", "mixed_precision", "on_device", "repeatable"]


def check_torch(device: str) -> None:
    """Check that torch and a device are available.

    Raises:
        InputError: torch or a library of the same extra is missing, or the device does not exist.
    """
    check_extra("detector", "training and detecting")
    try:
        import onnx  # noqa: F401
        import safetensors.torch  # noqa: F401
        import torch
    except ImportError as error:
        raise InputError(
            f"PyTorch does not load ({error})",
            expected=f"{how_to_install('detector')} (docs/howto/train.md says how without CUDA)",
        ) from None
    kind = device.split(":", maxsplit=1)[0]
    if kind not in {"cpu", "cuda"} or (kind == "cuda" and not torch.cuda.is_available()):
        raise InputError(
            f"no device {device!r:.40}",
            place="--device",
            expected="cpu, or cuda where there is one",
        )


def on_device(network: _Network, device: str) -> _Network:
    """Move a network to a device; on a GPU in channels-last memory format."""
    import torch

    network = network.to(device)
    if is_gpu(device):
        torch.nn.Module.to(network, memory_format=torch.channels_last)
    return network


def is_gpu(device: str) -> bool:
    """Return whether a device is a CUDA device."""
    return device.split(":", maxsplit=1)[0] == "cuda"


def mixed_precision(device: str) -> torch.dtype | None:
    """Return the reduced-precision type for a device; ``None`` on a processor.

    bfloat16 has the range of float32, so gradients need no scaling; GPUs before Ampere only have
    float16.
    """
    import torch

    if not is_gpu(device):
        return None
    return torch.bfloat16 if torch.cuda.is_bf16_supported() else torch.float16


@contextmanager
def repeatable(device: str) -> Iterator[None]:
    """Use deterministic algorithms on a GPU within the block; a processor needs no switch."""
    import torch
    from torch.utils import deterministic

    if not is_gpu(device):
        yield
        return
    # cuBLAS reads this variable at its first use.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    before = torch.are_deterministic_algorithms_enabled()
    filled = deterministic.fill_uninitialized_memory
    torch.use_deterministic_algorithms(True, warn_only=True)
    deterministic.fill_uninitialized_memory = False
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before)
        deterministic.fill_uninitialized_memory = filled


def copied(
    batches: Iterator[Mapping[str, NDArray[Any]]], device: str
) -> Iterator[dict[str, torch.Tensor]]:
    """Yield batches as tensors on a device; a GPU copies the next one during a step."""
    import torch

    if not is_gpu(device):
        for batch in batches:
            yield {name: torch.from_numpy(one) for name, one in batch.items()}
        return
    aside = torch.cuda.Stream(device)
    ready: dict[str, torch.Tensor] | None = None
    for batch in batches:
        with torch.cuda.stream(aside):
            coming = {name: torch.from_numpy(one).to(device) for name, one in batch.items()}
        if ready is not None:
            yield ready
        torch.cuda.current_stream(device).wait_stream(aside)
        for one in coming.values():
            one.record_stream(torch.cuda.current_stream(device))
        ready = coming
    if ready is not None:
        yield ready
