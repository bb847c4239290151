"""Checks of a robot on its ground: measurements compared with theory, and checks that do not
apply.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

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

# slope that robots climb and park on, if friction holds them on twice that slope
_GENTLE = math.radians(10.0)
_MARGIN = math.radians(9.0)  # robots closer than this to tipping over rock when they begin to slide
_BALANCE, _SPRINGS, _COULOMB = (
    "quasi-static balance (trackslip.skid_theory)",
    "rigid robot on springs",
    "Coulomb's law",
)


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
        theory, measured, allowed = (
            values.ravel() for values in np.broadcast_arrays(*np.asarray(pair), tolerance)
        )
        k = int(np.argmax(np.abs(measured - theory) / allowed))
        self.done.append(
            Check(
                self.robot,
                what,
                float(measured[k]),
                float(allowed[k]),
                unit,
                float(theory[k]),
                source,
            )
        )

    @property
    def failed(self) -> list[str]:
        """Quantities that are outside their bounds."""
        return [check.what for check in self.done if not check.holds]

    @property
    def verdict(self) -> str:
        """Numbers of checks that passed, failed, and do not apply."""
        counts = {"checks passed": len(self.done) - len(self.failed), "failed": len(self.failed)}
        counts["not applicable"] = len(self.not_applicable)
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
        """
        (x, y), p = self.setup.robot().contact_points.T, self.setup.parameters
        tips = math.atan2(y.max() - p.com_y if heading else p.com_x - x.min(), p.com_height)
        if tips < slope + _MARGIN:
            needed, spare, most = (
                f"{math.degrees(angle):.0f}°" for angle in (slope, _MARGIN, tips)
            )
            reason = (
                f"too steep for this robot: {needed} and {spare} to spare > {most}, where "
                "it tips over"
            )
            self.not_applicable.append(f"{what}: {reason}")
        return tips < slope + _MARGIN


def check_turns(checks: Checks) -> Turns:
    """Check turns with the paper's radii, turns on the spot, and slip uphill; returns the paper's
    turns.
    """
    setup = checks.setup
    bound = 0.01 if setup.parameters.axles else 0.005
    scale = speed_scale(setup.parameters)
    turns = drive_steadily(setup, paper_turns(setup.parameters)[2])
    checks.add("b + D in turns", turns.half_width, bound * turns.half_width[0], "m", _BALANCE)
    checks.add("slip in turns", turns.slip, 0.002, "1", _BALANCE)
    spinning = scale * np.outer([0.06, 0.12, 0.24], [-1.0, 1.0])
    spins = drive_steadily(setup, spinning / setup.sprocket_radius)
    checks.add("b + D on the spot", spins.half_width, 0.013 * spins.half_width[0], "m", _BALANCE)
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
    """Check loads and lean in the paper's turns, and creep of robots parked uphill, obliquely and
    across a slope.
    """
    setup, slope = checks.setup, checks.gentle_slope
    loads, attitude = measure_loads(setup, paper_turns(setup.parameters)[2])
    sink = attitude[..., 0].mean(axis=1)
    checks.add("load of a contact point, over the mean", loads, 0.05, "1", _SPRINGS)
    checks.add("sink on level ground", sink, 0.05 * sink[0], "m", _SPRINGS)
    checks.add("roll and pitch in turns", attitude[..., 1:], math.radians(0.05), "rad", _SPRINGS)
    creep = f"creep, parked on {math.degrees(slope):.0f}°"
    if not checks.tips_over(creep, 0.0, slope):
        start = [(0.0, 0.0, heading) for heading in (0.0, np.pi / 4, np.pi / 2)]
        fleet = setup.fleet(start, replace(setup.ground, slope=slope))
        fleet.advance(2.0)
        before = fleet.pose()
        fleet.advance(5.0)
        speed = np.hypot(*(fleet.pose() - before)[:, :2].T) / 5.0
        checks.add(
            creep, [0 * speed, speed], 0.06e-3 if setup.ground.shear else 0.05e-3, "m/s", _COULOMB
        )


def check_sliding(checks: Checks) -> dict[str, Array]:
    """Check accelerations on slopes that don't hold the robot.

    Returns by direction (3, S): slopes [rad], and accelerations of the centre of mass in theory and
    simulated [m/s^2].
    """
    setup, ground, measured = checks.setup, checks.setup.ground, {}
    for way, heading, friction in (
        ("downhill", 0.0, ground.along),
        ("sideways", np.pi / 2, ground.across),
    ):
        limit, what = math.atan(friction), f"acceleration sliding {way}"
        if checks.tips_over(what, heading, limit):
            continue
        slopes = limit + np.radians([2.0, 3.0, 4.0])
        fleet = setup.fleet(np.tile([0.0, 0.0, heading], (len(slopes), 1)))
        # of the centre of mass, live
        velocity = fleet.batch.bind("cvel")[:, fleet.robot.model.body("chassis").id, 3:5]
        # tilt slowly until the loads are as in sliding
        for share in np.linspace(0.0, 0.97, 100).tolist():
            fleet.set_ground(replace(ground, slope=share * limit))
            fleet.advance(0.02)
        fleet.advance(1.0)
        fleet.set_ground([replace(ground, slope=float(slope)) for slope in slopes])
        fleet.advance(0.25)
        before = np.hypot(*velocity.T)
        fleet.advance(0.25)
        simulated = (np.hypot(*velocity.T) - before) / 0.25
        expected = GRAVITY * (np.sin(slopes) - np.cos(slopes) * friction)
        checks.add(what, [expected, simulated], 0.05 * expected, "m/s^2", _COULOMB)
        measured[way] = np.stack([slopes, expected, simulated])
    return measured


def check_energy(checks: Checks, generator: np.random.Generator) -> None:
    """Check that the belts' work in random driving equals losses plus stored energy, each from an
    independent source.

    Forces and sliding speeds come from contact sensors, energies from MuJoCo. Over a step, a force
    acts at the mean of the velocities before and after the step.
    """
    robot, robots = checks.setup.robot(contact_sensors=True), 4
    robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    step = robot.model.opt.timestep
    drive = replace(checks.setup.drive, period=step)
    fleet = checks.setup.fleet(np.zeros((robots, 3)), robot=robot, drive=drive)
    energy, contacts, total = fleet.batch.bind("energy"), [], []
    for k in range(round(10.0 / step) + 1):
        if k % round(1.0 / step) == 0:
            fleet.command(generator.uniform(-fleet.drive.limit, fleet.drive.limit, (robots, 2)))
        fleet.advance(step)
        contacts.append(read_contacts(fleet))
        total.append(energy.sum())
    force, load, belts = (
        np.array([getattr(c, name) for c in contacts[:-1]]) for name in ("force", "load", "belt")
    )
    around = (np.array([getattr(c, name) for c in contacts]) for name in ("velocity", "rising"))
    sliding, rising = ((values[:-1] + values[1:]) / 2 for values in around)
    sliding[..., 0] += belts
    spent = (
        -((force * sliding).sum(axis=(1, 2, 3)) + (load * rising).sum(axis=(1, 2))).cumsum() * step
    )
    stored = np.array(total[1:]) - total[0]
    work = -(force[..., 0] * belts).sum(axis=(1, 2)).cumsum() * step
    checks.add(
        "work of the belts",
        [spent + stored, work],
        0.01 * np.abs(stored).max(),
        "J",
        "conservation of energy",
    )
