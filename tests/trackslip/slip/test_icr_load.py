"""Slip in proportion to the traction."""

import numpy as np
import pytest

from trackslip.errors import InvalidValueError
from trackslip.identification.comparison import compare_laws
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.icr_load import IcrLoad

GEOMETRY = RobotGeometry(0.168, 0.06)
LAW = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.1)


def test_a_robot_that_pulls_nothing_has_constant_icrs() -> None:
    icr = ConstantIcr(0.04, GEOMETRY.half_gauge, 0.01)
    omega = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_allclose(LAW.twist(omega, GEOMETRY), icr.twist(omega, GEOMETRY), rtol=1e-13)
    kappa = np.array([0.0, 0.4, -2.0, np.inf])
    np.testing.assert_allclose(LAW(kappa), icr(kappa), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("load", [0.3, -0.5])
def test_speeds_and_twists_are_inverse(load: float) -> None:
    law = LAW.under(load)
    omega = np.random.default_rng(1).normal(size=(200, 2))
    twist = law.twist(omega, GEOMETRY)
    np.testing.assert_allclose(law.sprocket_speeds(twist, GEOMETRY), omega, rtol=1e-12)
    np.testing.assert_allclose(body_twist(omega, law.slip(twist), GEOMETRY), twist, rtol=1e-10, atol=1e-12)


def test_a_robot_slips_uphill_and_is_helped_downhill_whichever_way_it_drives() -> None:
    belts = np.array([[1.0, 1.0], [-1.0, -1.0]])
    uphill = LAW.under(0.2).twist(belts / GEOMETRY.sprocket_radius, GEOMETRY)[:, 0]
    np.testing.assert_allclose(uphill, [1.01 * (1 - 0.02), -1.01 * (1 + 0.02)])


def test_mirrored_turns_mirror() -> None:
    omega = np.array([[2.0, 3.0], [-1.0, 2.0]])
    v, w = LAW.under(0.2).twist(omega, GEOMETRY).T
    np.testing.assert_allclose(LAW.under(0.2).twist(omega[:, ::-1], GEOMETRY), np.column_stack([v, -w]), rtol=1e-12)


@pytest.mark.parametrize(("name", "value"), [("compliance", 1.5), ("load", 1.0), ("load", np.nan), ("offset", -0.2)])
def test_values_beyond_reason_are_refused(name: str, value: float) -> None:
    values = {"offset": 0.04, "half_gauge": 0.168, name: value}
    with pytest.raises(InvalidValueError, match=name):
        IcrLoad(**values)


def _samples(load: np.ndarray | None, noise: float = 1e-4) -> SlipSamples:
    """30 turns and straight runs under loads, with noise of the twists."""
    rng = np.random.default_rng(4)
    omega = rng.uniform(1.0, 4.0, (30, 2)) * np.array([1.0, rng.choice([-1.0, 1.0])])
    omega[:10, 1] = omega[:10, 0]
    true = (LAW if load is None else LAW.under(load)).twist(omega, GEOMETRY)
    covariance = np.tile(noise**2 * np.eye(2), (30, 1, 1))
    names = [f"run {k}" for k in range(30)]
    return SlipSamples.of(omega, true + noise * rng.standard_normal((30, 2)), GEOMETRY, names, covariance, load=load)


def test_the_law_is_found_from_runs_under_different_loads() -> None:
    samples = _samples(np.tile([-0.2, 0.0, 0.2], 10))
    fitted = fit_law("icr_load", samples, GEOMETRY, bootstraps=0)
    for name, value in fitted.values.items():
        assert abs(value - getattr(LAW, name)) < 4 * fitted.stderr[name]
        low, high = fitted.interval95[name]
        assert low < value < high
    assert fitted.stderr["compliance"] < 1e-3
    assert not fitted.lacks_fit
    found = compare_laws(samples, GEOMETRY)
    assert found.best == "icr_load"
    assert found.laws["icr_radius"].rms > 10 * found.laws["icr_load"].rms


def test_without_loads_the_law_is_not_tried_and_says_what_it_takes() -> None:
    assert "icr_load" not in compare_laws(_samples(None), GEOMETRY).laws
    (note,) = fit_law("icr_load", _samples(np.zeros(30)), GEOMETRY, vague=True).notes
    assert "compliance" in note
    assert "runs under loads" in note
