"""What is read of an identification, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trackslip.errors import TrackslipError
from trackslip.laws.icr import ConstantIcr
from trackslip.planning.limits import read_identification

STDERR = {"offset": 2e-4, "radius_error": 9e-4, "sensor_x": 1e-3}
CORRELATION = [[1.0, 0.5, 0.1], [0.5, 1.0, 0.0], [0.1, 0.0, 1.0]]
LAW = {
    "values": {"offset": 0.045, "radius_error": 0.006},
    "stderr": STDERR,
    "interval95": {"offset": [0.0441, 0.0459]},
    "correlation": CORRELATION,
    "extras": dict.fromkeys(("sensor_x", "sensor_y", "sensor_yaw", "drift", "clock_offset", "lag"), 0.0),
    "noise": {"position": 0.02, "heading": 0.01, "slip_forward": 0.003, "slip_sideways": 1e-9, "slip_turn": 0.004},
}
ICR = {"values": {"offset": 0.044}, "stderr": {"offset": 1e-3}}


def summary(**changes):
    """What an identification by whole drives stores, with changes to what it says of icr_radius."""
    law = {**LAW, **changes}
    return {
        "format": 1,
        "method": "drive",
        "geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06},
        "slip_laws": {"icr": ICR, "icr_radius": {key: law[key] for key in ("values", "stderr", "interval95")}},
        "drive": {"best": "icr_radius", "laws": {"icr_radius": law, "none": {"values": {}, "stderr": {}}}},
    }


def written(folder, content):
    (folder / "summary.json").write_text(json.dumps(content))
    return folder


def test_law_noise_and_covariance(tmp_path):
    before, knowledge = read_identification(written(tmp_path, summary()), "icr_radius")
    assert before.law == ConstantIcr(0.045, 0.168, 0.006)
    assert before.errors.names == ("offset", "radius_error")
    wide = 0.0018 / 2 / 1.959964  # the interval is wider than the model's
    expected = np.array([[wide**2, 0.5 * wide * 9e-4], [0.5 * wide * 9e-4, 9e-4**2]])
    np.testing.assert_allclose(before.errors.covariance, expected, rtol=1e-6)
    assert knowledge.slip == (0.003, 1e-4, 0.004)
    assert knowledge.offset == 0.045
    assert knowledge.reach_doubt == pytest.approx(0.01)
    assert before.geometry.half_gauge == 0.168


def test_a_law_of_steady_stretches_has_errors_alone(tmp_path):
    before, _ = read_identification(written(tmp_path, summary()) / "summary.json", "icr")
    np.testing.assert_allclose(before.errors.covariance, [[1e-6]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "no slip laws in it"),
        (summary() | {"geometry": {"half_gauge": -1, "sprocket_radius": 1}}, "half_gauge = -1"),
        (summary() | {"slip_laws": {"icr": ICR}}, "law = 'icr_radius': must be one of none, icr (in "),
        (summary(stderr={}), "no standard errors of the law icr_radius in it"),
        (summary(values={"offset": 0.04}), "radius_error = None: must be a number"),
        (summary(correlation=[[1, 2, 0], [2, 1, 0], [0, 0, 1]]), "is damaged (covariance"),
        (summary(noise={"slip_turn": 1.0}), "is damaged (noise"),
    ],
)
def test_summaries_that_cannot_be_used(tmp_path, content, message):
    with pytest.raises(TrackslipError) as refused:
        read_identification(written(tmp_path, content), "icr_radius")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
