"""OpenGL without a display, and MuJoCo's viewer: opened with one-line errors, and closed cleanly."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import warnings
from collections.abc import Callable
from typing import Any

import mujoco

from trackslip.errors import TrackslipError

_BACKENDS = ("egl", "osmesa")  # which need no display


def offscreen(model: Any, width: int, height: int) -> Any:
    """MuJoCo's renderer of images (height, width, 3), with the OpenGL that MUJOCO_GL names, or the first that works.

    Raises TrackslipError if none without a display works.
    """
    from mujoco.rendering.classic import gl_context

    problems = []
    chosen = gl_context.GLContext
    for backend in (None,) if os.environ.get("MUJOCO_GL") or sys.platform != "linux" else _BACKENDS:
        try:
            if backend is not None:
                gl_context.GLContext = __import__(f"mujoco.{backend}", fromlist=["GLContext"]).GLContext
            return mujoco.Renderer(model, height, width)
        except Exception as error:  # whatever a machine without OpenGL raises
            problems.append(f"{backend or os.environ.get('MUJOCO_GL')}: {' '.join(str(error).split())}")
        finally:
            gl_context.GLContext = chosen
    raise TrackslipError(f"rendering: no OpenGL works here ({'; '.join(problems)}); set MUJOCO_GL to egl or osmesa")


class Window:
    """MuJoCo's viewer, which renders in threads of its own."""

    def __init__(self, data: Any, on_key: Callable[[int], None] | None = None, panels: bool = True) -> None:
        """Open the viewer on data and its model, with or without its own panels.

        `on_key` gets the codes of pressed keys, as GLFW numbers them. Raises TrackslipError without a display.
        """
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise TrackslipError("rendering: a window needs a display, and there is none; pictures need none")
        try:
            import glfw
            from mujoco import viewer

            with warnings.catch_warnings():
                warnings.simplefilter("error")
                glfw.init()  # a failure raises here; in the viewer's thread it would end the process
            others = threading.enumerate()
            self.viewer = viewer.launch_passive(
                data.model, data, key_callback=on_key, show_left_ui=panels, show_right_ui=panels
            )
        except Exception as error:  # whatever a broken display raises
            raise TrackslipError(f"rendering: no window opens here: {' '.join(str(error).split())}") from error
        self._threads = [thread for thread in threading.enumerate() if thread not in others]
        atexit.register(self.close)

    def close(self) -> None:
        """Close the window and wait until it is gone: a thread that still renders crashes the interpreter at exit."""
        atexit.unregister(self.close)
        self.viewer.close()
        for thread in self._threads:
            thread.join(timeout=5.0)
