import numpy as np
import pytest
from slip_data import ERRORS, GEOMETRY, RADII, grid

from trackslip.errors import InvalidValueError
from trackslip.identification.comparison import compare_laws
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.identification.sensor import corrected, estimate_sensor, offset_between_sides, with_sensor
from trackslip.se2 import Mounting
from trackslip.slip.icr import ConstantIcr, IcrSides

pytestmark = pytest.mark.usefixtures("few_resamples")
ICR = ConstantIcr(0.045, 0.168, 0.0067)
BOTH = (*RADII, *(-radius for radius in RADII))
MOUNTED = Mounting(x=0.3, y=0.03, yaw=np.radians(5))
_LATERAL_ERROR = 4e-5  # [m/s]


def seen(sensor, law=ICR, *, radii=BOTH, lateral=True, seed=0, errors=ERRORS):
    """Samples of a robot as a sensor measures them, whose own frame moves with it."""
    centre = grid(law, errors=None, radii=radii)
    v, w = centre.twist.T
    ahead, leftward = v - sensor.y * w, sensor.x * w
    cos, sin = np.cos(sensor.yaw), np.sin(sensor.yaw)
    rng = np.random.default_rng(seed)
    noise = rng.multivariate_normal([0, 0], errors, len(v))
    twist = np.column_stack([cos * ahead + sin * leftward, w]) + noise
    sideways = cos * leftward - sin * ahead + rng.normal(0, _LATERAL_ERROR, len(v))
    covariance = np.tile(errors, (len(v), 1, 1))
    found = SlipSamples.of(centre.omega, twist, GEOMETRY, centre.run, covariance)
    if not lateral:
        return found
    return SlipSamples(found.omega, twist, found.slip, found.run, covariance, sideways, np.full(len(v), _LATERAL_ERROR))


@pytest.mark.parametrize("lateral", [True, False])
def test_a_given_sensor_is_undone(lateral):
    truth = grid(ICR, errors=None, radii=BOTH)
    samples = corrected(seen(MOUNTED, lateral=lateral, errors=1e-12 * np.eye(2)), MOUNTED, GEOMETRY)
    np.testing.assert_allclose(samples.twist, truth.twist, atol=2e-5 if lateral else 1e-5)
    np.testing.assert_allclose(samples.slip, truth.slip, atol=1e-3)
    if lateral:
        np.testing.assert_allclose(samples.lateral, 0.0, atol=4 * _LATERAL_ERROR)


@pytest.mark.parametrize("lateral", [True, False])
def test_errors_of_corrected_samples_are_those_of_many_measurements(lateral):
    many = [
        corrected(seen(MOUNTED, lateral=lateral, seed=seed, radii=(0.63,)), MOUNTED, GEOMETRY) for seed in range(400)
    ]
    scatter = np.cov(np.array([samples.twist[-1] for samples in many]).T)
    stated = many[0].covariance[-1]
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)), np.sqrt(np.diag(stated)), rtol=0.12)
    assert scatter[0, 1] == pytest.approx(stated[0, 1], abs=0.2 * np.sqrt(stated[0, 0] * stated[1, 1]))


@pytest.mark.parametrize("sign", [1, -1])
def test_place_and_mounting_are_found_from_turns_to_both_sides(sign):
    sensor = Mounting(sign * 0.3, sign * 0.03, sign * np.radians(5))
    samples, found, notes = with_sensor(seen(sensor), GEOMETRY)
    for name, size in (("x", 1.0), ("y", 1.0), ("yaw", 1.0)):
        error = getattr(found.sensor, name) - getattr(sensor, name)
        assert abs(error) < 4 * size * found.stderr[name]
    assert abs(found.sensor.y - sensor.y) < 0.002
    assert found.reasons == {}
    laws = compare_laws(samples, GEOMETRY)
    assert laws.best == "icr_radius"
    assert laws.laws["icr_radius"].values["offset"] == pytest.approx(0.045, abs=0.001)
    assert laws.laws["icr_radius"].values["radius_error"] == pytest.approx(0.0067, abs=0.0005)
    side = "left" if sign > 0 else "right"
    assert any(f"to the {side} of the middle, if the ICRs of both sides are equal" in note for note in notes)
    assert any(f"° to the {side} of the robot's; corrected" in note for note in notes)


def test_standard_errors_are_the_scatter_of_the_estimates():
    found = [estimate_sensor(seen(MOUNTED, seed=seed), GEOMETRY) for seed in range(40)]
    for name in ("x", "y", "yaw"):
        scatter = np.std([getattr(one.sensor, name) for one in found])
        stated = np.sqrt(np.mean([one.stderr[name] ** 2 for one in found]))
        assert stated == pytest.approx(scatter, rel=0.4)


def test_a_sensor_in_the_middle_stays_there():
    samples = seen(Mounting())
    same, found, notes = with_sensor(samples, GEOMETRY)
    assert same is samples
    assert notes == ()
    assert set(found.stderr) == {"x", "y", "yaw"}


def test_turns_to_one_side_do_not_tell_the_offset_from_the_law():
    samples = seen(MOUNTED, radii=RADII)
    same, found, notes = with_sensor(samples, GEOMETRY)
    assert same is samples
    assert "y" not in found.stderr
    assert any("with turns to one side only, D and an offset of the sensor" in note for note in notes)
    _, found, _ = with_sensor(samples, GEOMETRY, estimate=True)
    assert found.sensor.yaw == pytest.approx(MOUNTED.yaw, abs=4 * found.stderr["yaw"])


def test_circles_of_one_radius_and_missing_lateral_speeds_are_said():
    circles = estimate_sensor(seen(MOUNTED, radii=RADII[:1]), GEOMETRY)
    assert "on circles of one radius" in circles.reasons["yaw"]
    assert circles.sensor == Mounting()
    blind = estimate_sensor(seen(Mounting(y=0.03), lateral=False), GEOMETRY)
    assert "the lateral speed was not measured" in blind.reasons["x"]
    assert blind.sensor.y == pytest.approx(0.03, abs=0.002)


def test_given_or_estimated_but_not_both():
    samples = seen(MOUNTED)
    given, found, notes = with_sensor(samples, GEOMETRY, MOUNTED)
    assert (found, notes) == (None, ())
    np.testing.assert_array_equal(given.twist, corrected(samples, MOUNTED, GEOMETRY).twist)
    assert with_sensor(samples, GEOMETRY, estimate=False) == (samples, None, ())
    with pytest.raises(InvalidValueError, match="estimate_sensor = True"):
        with_sensor(samples, GEOMETRY, MOUNTED, estimate=True)
    with pytest.raises(InvalidValueError, match=r"sensor\.yaw = 3"):
        corrected(seen(Mounting()), Mounting(yaw=3.0), GEOMETRY)


@pytest.mark.parametrize("sign", [1, -1])
def test_icrs_that_differ_are_questioned(sign):
    found = compare_laws(seen(Mounting(y=0.03 * sign)), GEOMETRY)
    law = found.laws["icr_sides"]
    assert offset_between_sides(law)[0] == pytest.approx(0.03 * sign, abs=0.001)
    (doubt,) = (warning for warning in found.warnings if warning.startswith("law icr_sides: D_left and D_right differ"))
    assert f"to the {'left' if sign > 0 else 'right'} of the middle" in doubt
    assert "can't be told apart" in doubt
    assert not any("D_left" in warning for warning in compare_laws(seen(Mounting()), GEOMETRY).warnings)


def test_an_icr_inside_its_track_is_questioned():
    found = compare_laws(grid(ConstantIcr(-0.03, 0.168)), GEOMETRY)
    assert any(warning.startswith(f"law {found.best}: offset = -30.0 ±") for warning in found.warnings)
    sides = fit_law("icr_sides", seen(Mounting(), IcrSides(0.04, 0.05, 0.0, 0.01, 0.168)), GEOMETRY)
    assert offset_between_sides(sides)[0] == pytest.approx(0.005, abs=0.001)
