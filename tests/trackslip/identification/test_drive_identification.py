"""Whole drives through the front door."""

import json
import re
import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from slip_data import grid

from trackslip.errors import InvalidValueError, LogError, TrackslipError
from trackslip.identification.identify import identify, identify_source
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import Sampling
from trackslip.identification.source import Source
from trackslip.logs.runlog import RunLog
from trackslip.slip.law_file import load_laws

DRIVEN = 12.0  # [s]


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    """Fit few laws: those that are tabulated take most of the time, and have tests of their own."""
    monkeypatch.setattr("trackslip.identification.comparison.drive_laws", lambda: ("none", "icr", "icr_radius"))


@cache
def identified():
    return identify([drive_log(seed, 20) for seed in (1, 2)], GEOMETRY, method="drive")


def test_a_drive_gives_laws_intervals_and_predictions():
    found = identified()
    assert found.method == "drive"
    assert found.steady is None
    assert set(found.laws) == {"none", "icr", "icr_radius"}
    low, high = found.intervals["icr_radius"]["offset"]
    assert low < ICR.offset < high
    assert found.drive.errors["icr_radius"][2.0].heading_rms < found.drive.errors["none"][2.0].heading_rms
    assert "2 drives" in repr(found)
    assert found.best in repr(found)
    with pytest.raises(TrackslipError, match="there are no steady samples"):
        found.samples  # noqa: B018


def test_a_summary_is_json_that_load_laws_reads(tmp_path):
    content = json.loads(json.dumps(identification_to_json(identified()), allow_nan=False))
    assert content["method"] == "drive"
    assert content["drive"]["laws"]["icr_radius"]["held"]["lag"] == "none shows"
    assert set(content["prediction"]["icr"]) <= {"1", "2", "5", "10"}
    file = tmp_path / "summary.json"
    file.write_text(json.dumps(content))
    laws = load_laws(file)
    law = laws["icr_radius"]
    assert law.offset == pytest.approx(float(identified().laws["icr_radius"].offset))


def test_results_are_the_same_bits_again():
    log = drive_log(1, DRIVEN)
    first, second = (json.dumps(identification_to_json(identify(log, GEOMETRY, method="drive"))) for _ in range(2))
    assert first == second


def test_driving_that_changes_all_the_time_is_identified_as_a_drive_by_itself():
    found = identify(drive_log(1, DRIVEN), GEOMETRY)
    assert found.method == "drive"


@pytest.mark.slow
def test_steady_driving_stays_steady_with_whole_drives_beside_it():
    speeds = [(0.1, 0.2), (0.2, 0.1), (0.05, 0.2), (0.2, 0.05), (0.15, 0.2), (0.2, 0.2)]
    logs = [
        replace(drive_log(k, 12, EXACT, STILL, driving=constant_speeds(*pair, 12.0)), run=f"run {k}")
        for k, pair in enumerate(speeds)
    ]
    found = identify(logs, GEOMETRY)
    assert found.method == "steady"
    assert found.drive is not None
    assert set(found.drive.laws) <= {"none", "icr", "icr_radius"}
    assert found.drive.laws["icr_radius"].values["offset"] == pytest.approx(ICR.offset, abs=1e-4)
    assert found.laws["icr_radius"].offset == pytest.approx(ICR.offset, abs=1e-3)


def test_closed_loops_can_be_identified_from_as_drives():
    log = drive_log(1, DRIVEN)
    closed = replace(log, metadata={"controller": {"name": "any"}})
    assert identify(closed, GEOMETRY).method == "drive"
    with pytest.raises(LogError, match="in closed loop"):
        identify(closed, GEOMETRY, method="steady")


def test_steady_samples_are_no_drives():
    source = Source(GEOMETRY, Sampling(grid(ICR), (), ()), ())
    with pytest.raises(LogError, match="only method steady can be used"):
        identify_source(source, "drive")
    with pytest.raises(InvalidValueError, match="steady or drive"):
        identify_source(source, "quick")


def test_a_reversed_robot_is_said_in_one_line():
    log = drive_log(1, DRIVEN)
    with pytest.raises(LogError, match="turns against its sprockets") as caught:
        identify(replace(log, omega=log.omega[:, ::-1]), GEOMETRY, method="drive")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (
            RunLog("two", np.array([0.0, 1.0]), np.ones((2, 2)), np.zeros((2, 3))),
            "1 pose while it drives, needs at least 10",
        ),
        (RunLog("still", np.arange(40.0), np.zeros((40, 2)), np.zeros((40, 3))), "stand still"),
        (
            RunLog("held", np.arange(40.0), np.ones((40, 2)), np.zeros((40, 3))),
            "1 pose while it drives, needs at least 10",
        ),
    ],
)
def test_what_is_no_drive_is_said(log, said):
    with pytest.raises(LogError, match=re.escape(said)):
        identify(log, GEOMETRY, method="drive")


MISTAKES = {
    "few rows": lambda log, rng: log.between(0, int(rng.integers(2, 60))),
    "no headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, np.nan]),
    "few headings": lambda log, rng: _without_headings(log, rng.random(len(log.time)) < rng.choice([0.9, 0.999])),
    "few poses": lambda log, rng: replace(log, valid=log.is_valid & (rng.random(len(log.time)) < 0.1)),
    "swapped": lambda log, rng: replace(log, omega=log.omega[:, ::-1]),
    "reversed": lambda log, rng: replace(log, omega=log.omega * rng.choice([-1, 1], 2)),
    "units of speeds": lambda log, rng: replace(log, omega=log.omega * 10.0 ** rng.integers(-8, 9)),
    "units of places": lambda log, rng: replace(log, pose=log.pose * [*[10.0 ** rng.integers(-8, 9)] * 2, 1]),
    "units of headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, rng.choice([0, 57.3, -1, 1e9])]),
    "units of times": lambda log, rng: replace(log, time=log.time * 10.0 ** rng.integers(-9, 10)),
    "late": lambda log, rng: replace(log, time=log.time + 10.0 ** rng.integers(0, 10)),
    "one sprocket at rest": lambda log, rng: replace(log, omega=log.omega * [1, 0]),
    "nearly at rest": lambda log, rng: replace(log, omega=np.where(log.time[:, None] < 5, 0, log.omega)),
    "far away": lambda log, rng: replace(log, pose=log.pose + 10.0 ** rng.integers(3, 13, (1, 3)) * [1, 1, 0]),
    "poses at random": lambda log, rng: replace(
        log, pose=np.where(log.is_valid[:, None], rng.normal(size=log.pose.shape), log.pose)
    ),
    "jumps": lambda log, rng: replace(
        log, pose=log.pose + 10 * np.cumsum(rng.random((len(log.time), 1)) < 0.05)[:, None]
    ),
    "encoders stop": lambda log, rng: replace(
        log, omega=np.where(log.time[:, None] > log.time[len(log.time) // 3], log.omega[len(log.omega) // 3], log.omega)
    ),
    "speeds at random": lambda log, rng: replace(log, omega=rng.normal(size=log.omega.shape) * 5),
    "one huge": lambda log, rng: _one_huge(log, rng),
    "gap": lambda log, rng: replace(log, time=log.time + 1e4 * (log.time > 3)),
    "same pose": lambda log, rng: replace(
        log, pose=np.where(log.time[:, None] > 5, log.pose[log.is_valid][0], log.pose)
    ),
}


def _without_headings(log, rows):
    pose = log.pose.copy()
    pose[rows, 2] = np.nan
    return replace(log, pose=pose)


def _one_huge(log, rng):
    omega, pose = log.omega.copy(), log.pose.copy()
    omega[rng.integers(len(omega)), rng.integers(2)] = 1e9
    pose[rng.integers(len(pose)), rng.integers(2)] = 1e9
    return replace(log, omega=omega, pose=pose)


def complaint_of(mistakes, seed):
    """What identification complains about; it ends in laws or a TrackslipError, without a warning of NumPy's."""
    rng = np.random.default_rng(seed)
    driving = ("random", "eights", "stop_and_go", "loop")[seed % 4]
    log = drive_log(seed, 6.0, SLAM, driving=driving)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            for mistake in mistakes:
                log = MISTAKES[mistake](log, rng)
            found = identify(log, GEOMETRY, method="drive")
        except TrackslipError as error:
            return str(error)
    json.dumps(identification_to_json(found))
    assert all(np.isfinite(list(fit.values.values())).all() for fit in found.drive.laws.values())
    return ""


def malformed(count):
    """A property of `count` malformed drives."""
    strategy = st.lists(st.sampled_from(sorted(MISTAKES)), min_size=1, max_size=3, unique=True)
    checks = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]

    def of(test):
        limited = settings(max_examples=count, derandomize=True, suppress_health_check=checks)
        return limited(given(strategy, st.integers(0, 20))(test))

    return of


@pytest.fixture
def few_rounds(monkeypatch):
    """Stop fits early: these of malformed drives go on as long as they may."""
    monkeypatch.setattr("trackslip.identification.drive_fit._ROUNDS", 3)
    monkeypatch.setattr("trackslip.identification.comparison.drive_laws", lambda: ("none", "icr"))


@pytest.mark.usefixtures("few_rounds")
@malformed(25)
def test_malformed_drives_end_in_laws_or_one_line(mistakes, seed):
    complaint = complaint_of(mistakes, seed)
    assert "\n" not in complaint
    assert len(complaint) < 400


@pytest.mark.slow
@malformed(300)
def test_many_malformed_drives_end_in_laws_or_one_line(mistakes, seed):
    complaint = complaint_of(mistakes, seed)
    assert "\n" not in complaint
    assert len(complaint) < 400
