"""What the paper's own equations say that its robot does: Eqs. 5-7 and 15 with slips by Eq. 11, and no simulator.

The paper prints no numbers of its Figs. 4, 8 and 10 to 12, but all that they follow from.
"""

from __future__ import annotations

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
"""Of the paper's robot (Sec. III) [m/s]."""
COMPENSATIONS: Mapping[str, SlipLaw] = {"none": NoSlip(), "published": PUBLISHED}
"""Those of the paper."""


def published_poses(log: RunLog) -> Array:
    """Poses (T, 3) on the circle that a steady run's sprocket speeds drive if slip is Eq. 11's, from where it began."""
    geometry = geometry_of(log.metadata)
    assert geometry is not None
    begin = log.pose[int(np.argmax(log.is_valid))] if log.truth is None else log.truth.pose[0]
    twist = PUBLISHED.twist(np.median(log.omega, axis=0), geometry)
    return advance(begin, twist, log.time - log.time[0])


def published_runs(controller: str, start: Array, geometry: RobotGeometry) -> dict[str, RunLog]:
    """Compensation -> run along the paper's path of a robot whose slip is Eq. 11's, from a pose (3,)."""
    return {
        name: published_run(controller, start, law, geometry, paper_reference()) for name, law in COMPENSATIONS.items()
    }


def published_run(controller: str, start: Array, law: SlipLaw, geometry: RobotGeometry, reference: Reference) -> RunLog:
    """One run: `law` compensates, and the slip is Eq. 11's at the curvature that is really driven."""
    driver = CONTROLLERS[controller]()
    driver.reset()
    time = np.arange(0, reference.duration + PERIOD / 2, PERIOD)
    poses = [np.asarray(start, float)]
    asked, omegas = [], []
    for now in time:
        asked.append(driver.twist(float(now), poses[-1], reference))
        omega = law.sprocket_speeds(asked[-1], geometry)
        omegas.append(limit_sprocket_speeds(omega, TOP_SPEED / geometry.sprocket_radius))
        poses.append(advance(poses[-1], PUBLISHED.twist(omegas[-1], geometry), PERIOD))
    return RunLog(
        f"{controller}, by the paper's equations", time, np.array(omegas), np.array(poses[:-1]),
        twist_command=np.array(asked),
    )  # fmt: skip


def geometry_of(metadata: Mapping[str, object]) -> RobotGeometry | None:
    """A run's geometry, if it is known."""
    known = metadata.get("geometry")
    if not isinstance(known, Mapping):
        return None
    return RobotGeometry(float(known["half_gauge"]), float(known["sprocket_radius"]))
