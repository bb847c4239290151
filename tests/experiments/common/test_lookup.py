import dataclasses
from pathlib import Path

import pytest

from experiments.common.lookup import controller, tunable
from trackslip.controllers.feedback import LinearTimeVarying, Lqr
from trackslip.controllers.predictive import ModelPredictive
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry

GEOMETRY = RobotGeometry(0.2, 0.05)
MINE = """
class Mine:
    def __init__(
        self, geometry, half_gauge, track_speed, period, gain=1.0, name="a", fast=False, more=None
    ):
        self.found = {key: value for key, value in locals().items() if key != "self"}
    def reset(self): ...
    def twist(self, time, pose, reference): ...
"""


def made(name):
    return controller(name, GEOMETRY, 0.5, 0.1, half_gauge=0.25)


def test_arguments_are_the_constructors_and_the_robots_are_known():
    assert made("linear") == LinearTimeVarying()
    assert made("linear:stiffness=160,damping=1") == LinearTimeVarying(damping=1.0, stiffness=160.0)
    assert isinstance(made("linear:stiffness=160").stiffness, float)
    assert made("mpc") == ModelPredictive(track_speed=0.98 * 0.5, half_gauge=0.25)
    assert made("mpc:track_speed=0.2,intervals=9") == dataclasses.replace(
        made("mpc"), track_speed=0.2, intervals=9
    )
    assert made("lqr") == Lqr(period=0.1)


def test_a_users_class_gets_both(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("asks_for_limits.py").write_text(MINE)
    known = {
        "geometry": GEOMETRY,
        "half_gauge": 0.25,
        "track_speed": pytest.approx(0.49),
        "period": 0.1,
    }
    default = {"gain": 1.0, "name": "a", "fast": False, "more": None}
    assert made("asks_for_limits:Mine").found == known | default
    given = {"gain": 3.0, "name": "7", "fast": True, "more": 0.5, "period": 0.2}
    assert (
        made("asks_for_limits:Mine:gain=3,name=7,fast=true,more=0.5,period=0.2").found
        == known | given
    )
    wrong = {
        "gain=x": "gain = 'x': must be a number",
        "fast=1": "fast = '1': must be true",
        "k=1": "Mine:ARGUMENT=VALUE",
    }
    for argument, message in wrong.items():
        with pytest.raises(InvalidValueError, match=message):
            made(f"asks_for_limits:Mine:{argument}")


def test_gains_are_positive_floats_that_do_not_describe_a_robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    defaults = (
        'gain=2.0, rate=0.5, top=float("inf"), zero=0.0, back=-1.0, n=3, on=True, '
        "more=None, period=0.1"
    )
    Path("has_gains.py").write_text(f"class Mine:\n    def __init__(self, name, {defaults}): ...")
    others = ["name", "top", "zero", "back", "n", "on", "more"]
    assert tunable("has_gains:Mine") == ({"gain": 2.0, "rate": 0.5}, others)
    for name in ("feedforward", "linear:damping=1", "ppo:out/train"):
        with pytest.raises(InvalidValueError, match="without arguments, with gains such as"):
            tunable(name)
