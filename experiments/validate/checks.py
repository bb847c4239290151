"""Checks of a robot on its ground: measurements compared with theory, and checks that do not
apply.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from experiments.common.check import Check
from experiments.validate.measurements import (
    GRAVITY,
    Setup,
    Turns,
    drive_steadily,
    measure_loads,
    paper_turns,
    speed_scale,
)
from sim.runs.run_recorder import read_contacts
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.kinematics import Array
from trackslip.skid_theory import Load

SLIP_BOUND: Final = 0.002
"""Largest deviation of slips in turns from theory [-]."""
SLIDING_BOUND: Final = 0.05
"""Largest deviation of accelerations on slopes from theory, relative to them [-]."""
# slope that robots climb and park on, if friction holds them on twice that slope
_GENTLE: Final = math.radians(10.0)
_MARGIN: Final = math.radians(
    9.0
)  # robots closer than this to tipping over rock when they begin to slide
# sources of what is expected
_BALANCE: Final = "quasi-static balance (trackslip.skid_theory)"
_SPRINGS: Final = "rigid robot on springs"
_COULOMB: Final = "Coulomb's law"


@dataclass
class Checks:
    """Checks of a robot on its ground."""

    robot: str
    setup: Setup
    done: list[Check] = field(default_factory=list)
    not_applicable: list[str] = field(default_factory=list)
    """Quantities that do not apply, with the reason."""

    def add(self, what: str, pair: ArrayLike, tolerance: ArrayLike, unit: str, source: str) -> None:
        """Check theory and measurement, `pair` (2, ...), at the value closest to its bound or
        farthest beyond it.
        """
        arrays = np.broadcast_arrays(*np.asarray(pair), tolerance)
        theory, measured, allowed = (values.ravel() for values in arrays)
        share_of_bound = np.abs(measured - theory) / allowed
        k = int(np.argmax(share_of_bound))
        check = Check(
            case=self.robot,
            what=what,
            measured=float(measured[k]),
            tolerance=float(allowed[k]),
            unit=unit,
            expected=float(theory[k]),
            source=source,
        )
        self.done.append(check)

    @property
    def failed(self) -> list[str]:
        """Quantities that are outside their bounds."""
        return [check.what for check in self.done if not check.holds]

    @property
    def verdict(self) -> str:
        """Numbers of checks that passed, failed, and do not apply."""
        failed = len(self.failed)
        counts = {
            "checks passed": len(self.done) - failed,
            "failed": failed,
            "not applicable": len(self.not_applicable),
        }
        return ", ".join(f"{count} {what}" for what, count in counts.items() if count)

    @property
    def gentle_slope(self) -> float:
        """A slope on which the robot stays, at most half of the steepest one that holds it
        [rad].
        """
        return min(_GENTLE, math.atan(self.setup.ground.along) / 2)

    def tips_over(self, what: str, heading: float, slope: float) -> bool:
        """True, with a note on `what`, if the robot may tip over on a slope, heading uphill (0) or
        across it.

        It tips over when its centre of mass is above the last contact point: h tan(slope) = d,
        with the height h of the centre of mass and its distance d from that point.
        """
        robot = self.setup.parameters
        x, y = self.setup.robot().contact_points.T
        distance = y.max() - robot.com_y if heading else robot.com_x - x.min()
        tips_at = math.atan2(distance, robot.com_height)
        if tips_at >= slope + _MARGIN:
            return False
        needed, spare, most = (f"{math.degrees(angle):.0f}°" for angle in (slope, _MARGIN, tips_at))
        reason = (
            f"too steep for this robot: {needed} and {spare} to spare > {most}, where it tips over"
        )
        self.not_applicable.append(f"{what}: {reason}")
        return True


def check_turns(checks: Checks) -> Turns:
    """Check turns with the paper's radii, turns on the spot, and slip uphill; returns the paper's
    turns.
    """
    setup = checks.setup
    scale = speed_scale(setup.parameters)

    # the paper's turns
    bound = 0.01 if setup.parameters.axles else 0.005
    turns = drive_steadily(setup, paper_turns(setup.parameters)[2])
    checks.add("b + D in turns", turns.half_width, bound * turns.half_width[0], "m", _BALANCE)
    checks.add("slip in turns", turns.slip, SLIP_BOUND, "1", _BALANCE)

    # turns on the spot
    belts = scale * np.outer([0.06, 0.12, 0.24], [-1.0, 1.0])
    spins = drive_steadily(setup, belts / setup.sprocket_radius)
    checks.add("b + D on the spot", spins.half_width, 0.013 * spins.half_width[0], "m", _BALANCE)

    # straight uphill
    belts = scale * np.array([[0.12, 0.12]])
    uphill = Load(checks.gentle_slope)
    try:
        climb = drive_steadily(setup, belts / setup.sprocket_radius, uphill)
    except InvalidValueError as error:
        # the balance is for a robot whose tracks bear load over their whole length
        raise TrackslipError(
            f"{checks.robot}: can't be checked, as a part of a track lifts uphill on "
            f"{math.degrees(uphill.slope):.0f}°: its centre of mass must be lower or further "
            "ahead, for example with its arm folded by [joints] or `key`"
        ) from error
    checks.add("slip uphill", climb.slip, 0.001, "1", _BALANCE)
    return turns


def check_standing(checks: Checks) -> None:
    """Check loads and lean in the paper's turns, and creep on a slope."""
    setup = checks.setup
    _, _, omega = paper_turns(setup.parameters)
    loads, attitude = measure_loads(setup, omega)
    sink = attitude[..., 0].mean(axis=1)
    checks.add("load of a contact point, over the mean", loads, 0.05, "1", _SPRINGS)
    checks.add("sink on level ground", sink, 0.05 * sink[0], "m", _SPRINGS)
    checks.add("roll and pitch in turns", attitude[..., 1:], math.radians(0.05), "rad", _SPRINGS)

    check_creep(checks)


def check_creep(checks: Checks) -> None:
    """Check creep of robots parked uphill, obliquely and across a slope."""
    setup = checks.setup
    slope = checks.gentle_slope
    creep = f"creep, parked on {math.degrees(slope):.0f}°"
    if checks.tips_over(creep, 0.0, slope):
        return
    start = [(0.0, 0.0, heading) for heading in (0.0, np.pi / 4, np.pi / 2)]
    fleet = setup.fleet(start, replace(setup.ground, slope=slope))
    fleet.advance(2.0)
    before = fleet.pose()
    fleet.advance(5.0)
    moved = fleet.pose() - before
    speed = np.hypot(moved[:, 0], moved[:, 1]) / 5.0
    allowed = 0.06e-3 if setup.ground.shear else 0.05e-3
    checks.add(creep, [0 * speed, speed], allowed, "m/s", _COULOMB)


def check_sliding(checks: Checks) -> dict[str, Array]:
    """Check accelerations on slopes that don't hold the robot.

    Returns by direction (3, S): slopes [rad], and accelerations of the centre of mass in theory and
    simulated [m/s^2].
    """
    ground = checks.setup.ground
    measured = {}
    for direction, heading, friction in (
        ("downhill", 0.0, ground.along),
        ("sideways", np.pi / 2, ground.across),
    ):
        limit = math.atan(friction)
        what = f"acceleration sliding {direction}"
        if checks.tips_over(what, heading, limit):
            continue
        slopes = limit + np.radians([2.0, 3.0, 4.0])
        simulated = _sliding(checks.setup, heading, limit, slopes)
        expected = GRAVITY * (np.sin(slopes) - np.cos(slopes) * friction)
        allowed = SLIDING_BOUND * expected
        checks.add(what, [expected, simulated], allowed, "m/s^2", _COULOMB)
        measured[direction] = np.stack([slopes, expected, simulated])
    return measured


def _sliding(setup: Setup, heading: float, limit: float, slopes: Array) -> Array:
    """Accelerations (S,) of the centre of mass of robots that slide on slopes (S,) beyond the
    `limit` on which friction holds them [m/s^2].
    """
    ground = setup.ground
    start = np.tile([0.0, 0.0, heading], (len(slopes), 1))
    fleet = setup.fleet(start)
    chassis = fleet.robot.model.body("chassis").id
    velocity = fleet.batch.bind("cvel")[:, chassis, 3:5]  # of the centre of mass, live

    # tilt slowly until the loads are as in sliding
    for share in np.linspace(0.0, 0.97, 100).tolist():
        fleet.set_ground(replace(ground, slope=share * limit))
        fleet.advance(0.02)
    fleet.advance(1.0)

    # let go
    fleet.set_ground([replace(ground, slope=float(slope)) for slope in slopes])
    fleet.advance(0.25)
    before = np.hypot(velocity[:, 0], velocity[:, 1])
    fleet.advance(0.25)
    after = np.hypot(velocity[:, 0], velocity[:, 1])
    return np.asarray((after - before) / 0.25)


def check_energy(checks: Checks, generator: np.random.Generator) -> None:
    """Check that the belts' work in random driving equals losses plus stored energy, each from an
    independent source.

    Forces and sliding speeds come from contact sensors, energies from MuJoCo. Over a step h, the
    ground's force F at a contact point acts at the mean u of the point's sliding velocities before
    and after the step, and its load N at the mean speed z at which the point rises, so that the
    ground and the contact take -(F·u + N z) h. A belt with speed s does the work -F_x s h, which
    must be what was taken plus the increase of the stored energy.
    """
    robot = checks.setup.robot(contact_sensors=True)
    robots = 4
    robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = robot.model.opt.timestep
    drive = replace(checks.setup.drive, period=step)
    fleet = checks.setup.fleet(np.zeros((robots, 3)), robot=robot, drive=drive)
    energy = fleet.batch.bind("energy")  # live

    # a new random command every second
    contacts = []
    total = []
    for k in range(round(10.0 / step) + 1):
        if k % round(1.0 / step) == 0:
            limit = fleet.drive.limit
            fleet.command(generator.uniform(-limit, limit, (robots, 2)))
        fleet.advance(step)
        contacts.append(read_contacts(fleet))
        total.append(energy.sum())

    # forces and belts at the begin of each step, velocities over the step
    force = np.array([contact.force for contact in contacts[:-1]])
    load = np.array([contact.load for contact in contacts[:-1]])
    belts = np.array([contact.belt for contact in contacts[:-1]])
    sliding = _over_steps(np.array([contact.velocity for contact in contacts]))
    rising = _over_steps(np.array([contact.rising for contact in contacts]))
    sliding[..., 0] += belts

    power_spent = (force * sliding).sum(axis=(1, 2, 3)) + (load * rising).sum(axis=(1, 2))
    spent = -power_spent.cumsum() * step
    stored = np.array(total[1:]) - total[0]
    power_of_belts = (force[..., 0] * belts).sum(axis=(1, 2))
    work = -power_of_belts.cumsum() * step
    allowed = 0.01 * np.abs(stored).max()
    source = "conservation of energy"
    checks.add("work of the belts", [spent + stored, work], allowed, "J", source)


def _over_steps(values: Array) -> Array:
    """Means of the values (n + 1, ...) at both ends of each of n steps."""
    return np.asarray((values[:-1] + values[1:]) / 2)
