"""What a closed loop with scanner costs beside the bare engine, period by period."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from experiments.driving.lookup import locator
from experiments.driving.paper_model import KNOWN_LAWS
from experiments.measuring.check import Check, at_least
from experiments.options.world import IDENTIFIED
from experiments.speed.same_motion import SameMotion
from sim.fleet import Fleet
from sim.robot.robot import Robot, load_robot
from sim.runs import closed_loop
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from sim.steering import Pilot
from trackslip.controllers.feedforward import Feedforward
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.slip.compensation import FixedLaw
from trackslip.slip.law_file import load_laws
from trackslip.trajectory.segmented import PAPER_START, Segment, SegmentedReference

TEN, ONE = "closed loop of ten robots", "closed loop of one robot"
MOST = 2.0
"""Largest time of ten robots' scan period, over that of its physics [-]."""
LEAST_SHARE = 6_000 / 44_000
"""Smallest speed of one robot in closed loop, over that of the bare engine [-]."""
_PATH = SegmentedReference(  # the paper's path, in brief
    PAPER_START, [Segment(3.0, 0.0, 0.15), Segment(2.0, 0.15, 0.15), Segment(5.0, 0.15, 0.15, 0.8)]
)


def measure(seed: int, repeats: int, step: Callable[[str], None]) -> tuple[Check, ...]:
    """Ten robots' time over that of their physics, and one robot's speed; `step` is called after each round.

    Times are wall time on one thread. Those of ten robots are sums over a run, as scans of the robots that need no pose
    are localized in blocks; medians over the rounds. Those of one robot are medians over all periods and rounds.
    """
    robot = load_robot()
    ten, one = Times(), Times()
    for k in range(1 + repeats):
        for times, pilots in ((ten, paper_pilots()), (one, _tracking_pilot())):
            drive(robot, pilots, seed, times if k > 0 else Times())  # the first round warms up
        step("closed loop")
    share = 1 / one.ratio
    steps = LaserScanner().period / float(robot.model.opt.timestep)
    loop, bare = (steps / float(np.median(parts)) for parts in (one.whole, one.bare))
    return (
        Check(TEN, "time over that of the physics", float(np.median(ten.runs)), MOST, "x"),
        Check(ONE, "speed over that of the bare engine", share, at_least(LEAST_SHARE), "x"),
        Check(ONE, "physics steps", loop, at_least(LEAST_SHARE * bare), "steps/s"),
    )


@dataclass
class Times:
    """Times of scan periods [s]."""

    whole: list[float] = field(default_factory=list)
    """Of the closed loop."""
    bare: list[float] = field(default_factory=list)
    """Of the bare engine, with the same robots in the same motion."""
    runs: list[float] = field(default_factory=list)
    """Of whole runs, over that of the bare engine [-]."""

    @property
    def ratio(self) -> float:
        """Median time of a period, over that of its physics [-]."""
        return float(np.median(np.divide(self.whole, self.bare)))


def paper_pilots() -> list[Pilot]:
    """The pilots of `reproduce`: both of the paper's controllers with every compensation, a robot each."""
    stored = load_laws()
    laws = [*KNOWN_LAWS.values(), *(stored[name] for name in IDENTIFIED)]
    pairs = [(controller, law) for controller in (Feedforward(), LinearTimeVarying()) for law in laws]
    return [Pilot(controller, [k], FixedLaw(law)) for k, (controller, law) in enumerate(pairs)]


def _tracking_pilot() -> list[Pilot]:
    return [Pilot(LinearTimeVarying(), [0], FixedLaw(load_laws()["icr_radius"]))]


def drive(robot: Robot, pilots: Sequence[Pilot], seed: int, times: Times) -> None:
    """Drive in closed loop on one thread; after each scan period the bare engine repeats its motion."""
    size = len(pilots)
    fleet = Fleet(robot, np.tile(_PATH.pose(0.0), (size, 1)), threads=1)
    feed = ScannerFeed(LaserScanner(), fleet, [generator(seed, f"bench {k}") for k in range(size)])
    shadow = _Shadow(SameMotion(fleet, feed.period), times)
    closed_loop(fleet, pilots, _PATH, feed, locator("plate", robot), progress=shadow.repeat)
    shadow.end()


class _Shadow:
    """Notes the times of a closed loop's periods, and of the bare engine in the same motion."""

    def __init__(self, motion: SameMotion, times: Times) -> None:
        self._motion, self._times, self._first = motion, times, len(times.whole)
        self._returned: float | None = None

    def repeat(self, _: float) -> None:
        """Note the time since the last call, and let the bare engine do what the fleet did then."""
        whole = None if self._returned is None else perf_counter() - self._returned
        bare = self._motion.repeat()
        if whole is not None:
            self._times.whole.append(whole)
            self._times.bare.append(bare)
        self._motion.begin()
        self._returned = perf_counter()

    def end(self) -> None:
        """Note the time of the run, which is over: what it did after its last period counts, too."""
        assert self._returned is not None
        last = perf_counter() - self._returned
        whole, bare = (sum(part[self._first :]) for part in (self._times.whole, self._times.bare))
        self._times.runs.append((whole + last) / bare)
