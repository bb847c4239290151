"""The devices on which the physics of a fleet can run."""

from __future__ import annotations

import ctypes
from importlib.util import find_spec

import mujoco

from sim.quick_batch import QuickBatch
from trackslip.errors import TrackslipError, require

CPU, GPU, WARP_CPU = DEVICES = ("cpu", "gpu", "warp-cpu")
"""MuJoCo on the processor; MuJoCo Warp on an NVIDIA GPU; MuJoCo Warp on the processor, which is slow, for tests."""
_DRIVERS = ("libcuda.so.1", "nvcuda.dll")


def make_batch(model: mujoco.MjModel, size: int, threads: int = 0, device: str = CPU) -> QuickBatch:
    """`size` simulations of a model on one of the DEVICES.

    Raises:
        InvalidValueError: for a name that is none of them.
        TrackslipError: without MuJoCo Warp or without a GPU.
    """
    require(device in DEVICES, "device", device, f"one of {', '.join(DEVICES)}")
    if device == CPU:
        return QuickBatch(model, size, nthread=threads)
    require_available(device)
    from sim.warp.warp_batch import WarpBatch  # late: MuJoCo Warp is optional

    return WarpBatch(model, size, threads, "cuda" if device == GPU else "cpu")


def require_available(device: str) -> None:
    """Raise TrackslipError unless this computer can run MuJoCo Warp on `device`, GPU or WARP_CPU."""
    if find_spec("mujoco_warp") is None:
        raise TrackslipError(f'device {device!r} needs MuJoCo Warp: pip install "trackslip[gpu]"')
    if device == GPU and not _has_gpu():
        raise TrackslipError(f"device {GPU!r} needs an NVIDIA GPU and its driver; this computer has none")


def _has_gpu() -> bool:
    # Warp itself would report a missing driver on standard error
    if not any(_loads(driver) for driver in _DRIVERS):
        return False
    import warp

    return bool(warp.is_cuda_available())


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
