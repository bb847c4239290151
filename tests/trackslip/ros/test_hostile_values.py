"""Values that no sensor states: one line, or a log of finite numbers, and never a warning of NumPy's."""

import numpy as np
import pytest
from bags import fix, in_order, joint_states, odometry, stamp, transform, write_bag
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from wandered import wandered

from trackslip.errors import TrackslipError
from trackslip.ros.choice import BagChoice
from trackslip.ros.drive_log import read_bags

LOG = wandered(duration=3.0)
WILD = st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e16, 5e-324, 0.0, -1.0])
TIMES = st.sampled_from([0, 1, -(2**31) * 10**9, 2**31 * 10**9 - 1, stamp(1.0), stamp(1e6)])
SOURCES = ("/odom", "/fix", "tf:map:base_link")


def rows(draw, count):
    return draw(st.dictionaries(st.integers(0, count - 1), WILD, max_size=6))


@settings(
    max_examples=12, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_wild_values(tmp_path_factory, data):
    count = len(LOG.time)
    turned = np.cumsum(LOG.omega * 0.05, axis=0)
    places = {place: rows(data.draw, count) for place in ("left", "right", "velocity", "x", "y", "phi", "variance")}
    stamps = [
        data.draw(st.dictionaries(st.integers(0, count - 1), TIMES, max_size=4), label="stamps") for _ in range(2)
    ]
    messages = []
    for k, time in enumerate(LOG.time):
        wild = {place: values.get(k) for place, values in places.items()}
        left, right = (
            wild[side] if wild[side] is not None else turned[k, n] for n, side in enumerate(("left", "right"))
        )
        speed = LOG.omega[k, 0] if wild["velocity"] is None else wild["velocity"]
        x, y, phi = (LOG.pose[k, n] if wild[p] is None else wild[p] for n, p in enumerate(("x", "y", "phi")))
        variance = 1e-4 if wild["variance"] is None else wild["variance"]
        at, seen = (one.get(k, stamp(time)) for one in stamps)
        late = stamp(time) + 1000
        messages.append(joint_states(at, ["left", "right"], [left, right], [speed, 1.0], late=late - at))
        with np.errstate(invalid="ignore"):
            messages.append(odometry(seen, (x, y, phi), variances=(variance,) * 3, late=late - seen))
            messages.append(transform(seen, "map", "base_link", (x, y, phi), late=late - seen))
            messages.append(fix(seen, 47 + 1e-5 * x, 8 + 1e-5 * y, variance, variance=variance, late=late - seen))
    path = write_bag(tmp_path_factory.mktemp("wild") / "run", "mcap", in_order(messages))
    for source in SOURCES:
        said = ""
        try:
            (log, *_) = read_bags(path, BagChoice(poses=source)).runs
            assert np.isfinite(log.omega).all()
            assert np.isfinite(log.pose[log.is_valid][:, :2]).all()
        except TrackslipError as error:
            said = str(error)
        assert "\n" not in said


@pytest.mark.parametrize("position", [1e6, -1e6])
def test_an_absurd_position_is_a_leap(tmp_path, position):
    turned = np.cumsum(LOG.omega * 0.05, axis=0) + 100.0
    turned[30, 0] = position
    joints = [joint_states(stamp(t), ["left", "right"], p) for t, p in zip(LOG.time, turned.tolist(), strict=True)]
    poses = [odometry(stamp(t), p, topic="/slam") for t, p in zip(LOG.time, LOG.pose.tolist(), strict=True)]
    read = read_bags(write_bag(tmp_path / "run", "mcap", in_order(joints, poses)))
    assert "topic /joint_states: joint left: its position leaps 2 time(s): bridged" in read.notes
    np.testing.assert_allclose(read.runs[0].omega[40:], LOG.omega[40:], atol=1e-9)
