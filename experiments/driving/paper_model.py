"""The paper's robot by the paper's own equations, without a simulator: Eqs. 5-7 and 15, with the slip of Eq. 11.

The paper prints no numbers for its Figs. 4, 8 and 10 to 12, but everything they follow from.
"""

from collections.abc import Mapping, Sequence

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
    runs = _driven(controller, start, tuple(KNOWN_LAWS.values()), geometry, paper_reference())
    return dict(zip(KNOWN_LAWS, runs, strict=True))


def published_run(controller: str, start: Array, law: SlipLaw, geometry: RobotGeometry, reference: Reference) -> RunLog:
    """One run compensated with `law`; the robot slips as in Eq. 11 at the curvature that it actually drives."""
    return _driven(controller, start, [law], geometry, reference)[0]


def _driven(
    controller: str, start: Array, laws: Sequence[SlipLaw], geometry: RobotGeometry, reference: Reference
) -> list[RunLog]:
    """A run for each law, all from the same start."""
    driver, limit = CONTROLLERS[controller](), TOP_SPEED / geometry.sprocket_radius
    driver.reset()
    time = np.arange(0, reference.duration + PERIOD / 2, PERIOD)
    pose, commanded, omega = (np.empty((len(time) + 1, len(laws), size)) for size in (3, 2, 2))
    pose[0] = start
    for k, now in enumerate(time.tolist()):
        commanded[k] = driver.twist(now, pose[k], reference)
        wanted = [law.sprocket_speeds(twist, geometry) for law, twist in zip(laws, commanded[k], strict=True)]
        omega[k] = limit_sprocket_speeds(wanted, limit)
        pose[k + 1] = advance(pose[k], PUBLISHED.twist(omega[k], geometry), PERIOD)
    name = f"{controller}, by the paper's equations"
    return [RunLog(name, time, omega[:-1, k], pose[:-1, k], twist_command=commanded[:-1, k]) for k in range(len(laws))]


def geometry_of(metadata: Mapping[str, object]) -> RobotGeometry | None:
    """The geometry in a run's metadata; None where there is none."""
    known = metadata.get("geometry")
    if not isinstance(known, Mapping):
        return None
    return RobotGeometry(float(known["half_gauge"]), float(known["sprocket_radius"]))
