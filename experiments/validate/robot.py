"""The suite of a robot on Coulomb ground: turning, standing, sliding, numerics."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.common.check import Check
from experiments.common.choices import SHIPPED
from experiments.common.formats import pair, percent, significant, span
from experiments.common.page import Plot, Section
from experiments.common.run import Run
from experiments.common.table import Table
from experiments.validate import robot_figures as figures
from experiments.validate.config import Config
from experiments.validate.numerics import Convergence, Energy, account, converge
from experiments.validate.standing import (
    ANGLES,
    REFERENCE_ANGLE,
    SLIDING_HEADINGS,
    Creep,
    Loads,
    Slide,
    creep,
    loads,
    slide,
    straight_drift,
)
from experiments.validate.suite import Findings
from experiments.validate.turning import VariedTurns, turn
from sim.ground.ground import Ground
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import load_robot
from sim.seeds import generator
from trackslip.kinematics import Array

TITLE = "The simulator compared with theory"
_INTRO = (
    "A tracked robot turns by running its tracks at different speeds, which makes them slide over the ground. How they "
    "slide follows from dry friction alone and can be computed without a simulator: quasi-static Coulomb friction "
    "under two uniformly loaded lines, in balance with the robot's weight and momentum. This page compares the "
    "simulator with that theory. The recipe is the contact model of this project; the default contact is MuJoCo's own, "
    "on the same robot with the same friction."
)
_LIMITS = (
    "That the theory holds on real ground. It assumes dry friction on a hard plane; soil shears and yields, and real "
    "tracks have shoes.",
    "Sharper and faster turns than these: a robot that turns faster can be further off.",
    "Time-averaged loads with the default contact. The robot shakes and loads are instantaneous.",
)
_THEORY = "quasi-static Coulomb theory (trackslip.skid_theory)"


@dataclass(frozen=True)
class RobotMeasurements:
    """All measurements; "naive" is MuJoCo's default contact."""

    parameters: RobotParameters
    ground: Ground
    turns: VariedTurns
    naive_turns: VariedTurns
    loads: Loads
    naive_loads: Loads
    creep: Creep
    slide: Slide
    drift: float
    """Sideways after 10 m straight on [m]."""
    convergence: Convergence
    energy: Energy

    @property
    def reference_creep(self) -> float:
        """Largest creep on the slope of REFERENCE_ANGLE [m/s]."""
        return float(self.creep.speed[:, _AT_REFERENCE].max())

    @property
    def sliding_error(self) -> float | None:
        """Largest error of the acceleration beyond the friction angle, relative to Coulomb's law; None for none [-]."""
        error = (self.slide.acceleration / self.slide.expected - 1)[~self.slide.tips]
        return _worst(error) if error.size else None

    @property
    def physics_step(self) -> float:
        """The physics step of the model [s]."""
        return float(load_robot(parameters=self.parameters).model.opt.timestep)


_AT_REFERENCE = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))


def robot_suite(config: Config, run: Run) -> Findings:
    """Measure a robot on its ground, without slopes, patches or changes, which theory does not know."""
    parameters, ground = load_parameters(config.robot or SHIPPED)
    found = measure(parameters, Ground(ground.along, ground.across), config, run)
    name = Path(config.robot or SHIPPED).stem
    return Findings(
        TITLE,
        [_INTRO],
        checks_of(name, found),
        [comparison(found), *_tipping(found.slide)],
        _sections(found),
        _LIMITS,
        summary_of(found),
        {"robot": parameters, "ground": found.ground, "model_sha256": load_robot(parameters=parameters).digest},
    )


def measure(parameters: RobotParameters, ground: Ground, config: Config, run: Run) -> RobotMeasurements:
    """Make all measurements, in stages that the run times and shows."""

    @contextmanager
    def stage(name: str) -> Iterator[Callable[[float], None]]:
        with run.watch.stage(name), run.progress(name, 1.0, "of the stage") as report:
            yield report

    world, seed = (parameters, ground), config.seed
    with stage("turning") as report:
        turns = turn(*world, config.threads, False, report)
    with stage("turning, default contact") as report:
        naive_turns = turn(*world, config.threads, True, report)
    with stage("standing"):
        weights, naive_weights = (loads(*world, config.threads, default) for default in (False, True))
        creeping, sliding = creep(*world, config.threads), slide(*world, config.threads)
        drift = straight_drift(*world, config.threads)
    with stage("convergence") as report:
        convergence = converge(*world, generator(seed, "convergence"), config.threads, report)
    with stage("energy"):
        energy = account(*world, generator(seed, "energy"), config.threads)
    return RobotMeasurements(
        *world, turns, naive_turns, weights, naive_weights, creeping, sliding, drift, convergence, energy
    )


def checks_of(name: str, found: RobotMeasurements) -> list[Check]:
    """The checks of any robot that stands evenly on its tracks."""
    turns, contact, slip = found.turns, found.loads, found.turns.slip_error
    worse = _worst(slip) / _worst(found.naive_turns.slip_error)
    lean, turning = np.abs([contact.roll, contact.pitch]).max(), 0.01 if found.parameters.axles else 0.005
    sliding = found.sliding_error
    rows: list[tuple[str, float, float, str, float, str]] = [
        ("b + D in turns, largest relative error", _worst(turns.icr_error), turning, "1", 0.0, _THEORY),
        ("b + D in turns, median relative error", _median(turns.icr_error), 0.0015, "1", 0.0, _THEORY),
        ("slip in turns, error over that of the default contact", worse, 0.1, "1", 0.0, _THEORY),
        ("load of a contact point, relative error", _worst(contact.load - contact.expected), 0.05, "1", 0.0,
         "weight and momentum of a rigid robot on springs"),
        ("sink on level ground", float(contact.sink.mean()), 0.05 * SINK, "m", SINK, "stiffness of the contacts"),
        ("roll and pitch in turns", float(lean), float(np.radians(0.05)), "rad", 0.0, "stiffness of the contacts"),
        (f"creep, parked on {_creep_angle(found)}", found.reference_creep, 0.05e-3, "m/s", 0.0, "Coulomb's law"),
        *([] if sliding is None else [
            ("acceleration beyond the friction angle, relative error", sliding, 0.05, "1", 0.0, "Coulomb's law")]),
        ("sideways drift in 10 m straight on", found.drift, 0.1e-3, "m", 0.0, "symmetry"),
        ("solvers CG and Newton, apart", found.convergence.solver_difference, 0.2e-3, "m", 0.0, "the same equations"),
        ("energy not accounted for, of the largest stored", found.energy.residual, 0.01, "1", 0.0,
         "conservation of energy"),
        ("friction loss, relative error", found.energy.coulomb_error, 0.02, "1", 0.0, "Coulomb's law"),
    ]  # fmt: skip
    return [Check(name, *row) for row in rows]


def comparison(found: RobotMeasurements) -> Table:
    """The recipe compared with MuJoCo's default contact."""
    both, b = (found.turns, found.naive_turns), found.parameters.half_gauge
    loads_of = (found.loads.load - found.loads.expected, found.naive_loads.load - 1)
    sinks = (found.loads.sink, found.naive_loads.sink)
    rows = [
        ("b + D, worst | median error", *(_worst_and_median(100 * one.icr_error, "%") for one in both)),
        ("D alone, worst | median error",
         *(_worst_and_median(100 * ((t.half_width - b) / (t.expected_half_width - b) - 1), "%") for t in both)),
        ("slip, worst | median error", *(_worst_and_median(one.slip_error) for one in both)),
        ("lateral speed, worst | median error",
         *(_worst_and_median(1e3 * (t.lateral - t.expected_lateral), "mm/s") for t in both)),
        ("load of a contact point, largest deviation", *(percent(_worst(one)) for one in loads_of)),
        ("sink on level ground", *(significant(1e3 * float(one.mean()), "mm", 3) for one in sinks)),
    ]  # fmt: skip
    turns = found.turns
    note = (
        f"{len(turns.radius):,} steady turns: radii from {span(turns.radius, 'm')}, speeds from "
        f"{span(turns.speed, 'm/s')}, friction across / along from {span(turns.ratio)}, "
        f"{len(np.unique(turns.length))} contact lengths. The error of D alone excludes b, which needs no simulation."
    )
    return Table("The recipe and MuJoCo's default contact", ("quantity", "recipe", "default contact"), rows, note=note)


def _tipping(slide: Slide) -> list[Table]:
    """How a robot stands that tips over before it slides; no table for one that slides."""
    rows = [
        (figures.downhill(heading), "the robot tips over before it slides")
        for heading, tips in zip(SLIDING_HEADINGS, slide.tips, strict=True)
        if tips.all()
    ]
    return [Table("Acceleration not measured", ("slopes", ""), rows, align="l")] if rows else []


def summary_of(found: RobotMeasurements) -> dict[str, Any]:
    """The numbers of summary.json; "naive" is MuJoCo's default contact."""
    turns, naive, weights = found.turns, found.naive_turns, found.loads
    errors = {
        "icr_error": turns.icr_error,
        "naive_icr_error": naive.icr_error,
        "slip_error": turns.slip_error,
        "naive_slip_error": naive.slip_error,
    }
    return {
        **{name: {"worst": _worst(error), "median": _median(error)} for name, error in errors.items()},
        "lateral_speed_error_mm_per_s": 1e3 * _worst(turns.lateral - turns.expected_lateral),
        "turns": len(turns.radius),
        "pad_load_spread": _worst(weights.load - weights.expected),
        "naive_pad_load_spread": _worst(found.naive_loads.load - 1),
        "sink_mm": 1e3 * float(weights.sink.mean()),
        "roll_deg": float(np.degrees(_worst(weights.roll))),
        "pitch_deg": float(np.degrees(_worst(weights.pitch))),
        "creep_angle_deg": float(np.degrees(found.creep.angle[:, _AT_REFERENCE].min())),
        "creep_mm_per_s": 1e3 * found.reference_creep,
        "sliding_acceleration_error": found.sliding_error,
        "straight_drift_mm": 1e3 * found.drift,
        "solver_difference_mm": 1e3 * found.convergence.solver_difference,
        "timestep": [
            {"dt": dt, "position_error_mm": 1e3 * error} for dt, error in found.convergence.step_error.items()
        ],
        "energy_residual": found.energy.residual,
        "friction_loss_error": found.energy.coulomb_error,
    }


def _sections(found: RobotMeasurements) -> list[Section]:
    turns, naive, p = found.turns, found.naive_turns, found.parameters
    of_step = found.convergence.step_error.get(found.physics_step, np.nan)
    step = f"{1e3 * found.physics_step:g} ms, the error is {significant(1e3 * of_step, 'mm')}"
    turning = (
        Plot(
            "turns",
            figures.icr_and_slip(turns, naive, p),
            "Errors in the turns",
            Markup(
                "<em>Error of the ICRs' half width</em>: share of the turns whose error is below the value. <em>Slip "
                "of both tracks</em>: of the robot itself, at all radii, speeds and friction ratios."
            ),
        ),
        Plot(
            "left",
            figures.what_is_left(turns, p),
            "Remaining errors and their causes",
            Markup(
                "<em>Against yaw rate</em>: errors rise because sliding still lifts a point slightly; at the slowest "
                "turns they are those of approximating a continuous track by points. <em>Lateral speed</em>: its error "
                "is the centripetal acceleration times the time that a contact takes to grip."
            ),
        ),
        Plot(
            "slip",
            figures.slip_against_radius(turns, naive, p, found.ground),
            "Slip against radius",
            "One symbol per speed; slip of the outer track is positive, of the inner track negative. With dry "
            "friction, the slip of a real track does not depend on speed.",
        ),
    )
    standing = (
        Plot(
            "loads",
            figures.pad_loads(found.loads, found.naive_loads),
            "Loads along the tracks",
            "Symbols are medians over the paper's turns, thick bars span the middle half and thin lines the whole "
            "range, at one instant.",
        ),
        Plot(
            "slopes",
            figures.slopes(found.creep, found.slide, found.ground),
            "On slopes",
            Markup(
                "<em>Parked</em>: a robot should stand still up to the friction angle, drawn as a vertical line in the "
                "same style as its curve. <em>Sliding</em>: beyond it, symbols should lie on the lines of Coulomb's "
                "law."
            ),
        ),
    )
    numerics = (
        Plot(
            "steps",
            figures.steps_and_solvers(found.convergence, found.physics_step),
            "Physics step and solver",
            f"Final positions of robots that drive at random, {significant(found.convergence.travelled, 'm')} on "
            f"average, compared with those of a shorter step. At the model's own step of {step}.",
        ),
        Plot(
            "energy",
            figures.energies(found.energy),
            "Energy",
            Markup(
                "<em>Since the start</em>: nearly all the work of the belts is lost where they slide. "
                "<em>Enlarged</em>: the remainder after all losses should equal the kinetic and potential energy."
            ),
        ),
    )
    return [Section("Turning", turning), Section("Standing and sliding", standing), Section("Numerics", numerics)]


def _creep_angle(found: RobotMeasurements) -> str:
    """The slope whose creep the summary reports: the reference, or less where that does not hold a robot."""
    return span(np.degrees(found.creep.angle[:, _AT_REFERENCE]), "°")


def _worst(error: Array) -> float:
    return float(np.abs(error).max())


def _median(error: Array) -> float:
    return float(np.median(np.abs(error)))


def _worst_and_median(error: Array, unit: str = "") -> str:
    size = np.abs(error)
    return pair([significant(float(np.nanmax(size))), significant(float(np.nanmedian(size)))], unit)
