"""MuJoCo's renderer and viewer, with one-line errors on machines that can't draw."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import warnings
from collections.abc import Callable
from ctypes.util import find_library
from typing import Any

import numpy as np

from trackslip.errors import TrackslipError


def has_display() -> bool:
    """Whether this machine can open windows."""
    return sys.platform != "linux" or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def may_draw() -> bool:
    """Whether MuJoCo may be able to render: there is a display, a chosen OpenGL library, or EGL."""
    is_chosen = bool(os.environ.get("MUJOCO_GL"))
    return has_display() or is_chosen or find_library("EGL") is not None


def prefer_egl() -> None:
    """Import MuJoCo; without a display it renders with EGL, unless MUJOCO_GL names another OpenGL
    library.

    Raises TrackslipError if that library doesn't work. Has no effect if MuJoCo was imported before.
    """
    if not has_display():
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco  # noqa: F401
    except (AttributeError, OSError, RuntimeError) as error:  # from PyOpenGL and MuJoCo
        chosen = os.environ.get("MUJOCO_GL")
        raise TrackslipError(
            f"rendering: MUJOCO_GL = {chosen!r} does not work here ({error})"
        ) from error


def place(data: Any, qpos: np.ndarray) -> None:
    """Prepare `data` for drawing with the joint positions `qpos` (nq,)."""
    import mujoco

    data.qpos[:] = qpos
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
        compute(data.model, data)


class Pictures:
    """Pictures (height, width, 3) of a model from one `mujoco.Renderer`."""

    def __init__(self, model: Any, width: int, height: int) -> None:
        """Create the renderer; raises TrackslipError if the OpenGL library that MuJoCo chose
        doesn't work.
        """
        import mujoco

        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # any error on a machine without OpenGL
            why = " ".join(str(error).split())
            how = "set the environment variable MUJOCO_GL to egl or osmesa before Python starts"
            raise TrackslipError(
                f"rendering: no OpenGL works here ({why}); without a display, {how}"
            ) from error
        self.close = self._renderer.close

    def take(self, data: Any, camera: Any, draw: Callable[[Any], None]) -> np.ndarray:
        """Picture (height, width, 3) uint8 of the model and of the geoms that `draw` appends to its
        scene.
        """
        self._renderer.update_scene(data, camera=camera)
        draw(self._renderer.scene)
        return np.array(self._renderer.render())


class Window:
    """MuJoCo's viewer, which draws in its own threads."""

    def __init__(self, data: Any) -> None:
        """Open the viewer on `data` and its model; raises TrackslipError without a display."""
        if not has_display():
            raise TrackslipError(
                "rendering: a window needs a display, and there is none; pictures need none"
            )
        try:
            import glfw
            from mujoco import viewer

            with warnings.catch_warnings():
                warnings.simplefilter("error")
                glfw.init()  # raises for a broken display, which would end the viewer's process
            others = threading.enumerate()
            self.viewer = viewer.launch_passive(data.model, data)
        except Exception as error:  # any error on a broken display
            raise TrackslipError(
                f"rendering: no window opens here: {' '.join(str(error).split())}"
            ) from error
        self._threads = [thread for thread in threading.enumerate() if thread not in others]
        atexit.register(self.close)

    def close(self) -> None:
        """Close the window and wait for its threads, which could otherwise crash the interpreter at
        its exit.
        """
        atexit.unregister(self.close)
        self.viewer.close()
        for thread in self._threads:
            thread.join(timeout=5.0)
