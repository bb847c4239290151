"""Tables of steady samples, measured by hand, with a column in another unit or of another side."""

import numpy as np
import pyarrow as pa
import pytest

from trackslip.errors import LogError
from trackslip.identification.identify import identify
from trackslip.kinematics import RobotGeometry

pytestmark = pytest.mark.usefixtures("few_laws")
GEOMETRY = RobotGeometry(0.25, 0.08)
TWIST = np.array(
    [
        [0.5, 0.0],
        [-0.4, 0.0],
        [0.5, 0.3],
        [0.5, -0.3],
        [0.3, 0.6],
        [0.3, -0.6],
        [0.0, 0.8],
        [0.0, -0.8],
        [0.6, 0.15],
    ]
)
SPOT = TWIST[[6, 7, 6, 7]]
RPM = 30 / np.pi


def table(driven=TWIST, separation=1.4):
    """Samples of a robot that turns by 1 / separation of what its sprockets say, and is 2 % slower;
    measured to 1 %.
    """
    left = driven[:, 0] - GEOMETRY.half_gauge * driven[:, 1]
    right = driven[:, 0] + GEOMETRY.half_gauge * driven[:, 1]
    error = 1 + 0.01 * np.random.default_rng(1).standard_normal(driven.shape)
    v, w = (0.98 * driven * error).T
    radius = GEOMETRY.sprocket_radius
    return {"omega_l": left / radius, "omega_r": right / radius, "v": v, "w": w / separation}


def changed(columns, samples=None):
    """Samples with some columns multiplied by a factor."""
    samples = samples or table()
    return samples | {name: factor * samples[name] for name, factor in columns.items()}


def exchanged():
    samples = table()
    return samples | {"omega_l": samples["omega_r"], "omega_r": samples["omega_l"]}


BELTS = dict.fromkeys(("omega_l", "omega_r"), GEOMETRY.sprocket_radius)


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        (changed({"v": 100}), "v looks like cm/s, not m/s: --columns v=v:cm/s reads it"),
        (changed({"v": 1000}), "v looks like mm/s"),
        (changed({"w": 180 / np.pi}), "w looks like deg/s, not rad/s: --columns w=w:deg/s"),
        (changed({"omega_l": RPM, "omega_r": RPM}), "omega_l and omega_r look like rpm, not rad/s"),
        (
            changed({"omega_l": RPM, "omega_r": RPM}, table(SPOT)),
            "--columns omega_l=omega_l:rpm,omega_r=omega_r:rpm reads them",
        ),
        (changed(BELTS), "speeds of the belts in m/s: --columns omega_l=omega_l:m/s,"),
        (exchanged(), "tracks are swapped: exchange omega_l and omega_r, or change the sign of w"),
        (changed({"omega_l": -1}), "omega_l counts backwards: change its sign"),
        (changed({"omega_l": -1, "omega_r": -1}), "change the signs of omega_l and omega_r"),
        (changed({"v": 100, "w": 180 / np.pi}), "v looks like cm/s.*; and w looks like deg/s"),
    ],
)
def test_a_wrong_column_is_named_with_the_remedy(samples, said):
    with pytest.raises(LogError, match=said) as refused:
        identify(pa.table(samples), GEOMETRY)
    assert "\n" not in str(refused.value)
    count = len(samples["v"])
    assert f"({count} of {count} rows fit then" in str(refused.value)


def test_the_option_that_is_named_reads_the_samples():
    samples = pa.table(changed({"w": 180 / np.pi}))
    found = identify(samples, GEOMETRY, columns="w=w:deg/s").answer["wheel_separation_multiplier"]
    assert found.low < 1.4 < found.high


def test_a_single_row_that_is_wrong_is_left_out():
    samples = table()
    samples["w"][3] *= -1
    found = identify(pa.table(samples), GEOMETRY)
    assert [refused.run for refused in found.outliers] == ["row 4"]


def test_most_rows_wrong_without_a_reason_are_refused():
    samples = table()
    samples["v"] = np.random.default_rng(2).uniform(-2, 2, len(samples["v"]))
    samples["w"][:2] = np.nan  # rows without a number count, too
    with pytest.raises(LogError, match=r"\d of 7 rows contradict their sprockets; row 3: it"):
        identify(pa.table(samples), GEOMETRY)


@pytest.mark.parametrize(
    "separation",
    [
        pytest.param(0.85, marks=pytest.mark.slow),
        1.0,
        pytest.param(2.5, marks=pytest.mark.slow),
        4.5,
    ],
)
def test_robots_that_turn_much_or_little_are_taken(separation):
    found = identify(pa.table(table(separation=separation)), GEOMETRY)
    answer = found.answer["wheel_separation_multiplier"]
    assert abs(answer.value - separation) < 0.1 * separation


def test_few_samples_are_the_reason_of_a_wide_interval():
    few = {name: values[[2, 3]] for name, values in table().items()}
    few["w"] = few["w"] * [1.6, 0.5]
    (alarm,) = identify(pa.table(few), GEOMETRY).alarms
    assert "2 samples are too few: take 6 or more" in alarm.line


def test_scatter_is_the_reason_of_a_wide_interval():
    samples = table(np.tile(TWIST[2:6], (2, 1)))
    samples["w"] = samples["w"] * [0.4, 1.6, 1.0, 0.2, 1.6, 0.4, 0.3, 1.7]
    (alarm,) = identify(pa.table(samples), GEOMETRY).alarms
    assert "the samples scatter by" in alarm.line
