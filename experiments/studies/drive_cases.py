"""The cases that the estimator of laws from drives is tried in, with bounds on its errors and intervals."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians

from sim.wander.motion import LASTING, WHITE, SlipVariation
from sim.wander.pose_source import PoseSource

D, EPSILON = "offset", "radius_error"
"""The parameters of the law: D [m] and epsilon [-]."""
LAW = "icr_radius"
"""The law that moves the robot and is fitted."""
TRUE_LAW: Mapping[str, float] = {D: 0.045, EPSILON: 0.0066}
"""Its parameters, like those of the shipped robot on stone."""
DURATION = 120.0
"""Of each drive [s]."""
ENCODER_RATE = 50.0  # [Hz]
_HONEST = (0.93, 0.995)


@dataclass(frozen=True)
class Case:
    """Repeated drives of one kind, and bounds on what is estimated from each."""

    name: str
    source: PoseSource
    slip: SlipVariation | None = WHITE
    """None where MuJoCo moves the robot."""
    rms: Mapping[str, float] = field(default_factory=dict)
    """Largest root mean square errors, by parameter, in its unit."""
    coverage: tuple[float, float] = _HONEST
    """Smallest and largest share of the repeats whose 95 % interval covers the truth [-]."""
    covered: tuple[str, ...] = (D, EPSILON)
    """Parameters whose intervals are checked."""
    over_bound: float | None = None
    """Largest root mean square error over the Cramér-Rao bound, if that is checked [-]."""
    over_model: float | None = None
    """Largest half width of an interval over that of the model of the noise, if that is checked [-]."""
    standard_errors: float | None = None
    """Largest error of any repeat, in its standard errors, if that is checked."""


COARSE = PoseSource(rate=10.0, position_noise=0.02, heading_noise=radians(1.0))
FINE = PoseSource(rate=20.0, position_noise=0.002, heading_noise=radians(0.25))
_GNSS = PoseSource(rate=5.0, position_noise=0.05, heading=False)
_ODOMETRY = PoseSource(rate=20.0, drift=0.01, heading_drift=0.004)
_EVERYTHING = PoseSource(
    rate=10.0,
    position_noise=0.02,
    heading_noise=radians(1.0),
    outliers=0.05,
    gaps=3,
    gap_duration=5.0,
    jumps=1,
    jump_size=0.5,
    delay=0.15,
    ahead=0.3,
    left=0.1,
    mounting=radians(5.0),
)
EXTRAS: Mapping[str, float] = {
    "sensor_x": _EVERYTHING.ahead,
    "sensor_y": _EVERYTHING.left,
    "sensor_yaw": _EVERYTHING.mounting,
    "clock_offset": -_EVERYTHING.delay,
}
"""True values of what is estimated besides the law in the case with everything [m, m, rad, s]."""

SIMULATED = Case(
    "20 mm, 1 deg, 10 Hz; MuJoCo's own motion", COARSE, None, {D: 0.0005, EPSILON: 0.001}, coverage=(0.9, 1.0)
)
"""Errors from the law of steady circles, coverage of the same drive's fit without noise."""
NOISE_FREE = Case("MuJoCo's own motion, exact poses", PoseSource(rate=20.0), None)
"""Instead of the truth, which a drive in MuJoCo doesn't have."""
_CASES = (
    Case("20 mm, 1 deg, 10 Hz; white slip", COARSE, over_bound=1.15, over_model=1.5),
    Case("2 mm, 0.25 deg, 20 Hz; white slip", FINE, rms={D: 0.0002, EPSILON: 0.0006}),
    Case("2 mm, 0.25 deg, 20 Hz; slip that lasts", FINE, LASTING, {D: 0.0022, EPSILON: 0.0055}),
    Case("20 mm, 1 deg, 10 Hz; slip that lasts", COARSE, LASTING, {D: 0.0022, EPSILON: 0.0055}),
    Case(
        "50 mm, no heading, 5 Hz; white slip",
        _GNSS,
        rms={D: 0.0006, EPSILON: 0.003},
        coverage=(0.93, 1.0),
        standard_errors=5.0,
    ),
    Case("odometry that drifts 1 %; white slip", _ODOMETRY, rms={D: 0.002, EPSILON: 0.01}),
    SIMULATED,
    Case(
        "20 mm with outliers, gaps, a jump, clock, mounting",
        _EVERYTHING,
        rms={D: 0.0006, EPSILON: 0.002},
        coverage=(0.9, 0.995),
        covered=(D, EPSILON, *EXTRAS),
    ),
)
CASES: Mapping[str, Case] = {case.name: case for case in _CASES}
"""All cases by name, in the order of the table."""
