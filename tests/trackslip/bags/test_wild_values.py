"""Values that no sensor states: one line, or a log of finite numbers, and never a warning of NumPy's."""

import numpy as np
from bags import fix, in_order, joint_states, odometry, sprocket_angles, stamp, transform, write_bag
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from wandered import wandered

from trackslip.bags.choice import BagChoice
from trackslip.bags.drives import read_bags
from trackslip.errors import TrackslipError

LOG = wandered(duration=2.0)
WILD = st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e16, 5e-324, 0.0, -1.0])
TIMES = st.sampled_from([0, 1, -(2**31) * 10**9, 2**31 * 10**9 - 1, stamp(1.0), stamp(1e6)])


@settings(
    max_examples=4, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_values_that_no_sensor_states_end_in_a_line_or_a_log_of_finite_numbers(tmp_path_factory, data):
    rows = st.integers(0, len(LOG.time) - 1)
    table = np.column_stack([sprocket_angles(LOG), LOG.omega[:, 0], LOG.pose, np.full(len(LOG.time), 1e-4)])
    for column in table.T:
        for row, value in data.draw(st.dictionaries(rows, WILD, max_size=6)).items():
            column[row] = value
    stamps = [data.draw(st.dictionaries(rows, TIMES, max_size=4), label="stamps") for _ in range(2)]
    messages = []
    for k, (left, right, speed, x, y, phi, variance) in enumerate(table.tolist()):
        at, seen = (one.get(k, stamp(LOG.time[k])) for one in stamps)
        late = stamp(LOG.time[k]) + 1000
        messages.append(joint_states(at, ["left", "right"], [left, right], [speed, 1.0], late=late - at))
        with np.errstate(invalid="ignore"):
            messages.append(odometry(seen, (x, y, phi), variances=(variance,) * 3, late=late - seen))
            messages.append(transform(seen, "map", "base_link", (x, y, phi), late=late - seen))
            messages.append(fix(seen, 47 + 1e-5 * x, 8 + 1e-5 * y, variance, variance=variance, late=late - seen))
    path = write_bag(tmp_path_factory.mktemp("wild") / "run", "mcap", in_order(messages))
    said = ""
    try:
        (log, *_) = read_bags(
            path, BagChoice(poses=data.draw(st.sampled_from(("/odom", "/fix", "tf:map:base_link"))))
        ).runs
        assert np.isfinite(log.omega).all()
        assert np.isfinite(log.pose[log.is_valid][:, :2]).all()
    except TrackslipError as error:
        said = str(error)
    assert "\n" not in said
