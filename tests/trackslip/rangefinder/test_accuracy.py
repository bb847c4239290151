"""Laws and the plate's place from scans of many teleoperated drives: the numbers on the page of identification."""

import numpy as np
import pytest
from beside import EPSILON, GEOMETRY, LENGTH, THICKNESS, D, drive, room, teleoperated

from trackslip.identification.drive.estimate import fit_drives
from trackslip.localization.scan import Plate
from trackslip.rangefinder.log import scanned_log
from trackslip.rangefinder.plate_motion import Turned
from trackslip.rangefinder.series import ScanSeries
from trackslip.rangefinder.session import sight_plate

PLATE, OFF = Plate(LENGTH, THICKNESS), (0.05, 0.10, np.radians(5.0))
TRUE = dict(zip(("sensor_x", "sensor_y", "sensor_yaw"), OFF, strict=True)) | {"offset": D, "radius_error": EPSILON}
MOST = {
    "offset": 0.07e-3,
    "radius_error": 0.28e-3,
    "sensor_x": 0.13e-3,
    "sensor_y": 0.08e-3,
    "sensor_yaw": np.radians(0.02),
}
DRIVES = 40


def fitted(seed):
    session = drive(teleoperated(np.random.default_rng(seed), 60.0, 4.0), things=room(), place=OFF, seed=seed)
    limits = session.angle_min, session.angle_increment, 0.05, 30.0
    series = ScanSeries.measured("a", session.time, session.ranges, *limits)
    seen = sight_plate(series, Turned.of(session.encoder_time, session.omega), PLATE)
    log = scanned_log("a", session.encoder_time, session.omega, seen, PLATE, session.mount)
    return fit_drives("icr_radius", [log], GEOMETRY)


@pytest.mark.slow
def test_forty_drives():
    fits = [fitted(seed) for seed in range(DRIVES)]
    for name, true in TRUE.items():
        values = np.array([(fit.values | fit.extras)[name] for fit in fits])
        errors = np.array([fit.stderr[name] for fit in fits])
        within = [fit.interval95[name][0] <= true <= fit.interval95[name][1] for fit in fits]
        assert np.sqrt(np.mean((values - true) ** 2)) < MOST[name]
        assert 0.6 < np.sqrt(np.mean(((values - true) / errors) ** 2)) < 1.3
        assert np.mean(within) > 0.88
