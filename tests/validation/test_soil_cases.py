"""200 random tracked robots on random soft soils, with random slopes, pulls and commands: nothing
explodes, runs say in words what limits them, and steady motions sink and resist as in theory.
"""

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
from soft_soil import tracks_of
from trials import report

from experiments.common.check import Check
from sim import Fleet, Ground, Pull, RobotParameters, load_robot
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import tireless
from sim.runs.run_recorder import Sinking
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Soil, drawbar_curve

pytestmark = pytest.mark.slow
GRAVITY = 9.81
NAMED = [ground.soil for ground in NAMED_GROUNDS.values() if ground.soil]
ROBOTS = 40
SOILS_PER_ROBOT = 5
SLIPS = np.linspace(0.05, 1.0, 20)
PASSES = 6.0  # lengths of contact that the belts run
SAMPLES = 40  # of a run
STANDS = math.cos(0.5)  # cosine of the lean beyond which a run ends because the robot tips over


def log_uniform(generator, low, high):
    return float(np.exp(generator.uniform(math.log(low), math.log(high))))


def draw_robot(generator):
    """A tracked robot of 0.3 to 6 m, 5 kg to 48 t."""
    length = log_uniform(generator, 0.3, 6.0)
    mass = 190.0 * length**3 * log_uniform(generator, 0.4, 2.5)
    half_gauge = length * generator.uniform(0.25, 0.5)
    return RobotParameters(
        half_gauge=half_gauge,
        contact_length=length * generator.uniform(0.6, 0.9),
        sprocket_radius=length * generator.uniform(0.06, 0.12),
        mass=float(np.clip(mass, 5.0, 48e3)),
        com_x=length * generator.uniform(-0.05, 0.05),
        com_height=half_gauge * generator.uniform(0.3, 0.8),
        track_width=length * generator.uniform(0.06, 0.2),
        drive=None,
    )


def draw_soil(generator):
    """A soil around a named one, or far from any."""
    if generator.random() < 0.6:
        soil = NAMED[generator.integers(len(NAMED))]
        factors = {
            name: getattr(soil, name) * log_uniform(generator, 0.5, 2.0)
            for name in ("k_c", "k_phi", "cohesion", "shear", "unit_weight")
        }
        n = soil.n * generator.uniform(0.8, 1.2)
        angle = soil.friction_angle * generator.uniform(0.8, 1.2)
        growth = generator.uniform(0.0, 0.6)
        return replace(soil, n=n, n1=growth, friction_angle=angle, assumed=(), **factors)
    return Soil(
        k_c=log_uniform(generator, 10.0, 1e6),
        k_phi=log_uniform(generator, 1e4, 1e9),
        n=generator.uniform(0.3, 2.0),
        n1=generator.uniform(0.0, 1.0),
        cohesion=log_uniform(generator, 1.0, 3e4),
        friction_angle=math.radians(generator.uniform(5.0, 45.0)),
        shear=log_uniform(generator, 1e-3, 0.1),
        unit_weight=log_uniform(generator, 1e3, 2e4),
    )


@dataclass
class Case:
    """A robot on a soil, and what happens."""

    robot: RobotParameters
    ground: Ground
    pull: float
    belts: np.ndarray  # (2,) [m/s]
    finite: bool = False
    height: float = 0.0  # largest, over the length of the contact [-]
    excess: float = 0.0  # of the speed over what belts, slope and pull explain [-]
    outcome: str = ""
    sinkage: float = math.nan  # over theory's, minus 1, if the motion is steady [-]
    resistance: float = math.nan

    @property
    def words(self):
        soil = self.ground.soil
        return (
            f"{self.robot.mass:.3g} kg, {self.robot.contact_length:.2f} m, pull {self.pull:.3g} N, "
            f"slope {math.degrees(self.ground.slope):.0f}°, belts {self.belts.round(2).tolist()}, "
            f"{self.outcome}: {soil}"
        )


def draw_fleet(generator):
    """One robot on several soils and slopes, with one pull, and one motion for each soil."""
    robot = draw_robot(generator)
    tracks = tracks_of(robot)
    largest = []
    grounds = []
    while len(grounds) < SOILS_PER_ROBOT:
        soil = draw_soil(generator)
        if soil.sinkage(tracks.pressure, tracks.width) > 0.3 * robot.contact_length:
            continue  # a robot on its belly
        slope = generator.uniform(0.0, math.radians(25.0)) if generator.random() < 0.4 else 0.0
        free = replace(tracks, settlement=0.0)
        curve = drawbar_curve(soil, free, SLIPS, hitch_height=0.5 * robot.com_height)
        largest.append(float(np.nan_to_num(curve.pull).max()))
        grounds.append(Ground(soil=soil, slope=slope))
    share = generator.uniform(0.0, 1.2)
    force = share * max(generator.choice(largest), 0.0)
    pull = Pull(min(force, 1e5), 0.5 * robot.com_height, since=0.5)
    speed = math.sqrt(robot.contact_length) * generator.uniform(0.2, 0.5)
    motions = np.array([(1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (0.6, 1.0), (-1.0, 1.0)])
    chosen = motions[generator.choice(5, SOILS_PER_ROBOT, p=(0.5, 0.1, 0.15, 0.15, 0.1))]
    return robot, grounds, pull, speed * chosen


def parked(robot, grounds, pull):
    """A fleet, with the grounds level on which a robot would slide or tip over."""
    model = load_robot(robot)
    start = np.zeros((len(grounds), 3))
    try:
        return Fleet(model, start, grounds, 0.0, tireless(3.0), 1, pull=pull), grounds
    except InvalidValueError:
        level = [replace(ground, slope=0.0) for ground in grounds]
        return Fleet(model, start, level, 0.0, tireless(3.0), 1, pull=pull), level


def drive(robot, grounds, pull, belts):
    """Drive a fleet, and judge each of its robots."""
    fleet, grounds = parked(robot, grounds, pull)
    fleet.command(belts / robot.sprocket_radius)
    fastest = np.abs(belts).max(axis=1)
    duration = 1.0 + PASSES * robot.contact_length / fastest.max()
    step = max(round(duration / SAMPLES / fleet.period), 1) * fleet.period
    states = []
    for _ in range(SAMPLES):
        fleet.advance(step)
        values = (
            -fleet.attitude()[:, 0],
            fleet.state.upright.copy(),
            np.hypot(fleet.state.qvel[:, 0], fleet.state.qvel[:, 1]),
            -fleet.attitude()[:, 2],
        )
        soil = fleet.ruts.deepest, fleet.ruts.resistance, fleet.ruts.slip
        states.append((np.stack(values, axis=-1), *(part.copy() for part in soil)))
    motion, rut, resistance, slip = (np.array(part) for part in zip(*states, strict=True))

    cases = []
    for k, ground in enumerate(grounds):
        case = Case(robot, ground, pull.force, belts[k])
        height, upright, speed, pitch = motion[:, k].T
        case.finite = bool(np.isfinite(motion[:, k]).all() and np.isfinite(rut[:, k]).all())
        case.height = float(height.max() / robot.contact_length)
        # of a robot that slides without any friction
        time = step * np.arange(1, SAMPLES + 1)
        push = GRAVITY * math.sin(ground.slope) + pull.force / robot.mass
        case.excess = float((speed - fastest[k] - push * time).max() / fastest[k])
        sinking = Sinking.of(rut[:, k], resistance[:, k], slip[:, k], pitch)
        if not (upright > STANDS).all():
            case.outcome = "tips over"
        elif sinking.notes:
            case.outcome = sinking.notes[0].partition(":")[0].partition(" by up")[0]
        else:
            case.outcome = "drives"
        straight = belts[k, 0] == belts[k, 1] > 0
        # over the last fifth of the run
        slips = slip[-8:, k].mean(axis=1)
        depths = rut[-8:, k].mean(axis=1)
        is_even = np.ptp(slips) < 1e-3 and np.ptp(depths) < 0.005 * depths[-1]
        is_shallow = depths[-1] < 0.1 * robot.contact_length
        is_steady = case.outcome == "drives" and straight and is_even and is_shallow
        if is_steady and 0 < slips[-1] < 0.5:
            hitch = pull.height
            own_slip = [float(slip[-1, k].mean())]
            theory = drawbar_curve(ground.soil, tracks_of(robot), own_slip, ground.slope, hitch)
            case.sinkage = rut[-1, k].mean() / theory.sinkage[0] - 1
            case.resistance = -resistance[-1, k].sum() / theory.resistance[0] - 1
        cases.append(case)
    return cases


def worst(cases, name, size=abs):
    """The value of a field of cases that is largest in size; the words of its case are printed."""
    case = max(cases, key=lambda case: size(getattr(case, name)))
    value = getattr(case, name)
    print(f"{name} {value:.4f}: {case.words}")
    return value


def test_random_robots_soils_and_pulls():
    generator = np.random.default_rng(70)
    cases = []
    for _ in range(ROBOTS):
        cases += drive(*draw_fleet(generator))
    print(dict(Counter(case.outcome for case in cases)))
    infinite = [case for case in cases if not case.finite]
    upright = [case for case in cases if case.outcome != "tips over"]
    steady = [case for case in cases if math.isfinite(case.sinkage)]
    excess = worst(cases, "excess", size=float)
    height = worst(upright, "height", size=float)
    checks = [
        Check("all", "runs that aren't finite", len(infinite), 0.0),
        Check("all", "speed beyond belts, slope and pull", excess, (-math.inf, 0.2)),
        Check("upright", "height over the length", height, (-math.inf, 0.1)),
        Check("steady", "number", len(steady), (40.0, math.inf)),
        Check("steady", "sinkage", worst(steady, "sinkage"), 0.05),
        Check("steady", "resistance", worst(steady, "resistance"), 0.1),
    ]
    report("Random robots in random soils", checks)
