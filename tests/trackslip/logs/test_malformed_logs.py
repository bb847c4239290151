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
    monkeypatch.setattr(
        "trackslip.identification.drive_comparison.drive_laws", lambda: ("none", "icr_radius")
    )


MISTAKES = {
    "few rows": lambda log, rng: log.between(0, int(rng.integers(2, 60))),
    "no headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, np.nan]),
    "few headings": lambda log, rng: replace(
        log,
        pose=np.where(
            rng.random((len(log.time), 1)) < [0, 0, rng.choice([0.9, 0.999])], np.nan, log.pose
        ),
    ),
    "few poses": lambda log, rng: replace(
        log, valid=log.is_valid & (rng.random(len(log.time)) < 0.1)
    ),
    "swapped": lambda log, rng: replace(log, omega=log.omega[:, ::-1]),
    "units of speeds": lambda log, rng: replace(log, omega=log.omega * 10.0 ** rng.integers(-8, 9)),
    "units of places": lambda log, rng: replace(
        log, pose=log.pose * [*[10.0 ** rng.integers(-8, 9)] * 2, 1]
    ),
    "units of headings": lambda log, rng: replace(
        log, pose=log.pose * [1, 1, rng.choice([0, 57.3, -1, 1e9])]
    ),
    "units of times": lambda log, rng: replace(log, time=log.time * 10.0 ** rng.integers(-9, 10)),
    "one sprocket at rest": lambda log, rng: replace(log, omega=log.omega * [1, 0]),
    "nearly at rest": lambda log, rng: replace(
        log, omega=np.where(log.time[:, None] < 5, 0, log.omega)
    ),
    "far away": lambda log, rng: replace(
        log, pose=log.pose + 10.0 ** rng.integers(3, 13, (1, 3)) * [1, 1, 0]
    ),
    "poses at random": lambda log, rng: replace(
        log, pose=log.pose + rng.normal(size=log.pose.shape)
    ),
    "jumps": lambda log, rng: replace(
        log, pose=log.pose + 10 * np.cumsum(rng.random((len(log.time), 1)) < 0.05)[:, None]
    ),
    "speeds at random": lambda log, rng: replace(log, omega=rng.normal(size=log.omega.shape) * 5),
    "gap": lambda log, rng: replace(log, time=log.time + 1e4 * (log.time > 3)),
    "same pose": lambda log, rng: replace(
        log, pose=np.where(log.time[:, None] > 5, log.pose[log.is_valid][0], log.pose)
    ),
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
    message, driving = "", ("random", "eights", "stop_and_go", "loop")[seed % 4]
    log = drive_log(seed, 6.0, SLAM, driving=driving)
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
        assert all(
            np.isfinite(list(fit.values.values())).all() for fit in found.drive.laws.values()
        )
