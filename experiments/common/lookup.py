"""Names on the command line resolved to objects: references, compensations, controllers,
localization methods.
"""

import contextlib
import functools
import inspect
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from sim.policy import PolicyController, TrackingPolicy, policy_file
from sim.robot.robot import Robot
from trackslip.controllers.base import Controller
from trackslip.controllers.named import CONTROLLERS
from trackslip.errors import (
    InvalidValueError,
    TrackslipError,
    did_you_mean,
    one_of,
    require,
    require_finite,
)
from trackslip.inputs import import_own
from trackslip.kinematics import RobotGeometry
from trackslip.laws.file import SHIPPED
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_estimate import Locator
from trackslip.online.compensation import Compensation, named_compensation
from trackslip.trajectory.base import Reference
from trackslip.trajectory.named import load_reference
from trackslip.trajectory.path import LIMITS, MotionLimits
from trackslip.trajectory.waypoints import TOLERANCE

_POLICY: Final = "ppo:"
# constructor parameters set from the robot
_OF_THE_ROBOT: Final = ("geometry", "half_gauge", "track_speed", "period")
_MARGIN: Final = 0.98  # fraction of the top speed that controllers may use


@functools.lru_cache(maxsize=64)
def reference(name: str, limits: MotionLimits = LIMITS, tolerance: float = TOLERANCE) -> Reference:
    """A reference by name, or from a file with limits and a tolerance [m]; raises TrackslipError if
    `name` is neither.
    """
    return load_reference(name, limits, tolerance)


def compensation(name: str, robot: RobotGeometry, laws: Path | None) -> Compensation:
    """A new compensation by name, using the laws in a file, by default those shipped with
    trackslip.

    MODULE:LAW is a law of the user, whose module adds it to FAMILIES. Raises InvalidValueError for
    an unknown name, and for a module that can't be imported.
    """
    module, _, law = name.rpartition(":")
    if module:
        find_own_modules()
        try:
            import_own(module)
        except (Exception, SystemExit) as error:  # anything from a user's module
            why = f"{type(error).__name__}: {error}"
            allowed = f"MODULE:LAW with a module that can be imported ({why})"
            raise InvalidValueError("compensation", name, allowed) from error
    return named_compensation(law, robot, laws or SHIPPED)


def controller(
    name: str,
    geometry: RobotGeometry,
    top_speed: float,
    period: float,
    half_gauge: float | None = None,
) -> Controller:
    """A new controller: one of CONTROLLERS or a user's MODULE:CLASS, with or without arguments, or
    a policy, ppo:PATH.

    Constructor arguments follow the name, as in linear:stiffness=160,damping=1. Unless given,
    parameters with these names get this robot's values: `geometry`; `half_gauge`, b + D from the
    slip law in use [m], by default b; `track_speed`, slightly below the tracks' `top_speed` [m/s];
    `period` between two commands [s].

    Raises InvalidValueError for an unknown name or argument, or a value that is not allowed.
    """
    if name.startswith(_POLICY):
        policy = TrackingPolicy.load(_policy_place(name))
        return PolicyController(policy, top_speed / geometry.sprocket_radius)
    values = (geometry, half_gauge or geometry.half_gauge, _MARGIN * top_speed, period)
    known = dict(zip(_OF_THE_ROBOT, values, strict=True))
    with _errors_of(name):
        make, parameters, given = _constructor(name)
        arguments = {key: value for key, value in known.items() if key in parameters}
        made: Controller = make(**arguments | _arguments(name, given, parameters))
    if not all(callable(getattr(made, method, None)) for method in ("reset", "twist")):
        raise InvalidValueError(
            "controller", name, "a class with methods reset and twist: see trackslip.controllers"
        )
    return made


def tunable(name: str) -> tuple[dict[str, float], list[str]]:
    """Gains in a controller's constructor with their defaults, and the names of its other
    parameters.

    Gains are parameters that default to positive floats and do not describe the robot. Raises
    InvalidValueError for an unknown name, a name with arguments, or a controller without gains.
    """
    parameters: Mapping[str, inspect.Parameter] = {}
    if not has_arguments(name):
        with _errors_of(name):
            _, parameters, _ = _constructor(name)
    free = {
        key: parameter.default for key, parameter in parameters.items() if key not in _OF_THE_ROBOT
    }
    gains = {
        key: value
        for key, value in free.items()
        if isinstance(value, float) and 0 < value < math.inf
    }
    if not gains:
        raise InvalidValueError(
            "controllers", name, "a controller, without arguments, with gains such as gain=2.0"
        )
    return gains, [key for key in free if key not in gains]


def has_arguments(name: str) -> bool:
    """Whether constructor arguments follow a controller's name; the path of a policy counts as an
    argument.
    """
    base, _, rest = name.partition(":")
    return bool(rest) if base in CONTROLLERS or name.startswith(_POLICY) else ":" in rest


def _constructor(
    name: str,
) -> tuple[Callable[..., Any], Mapping[str, inspect.Parameter], str | None]:
    """A controller's class, its constructor's parameters, and the arguments that follow its name,
    if any.
    """
    base, colon, given = name.partition(":")
    if base in CONTROLLERS:
        make: Callable[..., Any] = CONTROLLERS[base]
    else:
        attribute, colon, given = given.partition(":")
        if not base or not attribute:
            others = ", ppo:FOLDER or MODULE:CLASS"
            raise InvalidValueError("controller", name, one_of(CONTROLLERS, name, others))
        find_own_modules()
        make = getattr(import_own(base), attribute)
    return make, inspect.signature(make).parameters, given if colon else None


@contextlib.contextmanager
def _errors_of(name: str) -> Iterator[None]:
    """Turn anything that a user's module raises into an InvalidValueError."""
    try:
        yield
    except TrackslipError:
        raise
    except (Exception, SystemExit) as error:
        why = f"{type(error).__name__}: {error}"
        meant = did_you_mean(name.partition(":")[0], CONTROLLERS)
        raise InvalidValueError(
            "controller", name, f"MODULE:CLASS that can be imported and called ({why}){meant}"
        ) from error


def _arguments(
    name: str, given: str | None, parameters: Mapping[str, inspect.Parameter]
) -> dict[str, Any]:
    """Parse ARGUMENT=VALUE,... into arguments by name, converted to the types of the constructor's
    parameters.
    """
    if given is None:
        return {}
    plain = (bool, int, float, str, type(None), type)  # a missing default is a type
    settable = {
        key: parameter
        for key, parameter in parameters.items()
        if isinstance(parameter.default, plain)
    }
    arguments: dict[str, Any] = {}
    for text in given.split(","):
        key, equals, value = text.partition("=")
        if not equals or key not in settable or key in arguments:
            called = name.removesuffix(f":{given}")
            form = (
                f"{called}:ARGUMENT=VALUE,... with different arguments among {', '.join(settable)}"
            )
            raise InvalidValueError(
                "controller", name, form if settable else f"{called} without arguments"
            )
        arguments[key] = _value(key, value, settable[key].default)
    return arguments


def _value(key: str, text: str, default: Any) -> Any:
    """Convert an argument to its default's type: text, boolean or number; without a default, to any
    of these.
    """
    if isinstance(default, str):
        return text
    value: Any = text
    with contextlib.suppress(ValueError):
        value = json.loads(text)
    if isinstance(default, bool):
        require(isinstance(value, bool), key, text, "true or false")
    elif isinstance(default, int | float):
        require(type(value) in (int, float), key, text, "a number")
    if isinstance(value, float):
        require_finite(key, value)
    return float(value) if isinstance(default, float) else value


def locator(name: str, robot: Robot) -> Locator:
    """The localization method called `name`, "plate" or "line"."""
    return LineLocator(robot.plate) if name == "line" else PlateLocator(robot.plate)


def find_own_modules() -> None:
    """Let modules in the current folder be imported, for names of code on the command line."""
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())


def user_modules() -> list[str]:
    """Files of all modules imported from the current folder, such as a user's controllers."""
    here = os.getcwd() + os.sep
    files = {getattr(module, "__file__", None) or "" for module in list(sys.modules.values())}
    return sorted(file for file in files if file.startswith(here) and "site-packages" not in file)


def policy_path(name: str) -> Path | None:
    """The policy file for a controller named ppo:PATH; None for other controllers."""
    return policy_file(_policy_place(name)) if name.startswith(_POLICY) else None


def _policy_place(name: str) -> Path:
    """The path in ppo:PATH; raises InvalidValueError if arguments follow, as policies have none."""
    path = name.removeprefix(_POLICY)
    place, _, given = path.rpartition(":")
    has_arguments = place and "=" in given and not os.path.exists(path)
    require(not has_arguments, "controller", name, f"{_POLICY}{place} without arguments")
    return Path(path)
