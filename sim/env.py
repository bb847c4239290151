"""The gymnasium environment trackslip/PathTracking-v0: path tracking of one robot."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.renderer import Renderer
from sim.path_tracking.tracking import PathTracking
from trackslip.errors import InvalidValueError, require

Floats = NDArray[np.float32]
METADATA = {"render_modes": ["rgb_array", "human"], "render_fps": round(1 / PERIOD)}


class PathTrackingEnv(gymnasium.Env[Floats, Floats]):
    """A tracked robot that must follow a reference trajectory.

    Actions are float32 (2,) in [-1, 1], 20 per second: sprocket speeds or a twist, see `EnvConfig.action`. The
    observations are described in `path_tracking.observation`, the reward in `path_tracking.config.Reward`. An episode
    terminates when the robot is farther than `off_path` from the reference or tips over, and is truncated at the
    reference's end.
    """

    metadata = METADATA

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Build the simulator; `render_mode` is None, "rgb_array" or "human", `options` are the fields of `EnvConfig`.

        Raises InvalidValueError for options that are unknown or out of range.
        """
        require_render_mode(render_mode)
        self.render_mode = render_mode
        self.tracking = PathTracking(EnvConfig.of(options), 1, threads=1)
        self.observation_space, self.action_space = spaces(self.tracking)
        self._renderer = Renderer(self.tracking) if render_mode is not None else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode, drawn from a generator with this seed, or from the current one if it is None.

        `options` replace drawn values, see `path_tracking.episode.draw`. Raises InvalidValueError for unknown options
        and values out of range.
        """
        super().reset(seed=seed)
        self.tracking.begin([0], [self.tracking.draw(self.np_random, options or {})])
        if self._renderer is not None:
            self._renderer.begin([0])
            self._show()
        return self.tracking.observation()[0], row_of(self.tracking.info())

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Simulate one control period; raises InvalidValueError for an action that isn't finite."""
        tracking = self.tracking
        tracking.step(np.asarray(action, float)[None])
        if self._renderer is not None:
            self._renderer.follow()
            self._show()
        ends = bool(tracking.terminated[0]), bool(tracking.truncated[0])
        return tracking.observation()[0], float(tracking.reward[0]), *ends, row_of(tracking.info())

    def render(self) -> Any:
        """Image (480, 640, 3), or None for "human", which updates the window; raises TrackslipError if it fails."""
        if self._renderer is None:
            raise InvalidValueError("render_mode", None, "given to gymnasium.make, to render")
        return self._renderer.picture(0) if self.render_mode == "rgb_array" else self._show()

    def _show(self) -> None:
        if self._renderer is not None and self.render_mode == "human":
            self._renderer.show()

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()


def require_render_mode(mode: str | None) -> None:
    """Raise InvalidValueError for an unknown mode."""
    require(mode in (None, "rgb_array", "human"), "render_mode", mode, 'None, "rgb_array" or "human"')


def spaces(tracking: PathTracking) -> tuple[Any, Any]:
    """Observation space and action space of one robot."""
    bound = tracking.layout.bound
    return gymnasium.spaces.Box(-bound, bound, dtype=np.float32), gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)


def row_of(info: dict[str, Any]) -> dict[str, Any]:
    """Entries of `info` for robot 0: numbers and arrays."""
    return {name: values[0].copy() if values.ndim > 1 else values[0].item() for name, values in info.items()}
