"""Launches that a GPU repeats in one go."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp


class Replayed:
    """A function that launches the same kernels on the same arrays whenever it is called.

    A GPU repeats them as a graph, without the cost of launching each from Python.
    """

    def __init__(self, launch: Callable[[], None]) -> None:
        self._launch = launch
        self._graph: wp.Graph | None = None

    def __call__(self) -> None:
        """Launch the kernels on Warp's current device."""
        if not wp.get_device().is_cuda:
            self._launch()
            return
        if self._graph is None:
            with wp.ScopedCapture() as capture:
                self._launch()
            self._graph = capture.graph
        wp.capture_launch(self._graph)
