"""The paper's robot by the paper's own equations, without a simulator: Eqs. 5-7 and 15, with the slip of Eq. 11.

The paper prints no numbers for its Figs. 8 and 10 to 12, but everything they follow from.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import Array, RobotGeometry, advance, body_twist, limit_sprocket_speeds, sprocket_speeds
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import KNOWN_LAWS
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.base import Reference, Tabulated
from trackslip.trajectory.segmented import paper_reference

PERIOD = 0.05
"""Time between two commands [s]."""
TOP_SPEED = 0.3
"""Top speed of the paper's robot (Sec. III) [m/s]."""
_DIRECTIONS = 20001  # of commanded motions, in the table of the robot's response


def published_runs(starts: Mapping[str, Array], geometry: RobotGeometry) -> dict[str, dict[str, RunLog]]:
    """Controller -> compensation -> run along the paper's path, with the slip of Eq. 11.

    `starts` are the poses (3,) [m, m, rad] where the runs of each controller begin.
    """
    runs = driven(starts, tuple(KNOWN_LAWS.values()), geometry, paper_reference())
    return {name: dict(zip(KNOWN_LAWS, of_laws, strict=True)) for name, of_laws in runs.items()}


def driven(
    starts: Mapping[str, Array], laws: Sequence[SlipLaw], geometry: RobotGeometry, reference: Reference
) -> dict[str, list[RunLog]]:
    """Controller -> a run for each law that compensates; the robot slips as in Eq. 11 at the curvature that it drives.

    `starts` are the poses (3,) [m, m, rad] where the runs of each controller begin. There is no simulator here, so it
    is not `sim.loop` that drives.
    """
    drivers, limit = [CONTROLLERS[name]() for name in starts], TOP_SPEED / geometry.sprocket_radius
    for driver in drivers:
        driver.reset()
    time = np.arange(0, reference.duration + PERIOD / 2, PERIOD)
    shape = len(time) + 1, len(drivers), len(laws)
    pose, commanded, omega = (np.empty((*shape, size)) for size in (3, 2, 2))
    pose[0] = np.array([*starts.values()])[:, None]
    real, desired = _response(geometry), Tabulated(reference, time)
    for k, now in enumerate(time.tolist()):
        for c, driver in enumerate(drivers):
            commanded[k, c] = driver.twist(now, pose[k, c], desired)
        for j, law in enumerate(laws):
            omega[k, :, j] = law.sprocket_speeds(commanded[k, :, j], geometry)
        omega[k] = limit_sprocket_speeds(omega[k], limit)
        pose[k + 1] = advance(pose[k], real(omega[k]), PERIOD)

    def log(name: str, c: int, j: int) -> RunLog:
        twist = commanded[:-1, c, j]
        return RunLog(f"{name}, by the paper's equations", time, omega[:-1, c, j], pose[:-1, c, j], twist_command=twist)

    return {name: [log(name, c, j) for j in range(len(laws))] for c, name in enumerate(starts)}


def _response(geometry: RobotGeometry) -> Callable[[Array], Array]:
    """The twists (..., 2) that sprocket speeds (..., 2) [rad/s] produce with the slip of Eq. 11, from a table.

    They are as large as the commanded motion (v, b w), times a number that depends on its direction only. Its table is
    so fine that positions on the path are off by about a micrometre.
    """
    b = geometry.half_gauge
    direction = np.linspace(-np.pi, np.pi, _DIRECTIONS)
    unit = np.stack([np.cos(direction), np.sin(direction) / b], axis=-1)
    twist = PUBLISHED.twist(sprocket_speeds(unit, 0.0, geometry), geometry)
    ratio = (twist[:, 0] + 1j * b * twist[:, 1]) * np.exp(-1j * direction)

    def real(omega: Array) -> Array:
        commanded = body_twist(omega, 0.0, geometry)
        motion = commanded[..., 0] + 1j * b * commanded[..., 1]
        motion = motion * np.interp(np.angle(motion), direction, ratio)
        return np.stack([motion.real, motion.imag / b], axis=-1)

    return real
