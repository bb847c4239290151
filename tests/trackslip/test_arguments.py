"""Arguments of the wrong type are named, in every public function and class."""

import inspect
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import sim
import trackslip
from trackslip.arguments import arguments_of, checks_arguments
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry

MADE_BY_FUNCTIONS = {
    *("Identification", "OdometryErrors", "BenchmarkResults", "LogComparison", "DrivePlan"),
    *("RobotCheck", "TrackedModel", "Outcome", "Description", "PoseEstimate"),
}
"""Public classes that functions return, and nobody else makes."""
CONTROLLERS = {
    name
    for name in trackslip.__all__
    if getattr(getattr(trackslip, name), "__module__", "").startswith("trackslip.controllers")
}
"""Controllers are called by loops, many times a second."""
ERRORS = {name for name in trackslip.__all__ if name.endswith(("Error", "Warning"))}


class Case(NamedTuple):
    name: str
    call: Callable
    argument: str


def public_callables():
    """Public functions, constructors and methods, with their names."""
    for package in (trackslip, sim):
        for name in package.__all__:
            public = getattr(package, name)
            if name in MADE_BY_FUNCTIONS | CONTROLLERS | ERRORS or name.startswith("__"):
                continue
            if not inspect.isclass(public):
                if inspect.isfunction(public):
                    yield name, public
                continue
            if issubclass(public, RuntimeError | Exception):
                continue
            yield name, public.__init__
            for key, member in vars(public).items():
                if not key.startswith("_") and inspect.isfunction(member):
                    yield f"{name}.{key}", member


CASES = [
    Case(f"{name}({argument.name})", function, argument.name)
    for name, function in public_callables()
    for argument in arguments_of(function)
]


class Wrong:
    """Of no type that any function takes."""


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_an_argument_of_the_wrong_type_is_named(case):
    wrong = Wrong()
    with pytest.raises(InvalidValueError) as caught:
        case.call(None, **{case.argument: wrong}) if "self" in inspect.signature(
            case.call
        ).parameters else case.call(**{case.argument: wrong})
    assert caught.value.field == case.argument
    assert caught.value.value is wrong


def test_there_are_many_such_arguments():
    assert len(CASES) > 100


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: trackslip.identify("log.csv", (0.3, 0.1)),
            "geometry = (0.3, 0.1): must be a RobotGeometry(half_gauge, sprocket_radius) or None",
        ),
        (
            lambda: trackslip.identify(5),
            "source = 5: must be text, a path, a RunLog, several RunLogs or an object with "
            "__arrow_c_stream__",
        ),
        (lambda: trackslip.SlipOdometry(0.3, None), "law = 0.3: must be a SlipLaw"),
        (
            lambda: trackslip.save_laws("laws.json", {"icr": 0.3}, None),
            "laws = {'icr': 0.3}: must be a mapping to SlipLaws",
        ),
        (
            lambda: trackslip.identify("log.csv", columns=3),
            "columns = 3: must be text, a mapping to texts or None",
        ),
    ],
    ids=["tuple as geometry", "number as log", "number as law", "mapping", "columns"],
)
def test_the_message_says_what_is_allowed(call, message):
    with pytest.raises(InvalidValueError) as caught:
        call()
    assert str(caught.value) == message


def test_a_law_of_ones_own_is_checked_too():
    class Own(trackslip.NoSlip):
        def twist(self, omega, geometry: RobotGeometry):
            return np.zeros(2)

    assert Own().twist(np.zeros(2), RobotGeometry(0.3, 0.1)).tolist() == [0, 0]
    with pytest.raises(InvalidValueError, match="geometry = 3"):
        Own().twist(np.zeros(2), 3)


def test_subclasses_positions_and_defaults_are_as_before():
    class Wide(RobotGeometry):
        pass

    @checks_arguments
    def gauge(geometry: RobotGeometry | None = None, factor: float = 2.0) -> float:
        """Twice the half gauge."""
        return 0.0 if geometry is None else factor * geometry.half_gauge

    assert gauge() == 0.0
    assert gauge(Wide(0.3, 0.1)) == 0.6
    assert gauge(geometry=Wide(0.3, 0.1), factor=4.0) == 1.2
    assert gauge.__doc__ == "Twice the half gauge."
    assert list(inspect.signature(gauge).parameters) == ["geometry", "factor"]


def test_an_iterator_is_not_used_up():
    @checks_arguments
    def count(logs: list[trackslip.RunLog]) -> int:
        return len([*logs])

    assert count(iter([1, 2, 3])) == 3
    with pytest.raises(InvalidValueError, match=r"logs = \[1, 2\]: must be several RunLogs"):
        count([1, 2])
