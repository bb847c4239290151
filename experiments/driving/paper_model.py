"""The paper's robot by the paper's own equations, without a simulator: Eqs. 5-7 and 15, with the slip of Eq. 11.

The paper prints no numbers for its Figs. 4, 8 and 10 to 12, but everything they follow from.
"""

from collections.abc import Mapping

import numpy as np

from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import Array, RobotGeometry, advance, limit_sprocket_speeds
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import NoSlip
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import paper_reference

PERIOD = 0.05
"""Time between two commands [s]."""
TOP_SPEED = 0.3
"""Top speed of the paper's robot (Sec. III) [m/s]."""
KNOWN_LAWS: Mapping[str, SlipLaw] = {"none": NoSlip(), "published": PUBLISHED}
"""The paper's compensations, slip laws that need no identification."""


def published_poses(log: RunLog) -> Array:
    """Poses (T, 3) [m, m, rad] on the circle that a steady run's sprocket speeds give with the slip of Eq. 11."""
    geometry = geometry_of(log.metadata)
    assert geometry is not None
    begin = log.pose[int(np.argmax(log.is_valid))] if log.truth is None else log.truth.pose[0]
    twist = PUBLISHED.twist(np.median(log.omega, axis=0), geometry)
    return advance(begin, twist, log.time - log.time[0])


def published_runs(controller: str, start: Array, geometry: RobotGeometry) -> dict[str, RunLog]:
    """Compensation -> run along the paper's path, with the slip of Eq. 11, from the pose `start` (3,) [m, m, rad]."""
    path = paper_reference()
    return {name: published_run(controller, start, law, geometry, path) for name, law in KNOWN_LAWS.items()}


def published_run(controller: str, start: Array, law: SlipLaw, geometry: RobotGeometry, reference: Reference) -> RunLog:
    """One run compensated with `law`; the robot slips as in Eq. 11 at the curvature that it actually drives."""
    driver = CONTROLLERS[controller]()
    driver.reset()
    time = np.arange(0, reference.duration + PERIOD / 2, PERIOD)
    poses = [np.asarray(start, float)]
    commanded, omegas = [], []
    for now in time:
        commanded.append(driver.twist(float(now), poses[-1], reference))
        omega = law.sprocket_speeds(commanded[-1], geometry)
        omegas.append(limit_sprocket_speeds(omega, TOP_SPEED / geometry.sprocket_radius))
        poses.append(advance(poses[-1], PUBLISHED.twist(omegas[-1], geometry), PERIOD))
    name, twist = f"{controller}, by the paper's equations", np.array(commanded)
    return RunLog(name, time, np.array(omegas), np.array(poses[:-1]), twist_command=twist)


def geometry_of(metadata: Mapping[str, object]) -> RobotGeometry | None:
    """The geometry in a run's metadata; None where there is none."""
    known = metadata.get("geometry")
    if not isinstance(known, Mapping):
        return None
    return RobotGeometry(float(known["half_gauge"]), float(known["sprocket_radius"]))
