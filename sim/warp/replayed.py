"""Launches that a GPU repeats in one go."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp


class Replayed:
    """A function that launches the same kernels on the same arrays whenever it is called.

    A GPU repeats them as a graph, which costs a hundredth of launching them one by one from Python.
    """

    def __init__(self, launch: Callable[[], None]) -> None:
        self._launch = launch
        self._compiled = False
        self._graph: wp.Graph | None = None

    def __call__(self) -> None:
        """Launch the kernels on Warp's current device."""
        if self._graph is None and self._compiled and wp.get_device().is_cuda:
            with wp.ScopedCapture() as capture:
                self._launch()
            self._graph = capture.graph
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:  # kernels can't be compiled during a capture
            self._launch()
            self._compiled = True
