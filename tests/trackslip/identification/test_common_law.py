"""Whether one law serves several logs."""

from functools import cache

import numpy as np
import polars as pl
import pytest
from drives import GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log
from slip_data import circles, driven

import trackslip
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.common_law import MULTIPLIERS, NOTICED, PairedErrors, judged
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import Sampling
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr

SLIPPERY = ConstantIcr(0.10, 0.168, -0.02)
SEPARATION = "wheel_separation_multiplier"


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    monkeypatch.setattr(
        "trackslip.identification.drive_comparison.drive_laws", lambda: ("none", "icr_radius")
    )


@cache
def drive(seed, law=ICR, duration=90.0):
    log = drive_log(seed, duration, SLAM, law=law)
    return trackslip.identify(log, GEOMETRY, method="drive")


@cache
def samples(seed, noise=True):
    given = driven([*circles(), *circles(side=-1), (0.1, 0.0), (0.2, 0.0)], seed=seed)
    return identify_samples(Sampling.of([given], []), GEOMETRY)


def test_drives_under_one_law_are_served_by_one():
    found = trackslip.compare_logs({"monday": drive(1), "tuesday": drive(2)})
    assert found.verdict == "yes"
    assert found.line.startswith("One law serves all logs")
    assert found.differing == []
    low, high = found.common[SEPARATION][1:]
    true = 1 + ICR.offset / GEOMETRY.half_gauge
    assert low < true < high
    for cost in found.costs.values():
        assert cost.ratio.high <= NOTICED


def test_another_ground_is_not_served_and_named():
    found = trackslip.compare_logs(
        {"stone": drive(1), "again": drive(2), "ice": drive(3, SLIPPERY)}
    )
    assert found.verdict == "no"
    assert found.costs["ice"].verdict == "no"
    assert "in ice, the law of the other logs predicts with" in found.line
    assert SEPARATION in found.differing
    assert found.costs["ice"].ratio.value > 2


def test_too_little_driving_can_not_tell():
    found = trackslip.compare_logs({"long": drive(1), "short": drive(2, duration=12.0)})
    assert found.verdict == "can't tell"
    assert found.costs["short"].verdict == "can't tell"
    assert "Can't tell whether one law serves all logs" in found.line


def test_straight_driving_alone_can_not_tell_of_others():
    straight = trackslip.identify(
        drive_log(4, 60.0, SLAM, driving=constant_speeds(0.2, 0.2, 60.0)),
        GEOMETRY,
        method="drive",
    )
    found = trackslip.compare_logs({"turns": drive(1), "straight": straight})
    assert np.isnan(found.values["straight"][SEPARATION].value)
    assert found.costs["turns"].verdict == "can't tell"
    assert found.costs["turns"].reason == f"the other logs have no interval for {SEPARATION}"


def test_steady_samples_are_compared_too():
    found = trackslip.compare_logs({"one": samples(0), "two": samples(1), "drive": drive(1)})
    assert found.costs["one"].reason == "predictions of left-out samples"
    # 0.05 m in the samples, 0.045 m in the drive
    assert found.costs["drive"].ratio.value < 2


def test_differences_that_nobody_notices_are_served():
    near = ConstantIcr(ICR.offset + 2e-5, 0.168, ICR.radius_error + 2e-5)
    logs = {
        name: trackslip.identify(
            drive_log(seed, 60.0, law=law, variation=STILL), GEOMETRY, method="drive"
        )
        for seed, (name, law) in enumerate({"a": ICR, "b": near}.items())
    }
    assert trackslip.compare_logs(logs).verdict == "yes"


def test_intervals_cover_all_logs_together():
    two = trackslip.compare_logs({"a": drive(1), "b": drive(2)})
    three = trackslip.compare_logs({"a": drive(1), "b": drive(2), "c": drive(2)})
    # the mean of the others is that of the same log, and the interval allows for a third log
    assert three.costs["a"].ratio.value == pytest.approx(two.costs["a"].ratio.value)
    assert three.costs["a"].ratio.error > two.costs["a"].ratio.error


def test_robots_of_different_size_are_refused():
    other = identify_samples(
        Sampling.of([driven(circles())], []), RobotGeometry(GEOMETRY.half_gauge, 0.07)
    )
    with pytest.raises(LogError, match="a and b are of robots with different geometries"):
        trackslip.compare_logs({"a": samples(0), "b": other})


def test_one_log_is_nothing_to_compare():
    with pytest.raises(InvalidValueError, match="must be of two logs or more"):
        trackslip.compare_logs({"a": samples(0)})


def test_the_comparison_is_a_table_and_a_figure():
    found = trackslip.compare_logs({"monday": drive(1), "short": drive(2, duration=12.0)})
    frame = pl.DataFrame(found)
    assert frame["log"].unique(maintain_order=True).to_list() == ["monday", "short"]
    assert frame["multiplier"].to_list() == [*MULTIPLIERS, *MULTIPLIERS]
    assert frame["value"][0] == drive(1).answer[SEPARATION].value
    assert found._repr_html_().count("<tr>") == 4
    assert len(found.plot().axes) == 4
    assert repr(found).startswith("<LogComparison of monday, short: ")


def test_a_hardly_known_law_does_not_speak_against_one_for_all():
    """A short drive has a law that predicts a long one badly, and wide intervals."""
    found = trackslip.compare_logs({"long": drive(101), "short": drive(201, duration=25.0)})
    cost = found.costs["long"]
    assert found.differing == []
    assert cost.verdict != "no"
    assert found.verdict == "can't tell"


def test_costs_without_a_difference_are_explained():
    errors = {"common": np.full(60, 1.5), "own": np.ones(60)}
    block = np.repeat(np.arange(10), 6)
    made = PairedErrors(**errors, block=block, is_unnoticed=False, what="", of_what="")
    assert judged(made, 2, differs=True).verdict == "no"
    unclear = judged(made, 2, differs=False)
    assert unclear.verdict == "can't tell"
    assert "their values don't differ beyond their intervals" in unclear.reason
    unnoticed = PairedErrors(**errors, block=block, is_unnoticed=True, what="", of_what="")
    assert judged(unnoticed, 2, differs=True).verdict == "yes"
