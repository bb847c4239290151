import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from slip_data import ERRORS, GEOMETRY, RADII, grid

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.samples import SlipSamples, true_samples, usable_samples
from trackslip.identification.source import ReadOptions, read_source
from trackslip.identification.steady import _ranked, compare_laws, fit_law, folds
from trackslip.kinematics import RobotGeometry, advance, track_slip
from trackslip.laws.exponential import PUBLISHED, ExponentialSpeed
from trackslip.laws.icr import ConstantIcr, IcrSides
from trackslip.laws.turn_loss import Centrifugal, TurnLoss, TurnLossSides
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms

ICR = ConstantIcr(0.045, 0.168, 0.0067)
KAPPA = np.array([1.6, 0.8, 0.5, 0.4, 0.3, -1.0, -0.35])
FAST = RobotGeometry(0.28, 0.16)
LOSS = TurnLoss(0.30, 0.28, 0.02, 0.35)
LOG = Path(__file__).parents[3] / "examples/logs/maxxii.csv"


def samples_of(law, kappa=KAPPA, noise=0.0, seed=0):
    twist = np.column_stack([np.full(kappa.size, 0.15), 0.15 * kappa])
    exact = law.sprocket_speeds(twist, GEOMETRY)
    errors = np.random.default_rng(seed).normal(0, noise, exact.shape)
    fastest = np.abs(exact).max(axis=1, keepdims=True)
    names = [str(k) for k in range(kappa.size)]
    return SlipSamples.of(exact + errors * fastest, twist, GEOMETRY, names)


def skidding(law=LOSS, *, count=60, scatter=0.03, rest=0, errors=0.01):
    """Samples of a fast robot, driven at random forwards, backwards and in place, with heavy-tailed
    scatter.
    """
    rng = np.random.default_rng(0)
    size = rng.uniform(0.1, 1, count)
    backwards = rng.random(count) < 0.15
    mean = size * np.where(backwards, -1, 1)
    ratio = rng.uniform(-1.2, 1.2, count)
    shares = np.column_stack([mean * (1 - ratio), mean * (1 + ratio)])
    # belts at 2 m/s
    top_speed = 2.0 / FAST.sprocket_radius
    omega = shares * top_speed / np.maximum(1, np.abs(shares).max(axis=1, keepdims=True))
    omega[:rest, 0] = 0.0

    exact = law.twist(omega, FAST)
    noise = errors * rng.standard_normal((count, 2))
    fastest_belt = FAST.sprocket_radius * np.abs(omega).max(axis=1, keepdims=True)
    tails = np.clip(rng.standard_t(5, (count, 2)), -4, 4)
    of_twist = [1, 1 / (2 * FAST.half_gauge)]
    twist = exact + noise + scatter * fastest_belt * tails * of_twist
    return SlipSamples(
        omega=omega,
        twist=twist,
        slip=track_slip(omega, twist, FAST),
        run=tuple(f"row {k + 1}" for k in range(count)),
        covariance=np.tile(errors**2 * np.eye(2), (count, 1, 1)),
    )


def require_within(fit, law, errors=4.0):
    for key, value in fit.values.items():
        assert abs(value - getattr(law, key)) < errors * fit.stderr[key], key


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("exponential", PUBLISHED),
        ("exponential_speed", ExponentialSpeed(0.07, -0.68, -0.15, -0.63, 0.1, -0.2)),
        ("icr_radius", ICR),
    ],
)
def test_the_law_that_made_the_samples_is_the_best(name, law):
    found = compare_laws(grid(law), GEOMETRY)
    assert found.best == name
    assert [*found.laws].index(name) < 3
    assert "icr_sides" not in found.laws  # turns go one way
    require_within(found.laws[name], law)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("turn_loss_sides", TurnLossSides(0.30, 0.05, -0.02, 0.28, 0.35)),
        ("centrifugal", Centrifugal(0.30, 0.28, 0.02, 0.35, 0.3)),
    ],
)
def test_laws_of_robots_that_skid(name, law):
    found = compare_laws(skidding(law, count=80, scatter=0.01, rest=8), FAST)
    assert found.best == name
    assert {"none", "exponential", "icr"} <= set(found.laws)
    require_within(found.laws[name], law)


def test_left_out_radii_are_predicted_as_well_as_the_law_fits():
    samples = grid(ICR)
    found = compare_laws(samples, GEOMETRY).validation
    right = found["icr_radius"]
    wrong = found["exponential"]
    assert right.slip < np.abs(samples.slip - ICR(samples.curvature)).max()
    assert right.yaw_rate < 3 * ERRORS[1, 1] ** 0.5
    assert wrong.slip > 10 * right.slip
    assert wrong.yaw_rate > 10 * right.yaw_rate
    # by hand: leave out the tightest turns
    tight = samples.radius < 0.9
    rest = fit_law("icr_radius", samples.take(~tight), GEOMETRY)
    # from which Newton's step leaves out as much
    whole = fit_law("icr_radius", samples, GEOMETRY).fit
    _, without_tight = whole.without(tight * 1)
    np.testing.assert_allclose(without_tight, rest.fit.values, rtol=0, atol=1e-6)
    predicted = rest.law.twist(samples.omega[tight], GEOMETRY)
    yaw_rate_error = predicted[:, 1] - samples.twist[tight, 1]
    assert np.abs(yaw_rate_error).max() < 3e-4


@pytest.mark.parametrize(("count", "are_enough"), [(5, False), (6, True)])
def test_laws_are_compared_from_six_runs_on(count, are_enough):
    """As intervals take six independent parts; five have no fewer curvatures than it takes."""
    kappa = np.array([1.6, 0.8, 0.5, 0.4, 0.3, -1.0])[:count]
    found = compare_laws(samples_of(ICR, kappa, noise=1e-4), GEOMETRY)
    assert found.best == "icr_radius"
    assert (found.reason != "the runs are too few to compare laws") == are_enough
    assert bool(found.score) == are_enough


def test_a_run_counts_by_the_inverse_of_its_variance():
    """A law misses precise runs by 1 %, another misses noisy runs by 2 %."""
    exact = samples_of(ICR, np.linspace(-2.0, 2.0, 8))
    speed = GEOMETRY.sprocket_radius * np.abs(exact.omega).max(axis=1)
    is_noisy = np.arange(8) % 2 == 1
    deviation = np.where(is_noisy, 3e-3, 1e-3)  # of each track, relative to the faster sprocket
    # v and w from tracks with equal and independent errors
    of_twist = np.diag([1 / 2, 1 / (2 * GEOMETRY.half_gauge**2)])
    covariance = (deviation * speed)[:, None, None] ** 2 * of_twist
    samples = SlipSamples.of(exact.omega, exact.twist, GEOMETRY, exact.run, covariance)
    laws = {name: fit_law(name, samples, GEOMETRY) for name in ("icr_radius", "turn_loss")}

    def missing(size):
        """Twists that miss both tracks by a share (n,) of the faster sprocket."""
        return samples.twist + np.column_stack([size * speed, np.zeros(8)])

    predicted = {
        "icr_radius": missing(np.where(is_noisy, 0.0, 0.01)),
        "turn_loss": missing(np.where(is_noisy, 0.02, 0.0)),
    }
    # the laws' own scatter counts as 0.1 %: the variances are 2 and 10 in units of 1e-6
    score = _ranked(laws, predicted).score
    assert score["turn_loss"] == pytest.approx(1.0)
    assert score["icr_radius"] == pytest.approx((1**2 / 2) / (2**2 / 10), rel=1e-3)


def test_a_sensor_that_is_turned_on_the_robot_changes_no_speed():
    samples = samples_of(ICR)
    seen = (samples.twist @ [1, 0.2j]) * np.exp(-0.3j)
    twist = np.column_stack([seen.real, samples.twist[:, 1]])
    as_seen = SlipSamples.of(samples.omega, twist, GEOMETRY, samples.run, lateral=seen.imag)
    turned = as_seen.along_robot(GEOMETRY)
    np.testing.assert_allclose(turned.twist, samples.twist)
    assert turned.along_robot(GEOMETRY) is turned


def test_sides_that_differ_are_told_when_turns_go_both_ways():
    sides = IcrSides(0.040, 0.050, 0.005, 0.012, 0.168)
    both = (*RADII, *(-radius for radius in RADII))
    found = compare_laws(grid(sides, radii=both), GEOMETRY)
    assert found.best == "icr_sides"
    require_within(found.laws["icr_sides"], sides)
    assert compare_laws(grid(ICR, radii=both), GEOMETRY).best == "icr_radius"


@pytest.mark.parametrize(("count", "told"), [(2, False), (7, True)])
def test_exact_samples_are_no_trouble(count, told):
    yaw_rate = [0.4, -0.4, 0.1, 0.2, -0.1, 0.3, 0.0]
    twist = np.column_stack([np.full(7, 0.2), yaw_rate])[:count]
    omega = ConstantIcr(0.3, 0.28).sprocket_speeds(twist, FAST)
    no_errors = np.zeros((count, 2, 2)) if told else None
    samples = SlipSamples.of(omega, twist, FAST, list("abcdefg"[:count]), no_errors)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = compare_laws(samples, FAST)
    assert found.laws["icr"].values["offset"] == pytest.approx(0.3, abs=1e-6)


def test_parameters_without_information_are_not_reported():
    law = ConstantIcr(0.045, 0.168, 0.01)
    straight = samples_of(law, np.zeros(8))
    with pytest.raises(LogError, match="don't determine offset"):
        fit_law("icr", straight, GEOMETRY)
    few = compare_laws(samples_of(law, KAPPA[:2], noise=1e-4), GEOMETRY)
    assert {"icr", "icr_radius"} <= set(few.laws) <= {"none", "icr", "icr_radius", "turn_loss"}
    # laws that aren't compared aren't missed, either
    assert few.warnings == ()
    one_radius = grid(ConstantIcr(0.045, 0.168), radii=(0.63,))
    with pytest.raises(LogError, match="it takes runs of different radii"):
        fit_law("exponential", one_radius, GEOMETRY)


def laws_warned_of(found):
    return {warning.partition(":")[0].removeprefix("law ") for warning in found.warnings}


def test_laws_that_cannot_be_fitted_are_named_in_a_comparison():
    """Four turns don't determine laws of four and five parameters."""
    four_turns = samples_of(ICR, np.array([-0.5, -0.2, 0.2, 0.5]), noise=1e-4)
    found = compare_laws(four_turns, GEOMETRY)
    unfitted = laws_warned_of(found)
    assert unfitted
    assert unfitted <= {"exponential", "exponential_speed"}
    assert not unfitted & set(found.laws)


def test_without_a_comparison_only_the_answers_law_is_missed():
    """One sample gives two speeds, which is too few for D and the radius."""
    errors = np.tile(np.diag([1e-6, 1e-6]), (1, 1, 1))
    twist = np.array([[0.15, 0.15]])
    omega = ICR.sprocket_speeds(twist, GEOMETRY)
    one = SlipSamples.of(omega, twist, GEOMETRY, ["a"], errors)
    found = compare_laws(one, GEOMETRY)
    assert found.reason.startswith("laws aren't compared")
    assert found.expressible == "icr"
    assert laws_warned_of(found) == {"icr_radius"}


def test_one_sample_has_no_interval_of_width_0():
    one = SlipSamples.of(np.array([[5.0, 5.0]]), np.array([[0.3, 0.0]]), GEOMETRY, ["a"])
    with pytest.raises(LogError, match="one sample doesn't show its own error: take 4 or more"):
        compare_laws(one, GEOMETRY)


@pytest.mark.parametrize(
    ("noise", "why"),
    [
        (1e-3, "its best value, 0.99, is at a limit"),
        (1e-2, r"it is .* with a standard error of [12](\.\d)?"),
    ],
)
def test_what_stops_a_fit_is_told_in_words(noise, why):
    samples = samples_of(ConstantIcr(0.045, 0.168), KAPPA, noise=noise)
    with pytest.raises(LogError, match=f"the 7 samples don't determine alpha_outer: {why}$"):
        fit_law("exponential_speed", samples, GEOMETRY)


def test_a_law_takes_radii_that_differ_and_errors_that_are_small():
    law = ConstantIcr(0.045, 0.168)
    one_curvature = np.ones(7)
    slightly = np.arange(7)
    for name in ("exponential", "turn_loss"):
        fit_law(name, samples_of(law, 0.5 * (one_curvature + 1e-3 * slightly)), GEOMETRY)
        with pytest.raises(LogError, match="different radii"):  # parameters stand in for each other
            fit_law(name, samples_of(law, 0.5 * (one_curvature + 1e-4 * slightly)), GEOMETRY)
    nearly_straight = np.linspace(-0.01, 0.01, 8)
    fit = fit_law("icr", samples_of(law, nearly_straight, noise=0.001), GEOMETRY)
    assert fit.stderr["offset"] > 0.05
    with pytest.raises(LogError, match="don't determine offset"):  # standard error 0.28 m
        fit_law("icr", samples_of(law, nearly_straight, noise=0.003), GEOMETRY)


@pytest.mark.parametrize("tight", [0.25, 0.19, -0.25])
def test_a_run_tighter_than_the_poles_does_not_trap_the_fit(tight):
    kappa = np.array([0.4, 0.8, 1.6, 1 / tight])
    fit = fit_law("icr_radius", samples_of(ICR, kappa), GEOMETRY)
    true = {"offset": ICR.offset, "radius_error": ICR.radius_error}
    assert fit.values == pytest.approx(true, abs=1e-6)


def trace(kappa, duration=20.0):
    """A run on a circle that stops turning its sprockets for no time."""
    twist = np.array([0.15, 0.15 * kappa])
    time = np.arange(0, duration, 0.05)
    omega = np.tile(ICR.sprocket_speeds(twist, GEOMETRY), (time.size, 1))
    return RunLog(f"{kappa}", time, omega, advance([0, 0, 0], twist, time))


@pytest.mark.parametrize(
    ("do", "error", "match"),
    [
        (
            lambda: fit_law("exponential", samples_of(PUBLISHED, KAPPA[:2]), GEOMETRY),
            LogError,
            "its 4 parameters",
        ),
        (
            lambda: fit_law("cubic", samples_of(PUBLISHED), GEOMETRY),
            InvalidValueError,
            "one of none, exponential",
        ),
        (
            lambda: usable_samples([trace(0.5, duration=1.0)], GEOMETRY, longest=True),
            LogError,
            "too short",
        ),
        (lambda: usable_samples([trace(0.5)], GEOMETRY, settle=-1.0), InvalidValueError, "settle"),
        (lambda: true_samples([trace(0.5)], GEOMETRY), LogError, "has no truth"),
        (lambda: sample([0.0, 0.0], [0.1, 0.1]), LogError, "run 'odd': the sprockets stand still"),
    ],
)
def test_what_can_not_be_used_is_refused(do, error, match):
    with pytest.raises(error, match=match):
        do()


def sample(omega, twist, geometry=GEOMETRY, yaw_stderr=None):
    """One sample, of a run called odd; the standard error of its yaw rate may be known."""
    covariance = None
    if yaw_stderr is not None:
        covariance = np.diag([1e-8, yaw_stderr**2])[None]
    return SlipSamples.of(np.array([omega]), np.array([twist]), geometry, ["odd"], covariance)


def test_a_yaw_rate_within_its_error_shows_no_swapped_tracks():
    omega = [2.0, 3.0]
    twist = [0.15, -0.05]
    with pytest.raises(LogError, match="left and right, and the signs"):
        sample(omega, twist, yaw_stderr=0.001)
    assert len(sample(omega, twist, yaw_stderr=0.05)) == 1


def as_it_is(omega):
    return omega


@pytest.mark.parametrize(
    ("wheels", "units"),
    [
        pytest.param(lambda omega: omega[::-1], (1, 1), id="sides"),
        pytest.param(lambda omega: omega * (-1, 1), (1, 1), id="left reversed"),
        pytest.param(lambda omega: omega * (1, -1), (1, 1), id="right reversed"),
        pytest.param(lambda omega: omega * (-1, -1), (1, 1), id="both reversed"),
        pytest.param(lambda omega: omega * 180 / np.pi, (1, 1), id="deg/s"),
        pytest.param(lambda omega: omega * 30 / np.pi, (1, 1), id="rpm"),
        pytest.param(lambda omega: omega * 30, (1, 1), id="gear"),
        pytest.param(as_it_is, (1000, 1), id="mm"),
        pytest.param(as_it_is, (100, 1), id="cm"),
        pytest.param(as_it_is, (1, 180 / np.pi), id="degrees"),
    ],
)
def test_other_sides_signs_and_units_are_noticed(wheels, units):
    v, w = twist = np.array([0.2, 0.1])
    omega = (v + np.array([-1, 1]) * 0.21 * w) / 0.06
    match = (
        r"moves at .* but its sprockets say .*: check the units .* the gear, sprocket_radius "
        r"= 0\.06 m, left and right"
    )
    with pytest.raises(LogError, match=match):
        sample(wheels(omega), twist * units)


def test_real_left_out_radii_are_as_good_as_by_least_squares():
    source = read_source(LOG, ReadOptions(half_gauge=0.303, sprocket_radius=0.0856))
    samples = source.sampling.samples
    geometry = source.geometry
    found = compare_laws(samples, geometry)
    radii = folds(samples.by_command(geometry))

    def missed(values, rows):
        offset, radius_error = values
        law = ConstantIcr(offset, geometry.half_gauge, radius_error)
        return (law.twist(samples.omega[rows], geometry) - samples.twist[rows]).ravel()

    left_out = np.empty_like(samples.twist)
    for radius in range(radii.max() + 1):
        rows = radii == radius
        values = least_squares(missed, [0.1, 0.0], args=(~rows,)).x
        left_out[rows] = missed(values, rows).reshape(-1, 2)
    plain = rms(left_out[:, 1])
    plain = rms(left_out[:, 1])
    assert found.validation[found.best].yaw_rate <= plain
    # the same two numbers, otherwise weighted
    assert found.validation["icr_radius"].yaw_rate <= plain
    assert plain < found.validation["none"].yaw_rate / 2


def test_repeats_of_a_command_are_no_independent_evidence():
    """Of eight commands, each driven eight times, one says that a law is better, one that it is
    worse.
    """
    kappa = np.repeat(0.3 * np.arange(1, 9), 8)
    samples = samples_of(ICR, kappa, noise=1e-4)
    laws = {name: fit_law(name, samples, GEOMETRY) for name in ("icr_radius", "turn_loss")}
    wrong = np.full((len(samples), 2), 0.01)
    better = wrong.copy()
    better[:8] = 0.0
    better[8:16] *= 1.2
    predicted = {"icr_radius": samples.twist + wrong, "turn_loss": samples.twist + better}
    assert _ranked(laws, predicted).best == "icr_radius"


def test_standard_errors_are_those_of_commands_left_out():
    """Eight commands, each with an error of its own that repeating doesn't average out: the errors
    are those of a jackknife over commands, with refits, however often they are repeated.
    """
    once = samples_of(ICR, 0.3 * np.arange(1, 9), noise=1e-3)
    first = fit_law("icr_radius", once, GEOMETRY)
    command = np.repeat(np.arange(8), 8)
    repeated = once.take(command)
    fit = fit_law("icr_radius", repeated, GEOMETRY)
    apart = []
    for left_out in range(8):
        rest = repeated.take(np.flatnonzero(command != left_out))
        refit = fit_law("icr_radius", rest, GEOMETRY)
        apart.append([refit.values[name] - fit.values[name] for name in fit.stderr])
    jackknife = np.sqrt((1 - 1 / 8) * np.sum(np.square(apart), axis=0))
    np.testing.assert_allclose([*fit.stderr.values()], jackknife, rtol=0.01)
    # driven once, they are at least as large: of the offset, the scatter says more
    assert all(first.stderr[name] >= 0.99 * fit.stderr[name] for name in fit.stderr)
