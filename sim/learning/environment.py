"""Learning tasks as gymnasium environments, for one robot or for N robots in a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sim.common.settings import from_options
from sim.learning.renderer import TaskRenderer
from sim.learning.task import Element, Floats
from trackslip.errors import InvalidValueError, TrackslipError, require, require_whole
from trackslip.restorable import Restorable

FEW_ROBOTS: Final = 4
"""Number of robots up to which one thread is never slower: handing them to threads costs 0.2 to 0.3
ms in each step, in which a robot on flat ground takes 0.1 ms.
"""
_MAX_ROBOTS: Final = 100_000
_MAX_THREADS: Final = 1024


class TaskInterface(Restorable):
    """An environment that describes its task and can return to earlier states."""

    configuration: Any
    """Dataclass for the task's options."""
    kind: Any
    """Class of the task, whose arguments are options, number of robots and number of threads."""
    drawing: Any
    """Class of the task's renderer."""
    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"]}  # noqa: RUF012
    """Metadata for gymnasium, to which the frame rate is added once the control period is known."""
    task: Any
    observed: tuple[Element, ...]
    """The n elements of an observation: names, units, scales and bounds."""
    commanded: tuple[Element, ...]
    """The A elements of an action: names, units, scales and bounds."""
    render_mode: str | None
    _renderer: TaskRenderer | None = None

    def _make(
        self, options: Mapping[str, Any], size: int, threads: int, render_mode: str | None
    ) -> None:
        self.render_mode = render_mode
        self.task = self.kind(from_options(self.configuration, options), size, threads)
        self.observed = self.task.observed
        self.commanded = self.task.commanded
        self.metadata = {**self.metadata, "render_fps": round(1 / self.task.period)}
        self._renderer = self.drawing(self.task) if render_mode is not None else None

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, which can be pickled: robots, episodes, and the generators
        for later episodes.
        """
        return {"of": self._of} | super().get_state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a state of this environment or of another environment with the same options.

        Raises InvalidValueError for the state of an environment with another task, size,
        observation or action.
        """
        of = state.get("of")
        require(of == self._of, "state", f"that of {of}", f"that of {self._of}")
        super().set_state(state)
        if self._renderer is not None:
            self._renderer.begin(range(self.task.size))

    @property
    def _of(self) -> str:
        observed, commanded = len(self.observed), len(self.commanded)
        return (
            f"{type(self.task).__name__}, {self.task.size} robots, {observed} observed "
            f"values, {commanded} actions"
        )


class TaskEnv(TaskInterface, gymnasium.Env[Floats, Floats]):
    """A task for one robot."""

    STATE = ("task", "np_random")

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Build the simulator; `render_mode` is None, "rgb_array" or "human", `options` are fields
        of `configuration`.

        Raises InvalidValueError for unknown options and values out of range.
        """
        allowed = 'None, "rgb_array" or "human"'
        require(render_mode in (None, "rgb_array", "human"), "render_mode", render_mode, allowed)
        self._make(options, 1, 1, render_mode)
        self.observation_space = _box(self.observed)
        self.action_space = _box(self.commanded)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode, drawn from a new generator with this seed, or from the existing one if
        `seed` is None.

        `options` replace drawn values; see the task's `draw`. Raises InvalidValueError for unknown
        options and values out of range.
        """
        super().reset(seed=seed)
        episode = self.task.draw(self.np_random, {} if options is None else options)
        self.task.begin([0], [episode])
        if self._renderer is not None:
            self._renderer.begin([0])
            self._show()
        return self.task.observation()[0], _only(self.task.info())

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Simulate one control period; raises InvalidValueError for an action that isn't finite."""
        task = self.task
        task.step([action])
        if self._renderer is not None:
            self._renderer.follow()
            self._show()
        reward = float(task.reward[0])
        terminated = bool(task.terminated[0])
        truncated = bool(task.truncated[0])
        return task.observation()[0], reward, terminated, truncated, _only(task.info())

    def render(self) -> Any:
        """Return an image (480, 640, 3), or update the window for "human"; raises TrackslipError if
        drawing fails.
        """
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


class TaskVectorEnv(TaskInterface, VectorEnv[Floats, Floats, np.ndarray]):
    """A task for N robots.

    Row i is bitwise identical to row i of gymnasium's SyncVectorEnv with single environments and
    the same seeds; spaces, autoreset modes and infos are identical as well.
    """

    STATE = ("task", "_generators", "_seeds_used", "_ended", "_begun", "_steps")

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        max_episode_steps: int | None = None,
        **options: Any,
    ) -> None:
        """Build the simulator for `num_envs` robots on `threads` worker threads, 0 for one per
        processor; by default, one for up to FEW_ROBOTS robots and else one per processor.

        `render_mode` is None or "rgb_array", `autoreset_mode` a mode of gymnasium. Episodes are
        truncated after `max_episode_steps`; `options` are fields of `configuration`. Raises
        InvalidValueError for unknown options and values out of range.
        """
        allowed = 'None or "rgb_array", for many robots'
        require(render_mode in (None, "rgb_array"), "render_mode", render_mode, allowed)
        require_whole("num_envs", num_envs, 1, _MAX_ROBOTS)
        if threads is None:
            threads = 1 if num_envs <= FEW_ROBOTS else 0
        require_whole("threads", threads, 0, _MAX_THREADS)
        if max_episode_steps is not None:
            require_whole("max_episode_steps", max_episode_steps, 1)
        self._longest = np.inf if max_episode_steps is None else max_episode_steps
        # steps (N,) in each robot's episode
        self._steps: NDArray[np.int_] = np.zeros(num_envs, int)
        self.num_envs = num_envs
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self._make(options, num_envs, threads, render_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_observation_space = _box(self.observed)
        self.single_action_space = _box(self.commanded)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._seeds_used: list[int | None] = [None] * num_envs
        self._ended = np.ones(num_envs, bool)  # whether each robot needs a new episode
        self._begun = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin episodes; raises InvalidValueError for unknown options and values out of range.

        Args:
            seed: an integer s, which seeds row i like a single environment's reset(seed=s + i); or
                a sequence with one entry per robot, in which None keeps that robot's generator.
            options: `reset_mask`, (N,) bool, selects the robots to reset. The other options are
                those of the single environment: one value for all robots, or a list with one entry
                per robot, in which None means drawn.
        """
        require(options is None or isinstance(options, Mapping), "options", options, "a dictionary")
        options = dict(options or {})
        mask = self._mask(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        rows = np.flatnonzero(mask)
        seeds = self._seeds(seed)
        for row in rows:
            own = seeds[row]
            if own is not None or self._generators[row] is None:
                seeded = seeding.np_random(None if own is None else int(own))
                self._generators[row], self._seeds_used[row] = seeded
        is_whole = len(rows) == self.num_envs
        require(self._begun or is_whole, "reset_mask", "not all robots", "all, the first time")
        self._begin(rows, options)
        self._begun = True
        return self.task.observation(), self._infos(mask)

    def _mask(self, given: Any) -> NDArray[np.bool_]:
        """The mask (N,) of robots to reset; raises InvalidValueError for other values than that."""
        is_mask = isinstance(given, np.ndarray) and given.dtype == bool
        valid = is_mask and given.shape == (self.num_envs,) and given.any()
        allowed = f"an array ({self.num_envs},) of bool, one of them true"
        require(valid, "reset_mask", given, allowed)
        mask: NDArray[np.bool_] = given
        return mask

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator | None, ...]:  # type: ignore[override]
        """Generators (N) for the robots' episodes, as in SyncVectorEnv; None before the first
        reset.
        """
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """Seeds (N) of the generators for the robots' episodes."""
        return tuple(self._seeds_used)

    def _seeds(self, seed: Any) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, Integral):
            return [int(seed) + i for i in range(self.num_envs)]
        valid = isinstance(seed, Sequence | np.ndarray) and np.shape(seed) == (self.num_envs,)
        require(valid, "seed", seed, f"an integer, or {self.num_envs}")
        return list(seed)

    def step(
        self, actions: Floats
    ) -> tuple[Floats, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Simulate one control period with actions (N, A).

        Raises:
            InvalidValueError: for actions that aren't finite.
            TrackslipError: before the first reset; without autoreset, if a robot needs a new
                episode.
        """
        if not self._begun:
            raise TrackslipError("step: reset() comes first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            waiting = np.flatnonzero(self._ended).tolist()
            what = "reset(options={'reset_mask': ...}) comes first"
            raise TrackslipError(f"step: robots {waiting} have ended; {what}")
        task = self.task
        task.step(actions)
        self._steps += 1
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            # robots whose episodes ended in the previous step are reset instead of stepped
            self._begin(np.flatnonzero(self._ended), {})
        if self._renderer is not None:
            self._renderer.follow()
        reward = task.reward.copy()
        terminated = task.terminated.copy()
        truncated = task.truncated | (self._steps >= self._longest)
        self._ended = terminated | truncated
        last: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            last = self._final(self._ended)
            self._begin(np.flatnonzero(self._ended), {})
        infos = last | self._infos(np.ones(self.num_envs, bool))
        return task.observation(), reward, terminated, truncated, infos

    def render(self) -> tuple[Any, ...]:
        """Images (480, 640, 3), one per robot; raises TrackslipError if drawing fails."""
        if self._renderer is None:
            raise InvalidValueError("render_mode", None, "given to gymnasium.make_vec, to render")
        return tuple(self._renderer.picture(row) for row in range(self.num_envs))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method once for all robots, or get an attribute; return N results, one per robot.

        Robots share their environment's attributes, and all get the same result, except for their
        spaces, generators, seeds and images, which are those of single environments. Raises
        InvalidValueError for `reset` and `step`.
        """
        allowed = "called as a method of this environment"
        require(name not in ("reset", "step"), "name", name, allowed)
        singles = {
            "observation_space": "single_observation_space",
            "action_space": "single_action_space",
        }
        attribute = getattr(self, singles.get(name, name))
        result = attribute(*args, **kwargs) if callable(attribute) else attribute
        if name in ("render", "np_random", "np_random_seed"):
            return tuple(result)
        return (result,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute (N,) of each robot's environment; see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: list[Any] | tuple[Any, ...] | Any) -> None:
        """Set an attribute to a value, or to N equal values, one per robot.

        Raises InvalidValueError for other numbers of values, and for values that differ, because
        robots share their environment's attributes.
        """
        several = values if isinstance(values, list | tuple) else [values] * self.num_envs
        allowed = f"a value, or {self.num_envs}, one per robot"
        require(len(several) == self.num_envs, "values", f"{len(several)} values", allowed)
        value = several[0]
        is_equal = all(other is value or np.array_equal(other, value) for other in several)
        require(is_equal, "values", list(several), "equal: robots of a batch share attributes")
        setattr(self, name, value)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the image buffers."""
        if self._renderer is not None:
            self._renderer.close()

    def _begin(self, rows: NDArray[np.int_], options: Mapping[str, Any]) -> None:
        for name, value in options.items():
            valid = not isinstance(value, list) or len(value) == self.num_envs
            require(valid, f"options[{name!r}]", value, f"a value, or a list of {self.num_envs}")
        episodes = []
        for row in rows:
            generator = self._generators[row]
            assert generator is not None
            episodes.append(self.task.draw(generator, _own_options(options, row)))
        self.task.begin(rows.tolist(), episodes)
        self._ended[rows] = False
        self._steps[rows] = 0
        if self._renderer is not None:
            self._renderer.begin(rows.tolist())

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Entries `final_obs` and `final_info` for the robots whose episodes have `ended` (N,)."""
        observation = self.task.observation()
        final = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(ended):
            final[row] = observation[row]
        return {
            "final_obs": final,
            "_final_obs": ended.copy(),
            "final_info": self._infos(ended),
            "_final_info": ended.copy(),
        }

    def _infos(self, whose: NDArray[np.bool_]) -> dict[str, Any]:
        """Infos for the robots in the mask `whose` (N,), with this mask; zero, or None, for other
        robots.
        """
        infos: dict[str, Any] = {}
        others = ~whose
        for name, values in self.task.info().items():
            own = values.copy()
            own[others] = None if values.dtype == object else 0
            infos[name] = own
            infos[f"_{name}"] = whose.copy()
        return infos


def _box(elements: Sequence[Element]) -> Any:
    bound = np.array([element.bound for element in elements], np.float32)
    return gymnasium.spaces.Box(-bound, bound)


def _autoreset_mode(given: Any) -> AutoresetMode:
    """A mode from itself or its name; raises InvalidValueError for other values."""
    modes = [mode.value for mode in AutoresetMode]
    name = given.value if isinstance(given, AutoresetMode) else given
    valid = isinstance(name, str) and name in modes
    require(valid, "autoreset_mode", name, f"one of {', '.join(modes)}")
    return AutoresetMode(name)


def _own_options(options: Mapping[str, Any], row: int) -> dict[str, Any]:
    """The options of the robot `row`: lists have an entry per robot, in which None means drawn."""
    own = {}
    for name, value in options.items():
        given = value[row] if isinstance(value, list) else value
        if given is not None or not isinstance(value, list):
            own[name] = given
    return own


def _only(info: dict[str, Any]) -> dict[str, Any]:
    """Entries of `info` for a single robot: numbers, texts and arrays."""
    only = {}
    for name, values in info.items():
        only[name] = values[0].copy() if values.ndim > 1 else values.item()
    return only
