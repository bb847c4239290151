"""Names on the command line resolved to objects: references, compensations, controllers, localization methods."""

import contextlib
import functools
import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sim.network import policy_file
from sim.policy import Policy, PolicyController
from sim.robot.robot import Robot
from trackslip.controllers.base import Controller
from trackslip.controllers.named import CONTROLLERS
from trackslip.errors import InvalidValueError, TrackslipError, require, require_finite
from trackslip.kinematics import RobotGeometry
from trackslip.localization.base import Locator
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.slip.compensation import Compensation, named_compensation
from trackslip.slip.law_file import SHIPPED
from trackslip.trajectory.base import Reference
from trackslip.trajectory.named import load_reference

_POLICY = "ppo:"
_OF_THE_ROBOT = ("geometry", "half_gauge", "track_speed", "period")  # parameters of constructors that are given
_MARGIN = 0.98  # share of the top speed that controllers plan with
REACH = 1.27
"""(b + D) / b on hard ground: how far out slip compensation places the tracks [-]."""


@functools.lru_cache(maxsize=64)
def reference(name: str) -> Reference:
    """A reference by name or from a file; raises TrackslipError for anything else."""
    return load_reference(name)


def compensation(name: str, robot: RobotGeometry, laws: Path | None) -> Compensation:
    """A new compensation by name, using the laws in a file (default: those in the package).

    Raises InvalidValueError for an unknown name, LogError for a file that can't be read or is for another robot.
    """
    return named_compensation(name, robot, laws or SHIPPED)


def controller(name: str, geometry: RobotGeometry, top_speed: float, period: float) -> Controller:
    """A new controller: one of CONTROLLERS or a user's MODULE:CLASS, both with arguments, or a policy, ppo:PATH.

    Arguments of the constructor follow the name, as in linear:stiffness=160,damping=1. Unless given, parameters of
    these names get what they are for this robot: `geometry`; `half_gauge`, effective with slip compensation [m];
    `track_speed`, slightly below `top_speed` of the tracks [m/s]; `period` between two commands [s].

    Raises:
        InvalidValueError: for an unknown name or argument and a value that is not allowed.
    """
    if name.startswith(_POLICY):
        return PolicyController(Policy.load(Path(name.removeprefix(_POLICY))), top_speed / geometry.sprocket_radius)
    known = dict(zip(_OF_THE_ROBOT, (geometry, REACH * geometry.half_gauge, _MARGIN * top_speed, period), strict=True))
    with _refused(name):
        make, accepted, given = _constructor(name)
        arguments = {key: value for key, value in known.items() if key in accepted}
        made: Controller = make(**arguments | _arguments(name, name.removesuffix(f":{given}"), given, accepted))
    for method in ("reset", "twist"):
        if not callable(getattr(made, method, None)):
            raise InvalidValueError("controller", name, f"a class with a method {method}: see trackslip.controllers")
    return made


def tunable(name: str) -> dict[str, float]:
    """Gains in a controller's constructor with their defaults: positive floats, but for those that describe the robot.

    Raises InvalidValueError for an unknown name, a controller with arguments, and one that has no gains.
    """
    found: dict[str, float] = {}
    if not name.startswith(_POLICY):
        with _refused(name):
            _, accepted, given = _constructor(name)
        for key, one in accepted.items() if not given else ():
            number = isinstance(one.default, float) or (isinstance(one.default, int) and _kind(one) == "float")
            if key not in _OF_THE_ROBOT and number and 0 < one.default < float("inf"):
                found[key] = float(one.default)
    if not found:
        raise InvalidValueError("controllers", name, "a controller, without arguments, with gains such as gain=2.0")
    return found


def _constructor(name: str) -> tuple[Callable[..., Any], Mapping[str, inspect.Parameter], str]:
    """The class of a controller, the parameters of its constructor, and the arguments that follow its name."""
    base, _, given = name.partition(":")
    if base in CONTROLLERS:
        return CONTROLLERS[base], inspect.signature(CONTROLLERS[base]).parameters, given
    attribute, _, given = given.partition(":")
    if not base or not attribute:
        raise InvalidValueError("controller", name, f"one of {', '.join(CONTROLLERS)}, or MODULE:CLASS")
    make = _imported(base, attribute)
    return make, inspect.signature(make).parameters, given


@contextlib.contextmanager
def _refused(name: str) -> Iterator[None]:
    """Turn anything that a user's module raises into an InvalidValueError."""
    try:
        yield
    except TrackslipError:
        raise
    except (Exception, SystemExit) as error:
        why = f"{type(error).__name__}: {error}"
        raise InvalidValueError("controller", name, f"MODULE:CLASS that can be imported and called ({why})") from error


def _arguments(name: str, called: str, given: str, accepted: Mapping[str, inspect.Parameter]) -> dict[str, Any]:
    """Arguments by name from ARGUMENT=VALUE,..., of the types of the constructor's parameters."""
    plain = (bool, int, float, str, type(None), type)  # an empty default is a type
    settable = {key: one for key, one in accepted.items() if isinstance(one.default, plain)}
    found: dict[str, Any] = {}
    for text in given.split(",") if name != called else ():
        key, equals, value = text.partition("=")
        if not equals or key not in settable or key in found:
            form = f"{called}:ARGUMENT=VALUE,... with different arguments among {', '.join(settable)}"
            raise InvalidValueError("controller", name, form if settable else f"{called} without arguments")
        found[key] = _value(key, value, settable[key])
    return found


def _value(key: str, text: str, parameter: inspect.Parameter) -> Any:
    """An argument's value, of the type of the annotation or the default; without one, a number or else a text."""
    kind = _kind(parameter)
    if kind == "str":
        return text
    if kind == "bool":
        require(text in ("true", "false"), key, text, "true or false")
        return text == "true"
    try:
        number = int(text) if kind == "int" or text.lstrip("+-").isdigit() else float(text)
    except ValueError:
        require(kind not in ("int", "float"), key, text, "a whole number" if kind == "int" else "a number")
        return text
    require_finite(key, number)
    return float(number) if kind == "float" else number


def _kind(parameter: inspect.Parameter) -> Any:
    """Name of the type of a parameter, by its annotation or its default."""
    kind = parameter.annotation if parameter.annotation is not parameter.empty else type(parameter.default)
    return getattr(kind, "__name__", kind)


def locator(name: str, robot: Robot) -> Locator:
    """The localization method called `name`: plate or line."""
    return LineLocator(robot.plate) if name == "line" else PlateLocator(robot.plate)


def user_modules() -> list[str]:
    """Files of all modules imported from the current folder, such as a user's controllers."""
    here = os.getcwd() + os.sep
    files = {getattr(module, "__file__", None) or "" for module in list(sys.modules.values())}
    return sorted(file for file in files if file.startswith(here) and "site-packages" not in file)


def policy_path(name: str) -> Path | None:
    """The policy file of a controller ppo:PATH; None for other controllers."""
    return policy_file(Path(name.removeprefix(_POLICY))) if name.startswith(_POLICY) else None


def _imported(module: str, attribute: str) -> Any:
    """An attribute of a module, which may be in the current folder."""
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    return getattr(importlib.import_module(module), attribute)
