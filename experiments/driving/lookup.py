"""Names on the command line resolved to objects: references, compensations, controllers, localization methods."""

import functools
import importlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from experiments.driving.paper_model import KNOWN_LAWS
from sim.network import policy_file
from sim.policy import Policy, PolicyController
from sim.robot.robot import Robot
from trackslip.controllers.base import Controller
from trackslip.controllers.mpc import ModelPredictive
from trackslip.controllers.named import CONTROLLERS
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.kinematics import RobotGeometry
from trackslip.localization.base import Locator
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import Compensation, FixedLaw, LoadedOnlineIcr, OnlineIcr, known_law
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.icr_load import IcrLoad
from trackslip.slip.law_file import SHIPPED, load_laws
from trackslip.trajectory.base import Reference
from trackslip.trajectory.named import load_reference

_ONLINE, _ONLINE_LOAD, _ONLINE_COLD = "online", "online_load", "online_cold"
_POLICY = "ppo:"
_MARGIN = 0.98  # share of the top speed that the MPC plans with
REACH = 1.27
"""(b + D) / b on hard ground: how far out slip compensation places the tracks [-]."""
_PRIORS = {_ONLINE: "icr_radius", _ONLINE_LOAD: "icr_load"}  # the laws that they start from


@functools.lru_cache(maxsize=64)
def reference(name: str) -> Reference:
    """A reference by name or from a file; raises TrackslipError for anything else."""
    return load_reference(name)


def compensation(name: str, robot: RobotGeometry, laws: Path | None) -> Compensation:
    """A new compensation by name, using the laws in a file (default: those in the package).

    Raises InvalidValueError for an unknown name, LogError for a file that can't be read or is for another robot.
    """
    if name in KNOWN_LAWS:
        return FixedLaw(KNOWN_LAWS[name])
    if name == _ONLINE_COLD:
        return OnlineIcr(robot)
    stored = load_laws(laws or SHIPPED, robot)
    if name == _ONLINE and isinstance(prior := stored.get(_PRIORS[name]), ConstantIcr):
        return OnlineIcr(robot, prior)
    if name == _ONLINE_LOAD and isinstance(prior := stored.get(_PRIORS[name]), IcrLoad):
        return LoadedOnlineIcr(robot, prior)
    if name not in stored:
        names = [*KNOWN_LAWS, *stored, *_learning(stored), _ONLINE_COLD]
        raise InvalidValueError("compensation", name, f"one of {', '.join(names)}")
    return known_law(stored[name])


def _learning(stored: Mapping[str, SlipLaw]) -> list[str]:
    """The compensations that can start from stored laws."""
    return [name for name, prior in _PRIORS.items() if prior in stored]


def controller(name: str, robot: RobotGeometry, top_speed: float) -> Controller:
    """A new controller: one of CONTROLLERS, a trained policy (ppo:PATH), or an instance of a user's MODULE:CLASS.

    `top_speed` is that of the tracks [m/s]. Raises InvalidValueError for any other name.
    """
    if name == "mpc":
        return ModelPredictive(track_speed=_MARGIN * top_speed, half_gauge=REACH * robot.half_gauge)
    if name in CONTROLLERS:
        return CONTROLLERS[name]()
    if name.startswith(_POLICY):
        return PolicyController(Policy.load(Path(name.removeprefix(_POLICY))), top_speed / robot.sprocket_radius)
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        raise InvalidValueError("controller", name, f"one of {', '.join(CONTROLLERS)}, or MODULE:CLASS")
    made = _call(name, module, attribute)
    for method in ("reset", "twist"):
        if not callable(getattr(made, method, None)):
            raise InvalidValueError("controller", name, f"a class with a method {method}: see trackslip.controllers")
    return made


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


def _call(name: str, module: str, attribute: str) -> Controller:
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        return getattr(importlib.import_module(module), attribute)()
    except TrackslipError:
        raise
    except (Exception, SystemExit) as error:  # a user's module may raise anything
        why = f"{type(error).__name__}: {error}"
        raise InvalidValueError("controller", name, f"MODULE:CLASS that can be imported and called ({why})") from error
