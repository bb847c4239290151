"""Episodes: a reference and properties, drawn at random or given before an episode begins."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim.common.settings import options_of
from sim.fleet.fleet import RunSetup
from sim.ground.ground import Ground
from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.randomization import Randomization, uniform
from trackslip import se2
from trackslip.errors import require, require_at_most, require_finite, require_within
from trackslip.kinematics import Array
from trackslip.restorable import Restorable
from trackslip.trajectory.base import Reference

_OPTIONS: Final = {
    "reference": str,
    "ground": str | Ground,
    "start_error": object,
    "radius_error": float,
    "com": object,
    "mass": float,
    "lag": float,
    "latency": int,
}
_ROUNDING: Final = 1e-9  # tolerance on the number of control periods
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Episode:
    """Reference and properties of one robot's episode."""

    reference: int  # index in the reference table
    setup: RunSetup
    latency: int  # delay until an action reaches the servos [control periods]
    noise: int  # seed of the measurement noise


def draw(
    config: EnvConfig,
    table: ReferenceTable,
    generator: np.random.Generator,
    options: Mapping[str, Any],
) -> Episode:
    """Draw an episode; `options` replace drawn values, without an effect on the other draws.

    The options are `reference`, a name, which is added to the table if it is new; `ground`, a name
    or a Ground, which is not randomized; `start_error` (3,), the offset from the reference's start:
    forwards, to the left, heading [m, m, rad]; `radius_error` [-]; `com` (2,), the offset of the
    centre of mass: forwards, to the left [m]; `mass`, a factor on the chassis' mass [-]; `lag` [s];
    and `latency` [control periods]. Raises InvalidValueError for unknown options and values out of
    range.
    """
    options = options_of("options", options, _OPTIONS)
    drawn = config.drawn
    chosen = config.references[generator.integers(len(config.references))]
    reference = table.index(options.get("reference", chosen))
    base = config.load_ground(config.grounds[generator.integers(len(config.grounds))])
    setup = drawn.setup(generator, config.parameters, base, table.path(reference))
    latency = int(generator.integers(*drawn.latency, endpoint=True))
    error = _start_error(drawn, generator)

    changes: dict[str, Any] = {}
    if "ground" in options:
        changes["ground"] = _given_ground(config, options["ground"])
    for name in ("radius_error", "mass", "lag", "latency"):
        if name in options:
            require_within(name, options[name], *Randomization.limits(name))
    for name in ("radius_error", "mass", "lag"):
        if name in options:
            changes[name] = options[name]
    if "latency" in options:
        latency = int(options["latency"])
    if "start_error" in options:
        error = _finite("start_error", options["start_error"], 3)
        distance = math.hypot(*error[:2])
        unit = "m, which is off_path"
        require_at_most("distance of start_error", distance, config.off_path, unit)
    if "com" in options:
        changes["com_offset"] = _given_com_offset(config, options["com"])
    changes["start"] = tuple(se2.compose(setup.start, error).tolist())
    setup = dataclasses.replace(setup, **changes)
    return Episode(reference, setup, latency, noise=int(generator.integers(2**63)))


def _start_error(drawn: Randomization, generator: np.random.Generator) -> tuple[float, ...]:
    """Draw the offset (3,) from the reference's start: forwards, to the left, heading [m, m,
    rad].
    """
    distance = uniform(generator, drawn.start_distance, 0.0)
    bearing = generator.uniform(-math.pi, math.pi)
    heading = uniform(generator, drawn.start_heading, 0.0)
    return distance * math.cos(bearing), distance * math.sin(bearing), heading


def _given_ground(config: EnvConfig, given: str | Ground) -> Ground:
    """A ground from itself or its name; raises InvalidValueError for ground that shears unless the
    environment allows it.
    """
    ground = given if isinstance(given, Ground) else config.load_ground(given)
    shear = ground.largest_shear
    allowed = "0 in an environment that is made without ground that shears"
    require(shear == 0 or config.shears, "ground.shear", shear, allowed)
    if not config.sinks:
        ground.require_firm("the environment is made without soft soil")
    return ground


def _given_com_offset(config: EnvConfig, given: Any) -> Any:
    """A centre of mass (2,); raises InvalidValueError if the robot would tip over with it."""
    offset = _finite("com", given, 2)
    x, y = offset
    Randomization(com_x=(x, x), com_y=(y, y)).require_standing(config.parameters)
    return offset


def _finite(name: str, values: Any, n: int) -> Any:
    """Return values (n,) as floats; raises InvalidValueError unless they are n finite numbers."""
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    require(len(numbers) == n, name, values, f"{n} numbers")
    for value in numbers:
        require_finite(name, value)
    return numbers


class ReferenceTable(Restorable):
    """Poses and twists on R references, one row each, at multiples of the control period."""

    STATE = ("names", "last", "_pose", "_twists")

    def __init__(
        self, names: Iterable[str], steps: Index, load: Callable[[str], Reference]
    ) -> None:
        """Tabulate the references `names`, with twists `steps` (K,) control periods ahead,
        ascending from 0. `load` builds a reference from its name.
        """
        self._steps = steps
        self._load = load
        self.names: tuple[str, ...] = ()  # names of the references, in the order of the rows
        self.last: Index = np.empty(0, int)  # last control period (R,) of each reference
        self._pose: Array = np.empty((0, 1, 3))
        self._twists: Array = np.empty((0, 1, len(steps), 2))
        for name in names:
            self.index(name)

    def index(self, name: str) -> int:
        """Index of a reference, which is added if it is new; raises TrackslipError for an unknown
        name.
        """
        if name not in self.names:
            reference = self._load(name)
            last = math.ceil(reference.duration / PERIOD - _ROUNDING)
            now = np.arange(last + self._steps[-1] + 1)  # after its end, the reference stands still
            later = np.minimum(now[:, None] + self._steps, now[-1])
            time = now * PERIOD
            self._pose = _stacked(self._pose, reference.pose(time))
            self._twists = _stacked(self._twists, reference.twist(time)[later])
            self.last = np.append(self.last, last)
            self.names += (name,)
        return self.names.index(name)

    def path(self, index: int) -> Array:
        """Poses (T, 3) on a reference, from start to end."""
        return self._pose[index, : self.last[index] + 1]

    def pose(self, index: Index, k: Index) -> Array:
        """Poses (..., 3) on references `index` (...) in control periods `k` (...)."""
        return self._pose[index, np.minimum(k, self._pose.shape[1] - 1)]

    def twists(self, index: Index, k: Index) -> Array:
        """Twists (..., K, 2) on references `index` (...), each of `steps` after control periods `k`
        (...).
        """
        return self._twists[index, np.minimum(k, self._twists.shape[1] - 1)]


def _stacked(table: Array, row: Array) -> Array:
    """Append `row` (t, ...) to a table (R, T, ...); the shorter of them is extended with its last
    values.
    """
    length = max(table.shape[1], len(row))

    def extended(part: Array) -> Array:
        return part.take(np.minimum(np.arange(length), part.shape[1] - 1), axis=1)

    return np.concatenate([extended(table), extended(row[None])])
