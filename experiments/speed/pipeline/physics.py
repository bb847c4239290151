"""The physics of the shipped robot, compared with the same model compiled without what makes it cheaper.

Left out are stages of the engine that have nothing to do for this robot, and cameras and lights, which would be moved
in every step; and the force sensors of the tracks find their contacts faster (`sim.robot.savings`). None of this may
change a bit of the motion or of the forces.
"""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from mujoco import batch

from experiments.driving.grid_runs import cells_of
from experiments.measuring.check import Check
from experiments.options.grid import RunsConfig
from experiments.speed.simulator import bare_batch, timed
from sim.fleet import Fleet
from sim.robot.robot import VISUAL_GROUP, Robot, load_robot
from trackslip.kinematics import Array, sprocket_speeds

_MOST = 0.9  # time of a step over that before
_STEPS = 500  # of all robots together in a turn: a few milliseconds, shorter than most disturbances
_TURNS = 100  # of both models, in a round
_UNDISTURBED = 5  # percentile of the times of turns
_UNDER_WAY = 2.0  # after which the sprockets turn at their set points [s]


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Wall time of a step over that of the model as it was, on one thread; and the numbers that differ after 30 s.

    Both models take short turns from the same state. Compared are the turns of each that were disturbed least: other
    programs on the same core slow down both, but not alike. Nothing is random, so `seed` doesn't matter. `step` is
    called with a label after each round.
    """
    robot = load_robot()
    before = without_savings(robot)
    checks = []
    for case, omega in (("one robot", _speeds(robot)[:1]), ("25 robots", _speeds(robot))):
        now, old = (bare_batch(_driven(one, omega, _UNDER_WAY)) for one in (robot, before))
        seconds = []  # now and before, of each turn
        for _ in range(repeats):
            seconds += [_turn(now, old, k % 2 == 0) for k in range(_TURNS)]
            step(f"physics of {case}")
        least, least_before = np.percentile(seconds, _UNDISTURBED, axis=0)
        checks.append(Check(f"physics of {case}", "a step over one before", float(least / least_before), _MOST, "x"))
    different = differences(robot, before, RunsConfig.duration)
    return (*checks, Check("physics of 25 robots", "numbers that differ after 30 s", different, 0, "1"))


def without_savings(robot: Robot) -> Robot:
    """The robot of a file, with all stages of the engine, its cameras and lights, and one ground for both tracks."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    if robot.parameters is not None:
        robot.parameters.apply(spec)
    for geom in list(spec.geoms):
        if geom.group == VISUAL_GROUP:
            spec.delete(geom)
    model = spec.compile()
    model.flg_surfacevel = 1
    first = int(model.geom("left_pad0").id)
    return replace(robot, model=model, pads=slice(first, first + len(robot.pad_side)))


def differences(robot: Robot, other: Robot, duration: float) -> int:
    """How many numbers differ after the paper's 25 runs of some duration [s] with two robots.

    Compared are the engine's states, sensors among them, and the energies of the motors, which add up all forces.
    """
    one, two = (_driven(each, _speeds(robot), duration) for each in (robot, other))
    pairs = (one.batch.state, two.batch.state), (one.drive.energy, two.drive.energy)
    return sum(int((mine != others).sum()) for mine, others in pairs)


def _speeds(robot: Robot) -> Array:
    """Sprocket speeds (25, 2) of the paper's runs [rad/s]."""
    twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells_of(RunsConfig())])
    return sprocket_speeds(twist, 0.0, robot.geometry)


def _driven(robot: Robot, omega: Array, duration: float) -> Fleet:
    fleet = Fleet(robot, np.zeros((len(omega), 3)), threads=1)
    fleet.command(omega)
    fleet.advance(duration)
    return fleet


def _turn(now: batch.Batch, old: batch.Batch, first: bool) -> tuple[float, float]:
    """Times of the same steps now and before [s]; `first` says whether the one now is measured first."""
    start, steps = now.state.copy(), _STEPS // now.nsim
    taken = {}
    for one in (now, old) if first else (old, now):
        one.state[:] = start
        taken[one] = timed(one.step, None, steps)
    now.state[:] = start
    return taken[now], taken[old]
