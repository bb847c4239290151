"""The error of localization against the viewing angle."""

import numpy as np
import pytest
from figures import assert_readable
from spin import METADATA, spun_before_the_scanner

from experiments.measuring.sightings import sightings
from experiments.report.figures.localization import error_against_viewing_angle


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_errors_are_those_of_the_poses_and_stand_beside_the_bound(factor):
    seen = sightings([spun_before_the_scanner(factor=factor)])
    assert seen is not None
    assert 0 <= seen.angle.min() < seen.angle.max() <= np.pi / 2
    clear = seen.measured & (seen.angle > np.radians(5))
    ratio = np.sqrt(np.mean((seen.error / seen.bound)[clear] ** 2, axis=0))
    np.testing.assert_allclose(ratio, factor, rtol=0.08)
    assert (seen.angle.size, np.sum(~seen.measured)) == (2000, 200)
    np.testing.assert_allclose(seen.ratio(), factor, rtol=0.1)
    figure = assert_readable(error_against_viewing_angle(seen))
    assert [axis.get_ylabel() for axis in figure.axes] == ["error of position, rms [mm]", "error of heading, rms [°]"]
    assert [len(axis.lines) for axis in figure.axes] == [4, 2]


@pytest.mark.parametrize("key", ["plate", "scanner", "lrf"])
def test_nothing_is_drawn_unless_plate_scanner_and_mount_are_known(key):
    metadata = {name: value for name, value in METADATA.items() if name != key}
    assert sightings([spun_before_the_scanner(20, metadata)]) is None
    assert sightings([]) is None
