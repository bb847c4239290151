"""MuJoCo's renderer and viewer, with one-line errors if a machine can't draw."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from trackslip.errors import TrackslipError


def has_display() -> bool:
    """True if windows can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def prefer_egl() -> None:
    """Import MuJoCo; without a display it renders with EGL, unless MUJOCO_GL names another OpenGL library.

    Raises TrackslipError if the chosen library doesn't work. Has no effect once MuJoCo has been imported.
    """
    if not has_display():
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco  # noqa: F401
    except (AttributeError, OSError, RuntimeError) as error:  # what PyOpenGL and MuJoCo raise
        chosen = os.environ.get("MUJOCO_GL")
        raise TrackslipError(f"rendering: MUJOCO_GL = {chosen!r} does not work here ({error})") from error


def place(data: Any, qpos: np.ndarray) -> None:
    """Prepare `data` for drawing with the joint positions `qpos` (nq,)."""
    import mujoco

    data.qpos[:] = qpos
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
        compute(data.model, data)


class Pictures:
    """Pictures (height, width, 3) of a model, drawn by one `mujoco.Renderer`."""

    def __init__(self, model: Any, width: int, height: int) -> None:
        """Raise TrackslipError if the OpenGL library that MUJOCO_GL chose at MuJoCo's import doesn't work."""
        import mujoco

        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # whatever a machine without OpenGL raises
            why = " ".join(str(error).split())
            how = "set the environment variable MUJOCO_GL to egl or osmesa before Python starts"
            raise TrackslipError(f"rendering: no OpenGL works here ({why}); without a display, {how}") from error
        self.close = self._renderer.close

    def take(self, data: Any, camera: Any, draw: Callable[[Any], None]) -> np.ndarray:
        """Picture (height, width, 3) uint8 of the model and of the geoms that `draw` appends to its scene."""
        self._renderer.update_scene(data, camera=camera)
        draw(self._renderer.scene)
        return np.array(self._renderer.render())


class Window:
    """MuJoCo's viewer, which renders in its own threads."""

    def __init__(self, data: Any) -> None:
        """Open the viewer on `data` and its model; raises TrackslipError without a display."""
        if not has_display():
            raise TrackslipError("rendering: a window needs a display, and there is none; pictures need none")
        try:
            import glfw
            from mujoco import viewer

            with warnings.catch_warnings():
                warnings.simplefilter("error")
                glfw.init()  # a failure raises here; in the viewer's thread it would end the process
            others = threading.enumerate()
            self.viewer = viewer.launch_passive(data.model, data)
        except Exception as error:  # whatever a broken display raises
            raise TrackslipError(f"rendering: no window opens here: {' '.join(str(error).split())}") from error
        self._threads = [thread for thread in threading.enumerate() if thread not in others]
        atexit.register(self.close)

    def close(self) -> None:
        """Close the window and wait for its threads, which could otherwise crash the interpreter at exit."""
        atexit.unregister(self.close)
        self.viewer.close()
        for thread in self._threads:
            thread.join(timeout=5.0)
