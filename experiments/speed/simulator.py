"""Physics steps per second of the simulator: bare engine, fleet, scanner and closed loop.

The machine may be shared and its clock rate may change, so only what was measured side by side is compared. Bare
physics, fleet and scanner take short turns, several per round, at every number of threads; a round ends with the closed
loop, and every other round runs backwards. The first round is a warm-up and does not count. A rate is the median over
all turns; a ratio is the median of the ratios to the bare rate of the same turn, or for the closed loop to those of the
same round. This cancels whatever slows the machine for longer than a turn, and outvotes a single disturbance. The
fastest turns would flatter: a ratio of two such rates compares one case's luckiest moment with another's. The quotient
of two printed rates may therefore differ slightly from the printed ratio.
"""

import functools
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from mujoco import batch

from experiments.driving.grid_runs import before_scanner
from experiments.driving.lookup import locator
from experiments.options.bench import BenchConfig
from sim.fleet import Fleet
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.runs import closed_loop
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from sim.steering import Pilot
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.kinematics import Array
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.law_file import load_laws
from trackslip.trajectory.segmented import circle

BARE, FLEET, SCANNER, CLOSED_LOOP = CASES = ("bare", "fleet", "scanner", "closed loop")
Rates = Mapping[tuple[str, int, int], Array]
"""Physics steps per second (R, T) in R rounds of T turns, by case, number of robots and number of threads."""

_RADIUS, _SPEED = 1.25, 0.15  # of the circle that all cases drive [m], [m/s]
_TURNS = 4  # per round; the closed loop has one
_STEADY = 2.0  # time after which the sprockets turn at their set points to the last bit [s]
_CLOSED_LOOP_SHARE = 0.1  # of the simulated time: localization takes so much longer
_MIN_SCANS = 2
_MIN_SCANS_CLOSED_LOOP = 6


def bare_batch(fleet: Fleet) -> batch.Batch:
    """Robots in the fleet's present state, their belts at its present speeds, stepped by MuJoCo alone."""
    return bare_copy(fleet.batch, fleet.batch.nthread)


def bare_copy(source: batch.Batch, threads: int) -> batch.Batch:
    """The same simulations in the same state, on some threads."""
    bare = batch.Batch(source.model, source.nsim, nthread=threads)
    for name in ("geom_surfacevel", "pair_friction"):
        bare.expand(name)[:] = source.expand(name)
    bare.state[:] = source.state
    return bare


@dataclass(frozen=True)
class CaseSpeed:
    """Speed of a case."""

    case: str
    n: int
    """Number of robots."""
    threads: int
    steps_per_s: float
    """Physics steps per second, all robots together [1/s]."""
    ratio_to_bare: float
    """Speed over that of the bare engine [-]."""
    real_time_factor: float
    """Simulated robot-seconds per second [-]."""


@dataclass(frozen=True)
class ThreadSpeedup:
    """Speed-up of a case over one thread."""

    case: str
    n: int
    """Number of robots."""
    threads: int
    speedup: float
    """[-]"""


class Rig:
    """N robots that drive on a circle in front of the scanner, and the ways to let a number of scan periods pass.

    They start where the circle is nearest to the scanner and drive on from case to case. At that point the plate takes
    up most beams, so the larger fleets, which don't get far, see the most expensive part of the circle.
    """

    def __init__(self, robot: Robot, size: int, threads: int, seed: int) -> None:
        """`size` robots on `threads` worker threads, driving steadily."""
        self.size = size
        self.fleet = Fleet(robot, np.tile(before_scanner(robot), (size, 1)), threads=threads)
        self._law = load_laws()["icr_radius"]
        self._omega = self._law.sprocket_speeds([_SPEED, _SPEED / _RADIUS], robot.geometry)
        self.fleet.command(self._omega)
        self.fleet.advance(_STEADY)
        self.feed = ScannerFeed(LaserScanner(), self.fleet, [generator(seed, f"bench {k}") for k in range(size)])
        self._locator = locator("plate", robot)
        self._pilot = Pilot(LinearTimeVarying(), range(size), FixedLaw(self._law))
        self._descriptions = [Description(str(k)) for k in range(size)]
        self.bare = bare_batch(self.fleet)
        self.steps_per_period = round(self.feed.period / robot.model.opt.timestep)
        self.cases: dict[str, Callable[[int], float]] = {
            BARE: functools.partial(timed, self._step),
            FLEET: functools.partial(timed, self._advance),
            SCANNER: functools.partial(timed, self._scan),
            CLOSED_LOOP: self._follow,
        }
        """Each lets a number of scan periods pass and returns the time that they took [s]."""

    def rate(self, case: str, periods: int) -> float:
        """Physics steps per second, all robots together, over a number of scan periods of a case."""
        return self.size * periods * self.steps_per_period / self.cases[case](periods)

    def periods(self, case: str, seconds: float) -> int:
        """Scan periods in which the robots together simulate `seconds` [s] or a little more."""
        share, fewest = (_CLOSED_LOOP_SHARE, _MIN_SCANS_CLOSED_LOOP) if case == CLOSED_LOOP else (1.0, _MIN_SCANS)
        return max(fewest, math.ceil(share * seconds / (self.size * self.feed.period) - 1e-9))

    def _step(self, periods: int) -> None:
        self.bare.step(nstep=periods * self.steps_per_period)

    def _advance(self, periods: int) -> None:
        self.fleet.command(self._omega)
        self.fleet.advance(periods * self.feed.period)

    def _scan(self, periods: int) -> None:
        self.fleet.command(self._omega)
        for _ in range(periods):
            self.fleet.advance(self.feed.period)
            self.feed.measure(self.feed.true_ranges()[:, None, :])

    def _follow(self, periods: int) -> float:
        # the robots differ only in the scanner's noise: the circle of the first suits all
        reference = circle(_RADIUS, _SPEED, (periods + 1) * self.feed.period, self.fleet.pose()[0])
        passed: list[float] = []
        loop = self.fleet, [self._pilot], reference, self.feed, self._locator, self._descriptions
        closed_loop(*loop, lambda _: passed.append(perf_counter()))
        # from period to period: the scan before the first would be one too many
        return passed[-1] - passed[0]


def timed(act: Callable[..., object], *arguments: object) -> float:
    """Time that a call of `act` takes [s]."""
    began = perf_counter()
    act(*arguments)
    return perf_counter() - began


def measure_simulator(config: BenchConfig, robot: Robot, step: Callable[[str], None]) -> Rates:
    """Every case with every number of robots and threads, in rounds; `step` is called with a label after each round."""
    rates: dict[tuple[str, int, int], list[float]] = {}
    for size in config.sizes:
        rigs = {threads: Rig(robot, size, threads, config.seed) for threads in config.thread_counts}
        order = list(itertools.product(config.thread_counts, (BARE, FLEET, SCANNER))) * _TURNS
        order += [(threads, CLOSED_LOOP) for threads in config.thread_counts]
        for k in range(1 + config.repeats):  # the first warms up
            for threads, case in order if k % 2 else reversed(order):
                rig = rigs[threads]
                rate = rig.rate(case, rig.periods(case, config.seconds))
                if k > 0:
                    rates.setdefault((case, size, threads), []).append(rate)
            step(f"{size} robots" if size > 1 else "1 robot")
    ordered = sorted(rates, key=lambda key: (key[1], key[2], CASES.index(key[0])))
    return {key: np.reshape(rates[key], (config.repeats, -1)) for key in ordered}


def case_speeds(rates: Rates, timestep: float) -> list[CaseSpeed]:
    """One for each case; a physics step is `timestep` [s] long."""
    speeds = []
    for (case, n, threads), rate in rates.items():
        per_s, ratio = float(np.median(rate)), float(np.median(rate / rates[BARE, n, threads]))
        speeds.append(CaseSpeed(case, n, threads, per_s, ratio, per_s * timestep))
    return speeds


def thread_speedups(rates: Rates) -> list[ThreadSpeedup]:
    """One for each case on several threads; none where one thread was not measured."""
    return [
        ThreadSpeedup(case, n, threads, float(np.median(rates[case, n, threads] / one)))
        for case, n, threads in rates
        if threads > 1 and (one := rates.get((case, n, 1))) is not None
    ]
