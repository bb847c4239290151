"""What is plotted over time, and the axes of the plots."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.recording.run import panels
from experiments.recording.traces import traces_of
from trackslip.kinematics import RobotGeometry, limit_sprocket_speeds
from trackslip.slip.exponential import ExponentialSpeed


def test_slips_agree_in_steady_turns(driven):
    traces = traces_of(driven[1][1])
    steady = slice(160, 260)
    for other in (traces.identified, traces.law):
        np.testing.assert_allclose(np.nanmean(other[steady], axis=0), traces.slip[steady].mean(axis=0), atol=0.01)
    assert traces.law_name == "icr_radius"
    assert traces.moment > 11.9
    assert traces.distance[0] == pytest.approx(np.hypot(0.1, 0.1), abs=1e-6)  # the circle is the one that was asked for


def test_the_law_shown_is_the_one_that_compensated(driven):
    """Also one from a file of the user's, and one that depends on speed."""
    log = driven[1][0]
    geometry = RobotGeometry(**log.metadata["geometry"])
    law = ExponentialSpeed(0.12, -0.9, -0.3, -1.1, gamma_outer=0.2, gamma_inner=-0.3)
    limit = log.metadata["drive"]["top_speed"] / geometry.sprocket_radius
    command = limit_sprocket_speeds(law.sprocket_speeds(log.twist_command, geometry), limit)
    traces = traces_of(replace(log, command=command, metadata=log.metadata | {"compensation": "exponential"}))
    slip = law.slip(log.twist_command)
    shown = np.isfinite(traces.law)
    assert shown.mean() > 0.8
    np.testing.assert_allclose(traces.law[shown], slip[shown], atol=1e-9)
    assert not shown[np.abs(command).max(axis=1) >= limit].any()  # scaled down: it can't be told there
    assert traces.law_name == "exponential"


def test_slips_are_on_their_axis(driven):
    traces = traces_of(driven[1][1])
    slip = {panel.title: panel.range for panel in panels([traces]) if "lip" in panel.title}
    assert slip == {"Slip [-]": (-0.25, 0.20)}
    more = replace(traces, slip=np.tile([-0.7, 0.3], (len(traces.time), 1)))
    for runs in ([more], [traces, more]):
        ranges = [panel.range for panel in panels(runs) if "slip/true" in panel.entities]
        assert all(low < -0.7 and high > 0.3 for low, high in ranges)
