import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from drives import GEOMETRY, SLAM, drive_log
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from trackslip.errors import TrackslipError
from trackslip.identification.identify import identify
from trackslip.identification.result import identification_to_json


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    laws = ("none", "icr_radius")
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: laws)


def few_headings(log, rng):
    share = rng.choice([0.9, 0.999])
    return replace(
        log, pose=np.where(rng.random((len(log.time), 1)) < [0, 0, share], np.nan, log.pose)
    )


def few_poses(log, rng):
    return replace(log, valid=log.is_valid & (rng.random(len(log.time)) < 0.1))


def units_of_places(log, rng):
    unit = 10.0 ** rng.integers(-8, 9)
    return replace(log, pose=log.pose * [unit, unit, 1])


def units_of_headings(log, rng):
    unit = rng.choice([0, 57.3, -1, 1e9])
    return replace(log, pose=log.pose * [1, 1, unit])


def nearly_at_rest(log, rng):
    return replace(log, omega=np.where(log.time[:, None] < 5, 0, log.omega))


def far_away(log, rng):
    origin = 10.0 ** rng.integers(3, 13, (1, 3)) * [1, 1, 0]
    return replace(log, pose=log.pose + origin)


def jumps(log, rng):
    count = np.cumsum(rng.random((len(log.time), 1)) < 0.05)
    return replace(log, pose=log.pose + 10 * count[:, None])


def same_pose(log, rng):
    first = log.pose[log.is_valid][0]
    return replace(log, pose=np.where(log.time[:, None] > 5, first, log.pose))


MISTAKES = {
    "few rows": lambda log, rng: log.between(0, int(rng.integers(2, 60))),
    "no headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, np.nan]),
    "few headings": few_headings,
    "few poses": few_poses,
    "swapped": lambda log, rng: replace(log, omega=log.omega[:, ::-1]),
    "units of speeds": lambda log, rng: replace(log, omega=log.omega * 10.0 ** rng.integers(-8, 9)),
    "units of places": units_of_places,
    "units of headings": units_of_headings,
    "units of times": lambda log, rng: replace(log, time=log.time * 10.0 ** rng.integers(-9, 10)),
    "one sprocket at rest": lambda log, rng: replace(log, omega=log.omega * [1, 0]),
    "nearly at rest": nearly_at_rest,
    "far away": far_away,
    "poses at random": lambda log, rng: replace(
        log, pose=log.pose + rng.normal(size=log.pose.shape)
    ),
    "jumps": jumps,
    "speeds at random": lambda log, rng: replace(log, omega=rng.normal(size=log.omega.shape) * 5),
    "gap": lambda log, rng: replace(log, time=log.time + 1e4 * (log.time > 3)),
    "same pose": same_pose,
}


@settings(
    max_examples=5,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@example(["one sprocket at rest", "units of headings"], 14)  # a gain of turns of 0
@example(["nearly at rest", "same pose"], 1)  # no part between jumps
@given(
    st.lists(st.sampled_from(sorted(MISTAKES)), min_size=1, max_size=3, unique=True),
    st.integers(0, 20),
)
def test_malformed_drives_end_in_laws_or_one_line(mistakes, seed):
    rng = np.random.default_rng(seed)
    driving = ("random", "eights", "stop_and_go", "loop")[seed % 4]
    log = drive_log(seed, 6.0, SLAM, driving=driving)
    message = ""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            for mistake in mistakes:
                log = MISTAKES[mistake](log, rng)
            found = identify(log, GEOMETRY, method="drive")
        except TrackslipError as error:
            message = str(error)
    assert "\n" not in message
    assert len(message) < 400
    if not message:
        json.dumps(identification_to_json(found))
        for fit in found.drive.laws.values():
            assert np.isfinite(list(fit.values.values())).all()
