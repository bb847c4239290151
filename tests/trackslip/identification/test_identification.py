import json

import numpy as np
import pytest

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.comparison import compare_laws
from trackslip.identification.fitted import fit_law
from trackslip.identification.result import laws_to_json
from trackslip.identification.samples import SlipSamples, true_samples, usable_samples
from trackslip.kinematics import RobotGeometry, advance, body_twist
from trackslip.logs.runlog import RunLog
from trackslip.slip.exponential import PUBLISHED
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.law_file import SHIPPED, load_laws

GEOMETRY = RobotGeometry(0.168, 0.06)
KAPPA = np.array([1.6, 0.8, 0.5, 0.4, 0.3, -1.0, -0.35])


def samples_of(law, kappa=KAPPA, noise=0.0, seed=0):
    twist = np.column_stack([np.full(kappa.size, 0.15), 0.15 * kappa])
    omega = law.sprocket_speeds(twist, GEOMETRY)
    omega = omega * (1 + np.random.default_rng(seed).normal(0, noise, omega.shape))
    return SlipSamples.of(omega, twist, GEOMETRY, [str(k) for k in range(kappa.size)])


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("exponential", PUBLISHED),
        ("icr", ConstantIcr(0.0447, 0.168)),
        ("icr_radius", ConstantIcr(0.0447, 0.168, 0.0067)),
        ("icr_radius", ConstantIcr(-0.02, 0.168, -0.03)),
    ],
)
def test_fits_find_the_law_that_made_the_samples(name, law):
    fit = fit_law(name, samples_of(law), GEOMETRY)
    assert fit.rms < 1e-7
    for key, value in fit.values.items():
        assert value == pytest.approx(getattr(law, key), abs=1e-6)


def test_standard_errors_are_the_scatter_of_the_estimates():
    law = ConstantIcr(0.0447, 0.168, 0.0067)
    kappa = np.tile(KAPPA, 4)  # for few runs the robust errors are on the safe side
    fits = [
        fit_law("icr_radius", samples_of(law, kappa, noise=0.001, seed=k), GEOMETRY, bootstraps=0) for k in range(200)
    ]
    for key in ("offset", "radius_error"):
        scatter = np.std([fit.values[key] for fit in fits])
        stated = np.sqrt(np.mean([fit.stderr[key] ** 2 for fit in fits]))
        assert stated == pytest.approx(scatter, rel=0.2)


def test_too_few_samples_and_unknown_laws():
    with pytest.raises(LogError, match="can't determine its 4 parameters"):
        fit_law("exponential", samples_of(PUBLISHED, KAPPA[:2]), GEOMETRY)
    with pytest.raises(InvalidValueError, match="one of none, constant, exponential"):
        fit_law("cubic", samples_of(PUBLISHED), GEOMETRY)
    with pytest.raises(LogError, match="run 'still': the sprockets stand still"):
        SlipSamples.of(np.zeros((1, 2)), np.array([[0.1, 0.1]]), GEOMETRY, ["still"])


def test_parameters_that_the_samples_do_not_determine_are_not_reported():
    rng = np.random.default_rng(0)
    straight = samples_of(ConstantIcr(0.045, 0.168, 0.01), np.zeros(8))
    for samples in (straight, samples_of(ConstantIcr(0.045, 0.168, 0.01), 1e-4 * rng.normal(size=8), noise=0.002)):
        with pytest.raises(LogError, match="don't determine"):
            compare_laws(samples, GEOMETRY)
    few = compare_laws(samples_of(ConstantIcr(0.045, 0.168, 0.01), KAPPA[:2], noise=1e-4), GEOMETRY)
    assert {"icr", "icr_radius"} <= set(few.laws) <= {"none", "constant", "icr", "icr_radius", "turn_loss"}
    assert {warning.split(":")[0] for warning in few.warnings} >= {"law exponential", "law exponential_speed"}


@pytest.mark.parametrize(
    ("omega", "twist", "message"),
    [
        ([2.0, 3.0], [0.15, 0.2 * 57.3], "check the units"),
        ([2.0, 3.0], [150.0, 0.2], "check the units"),
        ([20.0, 30.0], [0.15, 0.2], "check the units"),
        ([3.0, 2.0], [0.15, 0.2], "are the tracks swapped"),
    ],
)
def test_wrong_units_and_swapped_tracks_are_noticed(omega, twist, message):
    with pytest.raises(LogError, match=message):
        SlipSamples.of(np.array([omega]), np.array([twist]), GEOMETRY, ["odd"])


@pytest.mark.parametrize("tight", [0.25, 0.23, 0.19, -0.25])
def test_a_run_tighter_than_the_poles_does_not_trap_the_fit(tight):
    law = ConstantIcr(0.0447, 0.168, 0.0067)
    fit = fit_law("icr_radius", samples_of(law, np.array([0.4, 0.8, 1.6, 1 / tight])), GEOMETRY)
    assert fit.values["offset"] == pytest.approx(0.0447, abs=1e-6)
    assert fit.values["radius_error"] == pytest.approx(0.0067, abs=1e-6)


@pytest.mark.parametrize("radius", [0.168 + 0.0447, 0.214])
def test_a_sprocket_that_stands_or_nearly_so_has_no_slip(radius):
    law = ConstantIcr(0.0447, 0.168)
    samples = samples_of(law, np.array([0.5, 1 / radius, -1 / radius]))
    assert np.isnan(samples.slip).tolist() == [[False, False], [True, False], [False, True]]
    np.testing.assert_allclose(samples.slip[1, 1], law(1 / radius)[1], rtol=1e-9)


def trace(law, kappa, duration=20.0, omega_after=1.0):
    twist = np.array([0.15, 0.15 * kappa])
    time = np.arange(0, duration, 0.05)
    omega = np.tile(law.sprocket_speeds(twist, GEOMETRY), (time.size, 1))
    omega[time > duration / 2] *= omega_after
    return RunLog(f"{kappa}", time, omega, advance([0, 0, 0], twist, time))


def test_slip_of_traces():
    law = ConstantIcr(0.045, 0.168, 0.01)
    samples = usable_samples([trace(law, kappa) for kappa in KAPPA], GEOMETRY, longest=True).samples
    np.testing.assert_allclose(samples.slip, law(KAPPA), atol=1e-6)
    np.testing.assert_allclose(samples.radius, 1 / KAPPA, rtol=1e-5)
    np.testing.assert_allclose(body_twist(samples.omega, samples.slip, GEOMETRY), samples.twist)


def test_runs_that_are_not_steady_are_refused():
    law = ConstantIcr(0.045, 0.168)
    with pytest.raises(LogError, match="too short"):
        usable_samples([trace(law, 0.5, duration=1.0)], GEOMETRY, longest=True)
    with pytest.raises(LogError, match="has no truth"):
        true_samples([trace(law, 0.5)], GEOMETRY)
    with pytest.raises(InvalidValueError, match="settle"):
        usable_samples([trace(law, 0.5)], GEOMETRY, settle=-1.0, longest=True)


def test_laws_survive_their_file(tmp_path):
    laws = compare_laws(samples_of(PUBLISHED), GEOMETRY).laws
    (tmp_path / "summary.json").write_text(json.dumps(laws_to_json(laws, GEOMETRY)))
    for path in (tmp_path, tmp_path / "summary.json"):
        back = load_laws(path)
        assert back == {name: fit.law for name, fit in laws.items() if fit.values}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("{}", "no slip laws"),
        ('{"geometry": {"half_gauge": "abc", "sprocket_radius": 1}, "slip_laws": {}}', "no slip laws"),
        ("[1, 2]", "no slip laws"),
        (
            '{"geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06},'
            ' "slip_laws": {"icr_radius": {"values": {"offset": 0.04, "radius_error": 1e308}}}}',
            r"icr_radius\.radius_error = 1e\+308: must be from -0\.5 to 0\.5",
        ),
        ('{"geometry": {"half_gauge": 0.1, "sprocket_radius": 0.06}, "slip_laws": {"icr": {"values": {}}}}', "offset"),
        (
            '{"geometry": {"half_gauge": -1, "sprocket_radius": 0.06},'
            ' "slip_laws": {"icr": {"values": {"offset": 0.1}}}}',
            "half_gauge",
        ),
    ],
)
def test_files_without_laws(tmp_path, text, message):
    (tmp_path / "laws.json").write_text(text)
    with pytest.raises(LogError, match=message):
        load_laws(tmp_path / "laws.json")
    with pytest.raises(LogError, match="No such file"):
        load_laws(tmp_path / "none.json")
    (tmp_path / "latin.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(LogError, match="not JSON"):
        load_laws(tmp_path / "latin.json")


def test_laws_of_another_robot_are_refused():
    assert load_laws(SHIPPED, GEOMETRY)
    with pytest.raises(LogError, match=r"the robot has 0\.3 m"):
        load_laws(SHIPPED, RobotGeometry(0.3, 0.06))


def test_the_shipped_laws_are_complete():
    assert set(load_laws(SHIPPED)) >= {"exponential", "icr", "icr_radius"}
