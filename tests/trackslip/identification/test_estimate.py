from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy
from drives import EXACT, GEOMETRY, ICR, NOISE, SLAM, STILL, constant_speeds, drive_log, held, without_poses

from sim.wander.pose_source import PoseSource
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.drive_equations import solve
from trackslip.identification.drive_law import clock_profile, fit_drives
from trackslip.identification.drive_residuals import Noise
from trackslip.identification.drives import drive_of
from trackslip.identification.intervals import stretch_ends
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, drive_laws
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.turn_loss import TurnLoss, TurnLossSides

GNSS = PoseSource(rate=5.0, position_noise=0.05, heading=False)
MOUNTED = replace(SLAM, ahead=0.3, left=0.1, mounting=np.radians(5), delay=0.15)
TRUTH = {"offset": ICR.offset, "radius_error": ICR.radius_error}
SLOW_GNSS = pytest.param(GNSS, marks=pytest.mark.slow)
PLACE = {"sensor_x": 0.3, "sensor_y": 0.1, "sensor_yaw": np.radians(5), "clock_offset": -0.15}


def unlagged(logs, sensor=None):
    """A fit without a search for a lag, which takes as long again."""
    return fit_drives("icr_radius", logs, GEOMETRY, sensor, held={"lag": 0.0})


@cache
def fitted(seed, duration=40.0, source=SLAM):
    return unlagged([drive_log(seed, duration, source)])


def bound(found, noise=NOISE):
    """Cramér-Rao bounds of the fitted parameters, by name, from the information at the true noise."""
    fit, driven = found.fit, found.fit.model
    pull = np.zeros(len(fit.values))
    at = solve(fit.residuals, fit.nodes, Noise(noise), driven.index("sensor_yaw"), driven.prior, pull)
    return dict(zip(found.free, np.sqrt(np.diag(np.linalg.inv(at.information))).tolist(), strict=True))


def within(found, names=TRUTH, sizes=4.0, noise=NOISE):
    """Whether parameters are within some bounds of their true values."""
    true, bounds = TRUTH | PLACE, bound(found, noise)
    values = found.values | found.extras
    return {name: abs(values[name] - true[name]) < sizes * bounds[name] for name in names}


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("icr_radius", ICR),
        ("icr_radius", ConstantIcr(-0.02, 0.168, -0.03)),
        ("turn_loss", TurnLoss(0.1, 0.168, 0.01, 0.4)),
        ("turn_loss_sides", TurnLossSides(0.1, 0.03, -0.02, 0.168, 0.4)),
    ],
)
def test_motion_without_noise_gives_the_law_exactly(name, law):
    found = fit_drives(name, [drive_log(1, 30, EXACT, STILL, law)], GEOMETRY)
    assert found.converged
    for key, value in found.values.items():
        assert value == pytest.approx(getattr(law, key), abs=1e-6)
    for key, value in found.extras.items():
        assert value == pytest.approx(0, abs=1e-4 if key == "drift" else 1e-5)


def test_place_mounting_and_clock_are_found_with_the_law():
    found = unlagged([drive_log(1, 40, MOUNTED)])
    assert all(within(found, (*TRUTH, *PLACE)).values())
    assert not set(found.held) & {*TRUTH, *PLACE}
    exact = replace(EXACT, ahead=0.3, left=0.1, mounting=np.radians(5), delay=0.15)
    found = unlagged([drive_log(1, 30, exact, STILL, drift=0.1, turning_centre=-0.05)])
    place = PLACE | TRUTH | {"sensor_x": 0.35, "drift": 0.1}
    for key, value in place.items():
        assert (found.values | found.extras)[key] == pytest.approx(value, abs=1e-4), key


def test_a_given_sensor_is_held_and_improves_the_rest():
    log = drive_log(1, 30, MOUNTED)
    sensor = Mounting(0.3, 0.1, np.radians(5))
    given = unlagged([log], sensor)
    assert {key for key, why in given.held.items() if why == "given"} == {"sensor_y", "sensor_yaw", "lag"}
    assert given.extras["sensor_y"] == 0.1
    assert given.stderr["radius_error"] < unlagged([log]).stderr["radius_error"]


def test_a_lag_is_fitted_where_it_shows_and_taken_up_by_the_clock_where_it_is_held_at_0():
    log = drive_log(2, 30, EXACT, STILL, lag=0.08)
    found = fit_drives("icr_radius", [log], GEOMETRY)
    assert found.extras["lag"] == pytest.approx(0.08, abs=2e-3)
    assert found.extras["clock_offset"] == pytest.approx(0, abs=2e-3)
    assert found.values["offset"] == pytest.approx(ICR.offset, abs=1e-4)
    behind = unlagged([log])
    assert behind.held["lag"] == "given"
    assert behind.extras["clock_offset"] == pytest.approx(-0.08, abs=0.01)


def test_a_robot_without_lag_shows_none():
    found = fit_drives("icr_radius", [drive_log(1, 30)], GEOMETRY)
    assert found.held["lag"] == "none shows"
    assert found.extras["lag"] == 0.0


@pytest.mark.parametrize("source", [SLAM, SLOW_GNSS])
def test_errors_are_those_of_the_bound_and_intervals_cover(source):
    noise = NOISE if source is SLAM else np.array([0.05, 1.0, *NOISE[2:]])
    found = [fitted(seed, 40.0 if source is SLAM else 120.0, source) for seed in range(4)]
    for name, true in TRUTH.items():
        errors = [(one.values[name] - true) / bound(one, noise)[name] for one in found]
        assert np.sum(np.square(errors)) < scipy.stats.chi2.ppf(0.9999, len(errors))
        inside = [one.interval95[name][0] < true < one.interval95[name][1] for one in found]
        assert sum(inside) >= 2  # less has a chance of 0.1 %


@pytest.mark.slow
def test_sixty_errors_are_those_of_the_bound_and_intervals_cover():
    found = [fitted(seed, 120.0) for seed in range(60)]
    for name, true in TRUTH.items():
        errors = np.array([(one.values[name] - true) / bound(one)[name] for one in found])
        low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], len(errors)) / len(errors)
        assert low < np.mean(errors**2) < high
        inside = np.mean([one.interval95[name][0] < true < one.interval95[name][1] for one in found])
        assert inside >= 0.9


def test_noise_is_found_to_within_its_sampling_error():
    """REML: squares of the poses' noise scatter by sqrt(2 / n), those of slip much more: each pose hides it."""
    found = [fitted(seed) for seed in range(4)]
    mean = {key: np.mean([one.noise[key] ** 2 for one in found]) for key in Noise.NAMES[:5]}
    poses = sum(one.poses for one in found)
    assert mean["position"] == pytest.approx(NOISE[0] ** 2, rel=4 * np.sqrt(2 / (2 * poses)) + 0.02)
    assert mean["heading"] == pytest.approx(NOISE[1] ** 2, rel=4 * np.sqrt(2 / poses) + 0.02)
    sharp = PoseSource(rate=20.0, position_noise=0.002, heading_noise=np.radians(0.25))
    clear = unlagged([drive_log(1, 30, sharp)])
    for key, true in zip(Noise.NAMES[2:5], NOISE[2:5], strict=True):
        assert clear.noise[key] == pytest.approx(true, rel=0.35)


def test_poses_are_noisier_in_motion_where_their_stamps_jitter():
    """Jitter moves a pose along the path only: part of that may look like slip along it."""
    still = PoseSource(rate=20.0, position_noise=5e-4, heading_noise=5e-4)
    for jitter in (0.0, 0.01):
        found = unlagged([drive_log(1, 40, replace(still, jitter=jitter))])
        assert found.noise["position"] == pytest.approx(5e-4, rel=0.2)
        assert 0.2 * jitter < found.noise["position_by_speed"] < 2e-3 + jitter / np.sqrt(2)
        assert found.noise["heading_by_yaw_rate"] == pytest.approx(jitter, rel=0.2, abs=2e-3)
        assert found.left_out < 0.01 * found.poses


@pytest.mark.parametrize("seed", [1, 2])
def test_poses_that_are_noisier_in_motion_do_not_draw_the_clocks_profile_to_where_the_robot_is_faster(seed):
    speeds = np.array([[0.02, 0.05], [0.3, 0.2], [0.05, 0.02], [0.2, 0.3], [0.3, 0.3], [0.02, 0.02]])
    found = unlagged([drive_log(seed, driving=np.tile(speeds.repeat(100, axis=0), (4, 1)))])
    noisier = replace(found.fit, noise=Noise(np.append(found.fit.noise.values[:5], [0.3, 0.3])))
    profile = clock_profile(noisier)
    assert (
        abs(profile.offset[profile.rise.argmin()] - found.extras["clock_offset"]) < 0.5 * found.stderr["clock_offset"]
    )


def test_a_vague_value_that_is_no_chance_is_not_held():
    found = unlagged([drive_log(0, 6, law=ConstantIcr(0.045, 0.168, -0.25))])
    assert 0.03 < found.stderr["radius_error"] < 0.07
    assert found.values["radius_error"] == pytest.approx(-0.25, abs=2 * found.stderr["radius_error"])


def as_logged(log, period):
    """A log as a robot writes it that reads its encoders every `period` [s] and logs the last readings."""
    return replace(log, omega=held(log.time, log.omega, period, (0.0, period / 2)))


def counted_in_ticks(log, ticks):
    """A log of encoders with so many ticks a turn."""
    step, tick = np.diff(log.time)[:, None], 2 * np.pi / ticks
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(log.omega[1:] * step, axis=0)])
    return replace(log, omega=np.concatenate([np.zeros((1, 2)), np.diff(np.floor(angle / tick) * tick, axis=0) / step]))


@pytest.mark.parametrize("logged", [lambda log: as_logged(log, 0.2), lambda log: counted_in_ticks(log, 64)])
@pytest.mark.parametrize("seed", [0, 1])
def test_readings_that_are_rare_or_coarse_show_no_lag(logged, seed):
    source = PoseSource(rate=20.0, position_noise=0.002, heading_noise=np.radians(0.25))
    found = fit_drives("icr_radius", [logged(drive_log(seed, 60, source))], GEOMETRY)
    assert "lag" in found.held
    for name, true in TRUTH.items():
        low, high = found.interval95[name]
        assert abs(found.values[name] - true) < high - low  # 4 standard errors
    assert found.stderr["offset"] < 4e-4


@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_fast_poses_show_the_lag_there_is_and_no_other(lag):
    source = PoseSource(rate=180.0, position_noise=0.002, heading_noise=np.radians(0.2))
    found = fit_drives("icr_radius", [drive_log(1, 90, source, lag=lag)], GEOMETRY)
    assert found.interval95["clock_offset"][0] < 0 < found.interval95["clock_offset"][1]
    if lag:
        assert found.interval95["lag"][0] < lag < found.interval95["lag"][1]
    else:
        assert found.held["lag"] == "none shows"


def test_short_drives_in_a_row_make_the_stretches_of_intervals():
    log = drive_log(2, 60)
    parts = [replace(log.between(k, k + 140), run=f"part {k}") for k in range(0, len(log.time) - 140, 140)]
    fit = unlagged(parts).fit
    cuts = stretch_ends(fit, 6)
    assert len(parts) > 20
    assert len(cuts) == pytest.approx(6, abs=1)
    assert set(cuts) <= set(fit.nodes.first[1:] - 1)
    assert np.diff(fit.nodes.time[cuts]).min() > 5.0


def test_the_optimum_is_where_the_gradient_vanishes():
    found = fitted(1)
    step = found.fit.solution
    error = np.sqrt(np.diag(found.fit.covariance))
    assert np.abs(step.values / error).max() < 0.05


@pytest.mark.parametrize("source", [SLAM, SLOW_GNSS])
@pytest.mark.parametrize(("offset", "delay"), [(-0.05, -1.8), (0.5, 1.8), (0.0, 0.9)])
def test_far_starts_are_found(source, offset, delay):
    law = ConstantIcr(offset, 0.168)
    duration = 40.0 if source is SLAM else 120.0
    found = unlagged([drive_log(4, duration, replace(source, delay=delay), law=law)])
    assert found.values["offset"] == pytest.approx(offset, abs=max(5 * found.stderr["offset"], 1e-3))
    assert found.extras["clock_offset"] == pytest.approx(-delay, abs=5 * found.stderr["clock_offset"])


def test_outlying_poses_are_left_out():
    found = unlagged([drive_log(5, 40, replace(SLAM, outliers=0.05))])
    assert 10 < found.left_out < 50
    assert all(within(found).values())


def test_a_lasting_jump_is_a_step_that_is_left_out():
    found = unlagged([drive_log(6, 40, replace(SLAM, jumps=1, jump_size=0.5, jump_turn=0.2))])
    assert found.breaks == 1
    (broken,) = np.flatnonzero(found.fit.nodes.link == 0)
    pose = found.fit.nodes.pose
    assert np.hypot(*(pose[broken + 1] - pose[broken])[:2]) > 0.4
    assert found.left_out < 0.05 * found.poses
    assert all(within(found).values())


def test_gaps_and_held_poses_do_no_harm():
    log = drive_log(7, 40)
    gap = (log.time > 15) & (log.time < 20)
    found = unlagged([without_poses(log, gap)])
    assert all(within(found).values())
    pose = log.pose.copy()
    seen = np.flatnonzero(log.is_valid)
    pose[seen[1::3]] = pose[seen[:-1:3]][: len(seen[1::3])]  # each third pose repeats the one before
    driven = drive_of(replace(log, pose=pose))
    moving = np.abs(log.omega).max(axis=1)[seen[1::3]] > 0.1
    assert not set(seen[1::3][moving]) & set(driven.rows)
    assert all(within(unlagged([replace(log, pose=pose)])).values())


def test_a_robot_at_rest_for_a_while_does_no_harm():
    speeds = np.tile(np.array([[0.1, 0.2], [0.0, 0.0], [0.2, 0.05], [0.2, 0.2]]), (2, 1)).repeat(250, axis=0)
    found = unlagged([drive_log(8, driving=speeds)])
    assert all(within(found).values())


@pytest.mark.slow
def test_several_drives_have_their_joint_information():
    logs = [drive_log(seed, 40) for seed in (1, 2, 3)]
    found = unlagged(logs)
    alone = [fitted(seed) for seed in (1, 2, 3)]
    bounds = [bound(one) for one in alone]
    for name in TRUTH:
        joint = sum(one[name] ** -2 for one in bounds) ** -0.5
        assert bound(found)[name] == pytest.approx(joint, rel=0.15)
    assert all(within(found).values())


@pytest.mark.parametrize(
    ("speeds", "held", "known", "true"),
    [
        ((0.2, 0.2), "offset", "radius_error", ICR.radius_error),
        ((-0.2, 0.2), "radius_error", "offset", 0.213 / 1.0066 - 0.168),  # both turn faster
        ((0.1, 0.2), "sensor_y", "offset", ICR.offset),
    ],
)
def test_what_the_driving_does_not_tell_is_held_at_0_and_said(speeds, held, known, true):
    found = unlagged([drive_log(1, driving=constant_speeds(*speeds))])
    assert (found.values | found.extras)[held] == 0.0
    assert found.held[held].startswith("not determined: the driving ")
    assert held not in found.stderr
    assert held not in found.interval95
    assert found.values[known] == pytest.approx(true, abs=4 * found.stderr[known])


def test_without_headings_the_mounting_is_held():
    found = unlagged([drive_log(1, 20, GNSS)])
    assert found.held["sensor_yaw"] == "no headings were measured"
    assert found.extras["sensor_yaw"] == 0.0


@pytest.mark.slow
def test_a_drive_without_headings_among_others():
    logs = [drive_log(1, 40), drive_log(2, 40), drive_log(3, 40, replace(SLAM, heading=False))]
    found = unlagged(logs)
    assert "sensor_yaw" not in found.held
    assert all(within(found).values())


def test_drives_that_tell_nothing_are_refused():
    straight = drive_log(1, driving=constant_speeds(0.2, 0.2))
    with pytest.raises(LogError, match=r"^the drives determine no parameter of the law: "):
        fit_drives("icr", [straight], GEOMETRY)
    with pytest.raises(InvalidValueError, match="cubic"):
        fit_drives("cubic", [straight], GEOMETRY)


@pytest.mark.parametrize("source", [SLAM, SLOW_GNSS])
def test_swapped_tracks_and_reversed_encoders_are_said(source):
    log = drive_log(3, 40, source, driving="eights")
    for omega in (log.omega[:, ::-1], -log.omega):
        with pytest.raises(LogError, match="turns against its sprockets: are the tracks swapped"):
            unlagged([replace(log, omega=omega)])


@pytest.mark.parametrize("driving", ["random", "loop"])
def test_an_encoder_that_counts_backwards_is_named(driving):
    log = drive_log(3, 20, driving=driving)
    for side, sign in (("left", [-1, 1]), ("right", [1, -1])):
        with pytest.raises(LogError, match=f"encoder of the {side} sprocket counted backwards"):
            unlagged([replace(log, omega=log.omega * sign)])


def test_wild_readings_and_motion_unlike_the_sprockets_are_said():
    log = drive_log(3, 20)
    omega = log.omega.copy()
    omega[100, 1] = 1e6
    with pytest.raises(LogError, match="omega_r = 1e\\+06 rad/s in its row 101, at most 10000 is allowed"):
        unlagged([replace(log, omega=omega)])
    other = replace(log, omega=np.sin(np.outer(log.time, [0.5, 0.7])) * 5)
    with pytest.raises(
        LogError, match=r"hardly follows the sprockets \(slip_.* = .* are units, gear, signs and clocks"
    ):
        unlagged([other])


@pytest.mark.parametrize("name", drive_laws())
def test_every_law_is_fitted_from_the_trajectory_of_the_reference(name):
    found = fit_drives(name, [drive_log(1, 40)], GEOMETRY, reference=fitted(1))
    assert found.name == name
    assert tuple(found.values) == FAMILIES[name].names
    assert found.fit.nodes is fitted(1).fit.nodes
    assert np.isfinite(list(found.stderr.values())).all()
    assert np.isfinite(found.deviance)
    assert found.correlation.shape == (len(found.free),) * 2
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    for key, (low, high) in found.interval95.items():
        half = scipy.stats.norm.ppf(0.975) * found.stderr[key]
        value = (found.values | found.extras)[key]
        assert low <= value - half + 1e-12
        assert high >= value + half - 1e-12


def test_the_simpler_law_is_never_likelier():
    logs, reference = [drive_log(1, 40)], fitted(1)
    deviance = {
        name: fit_drives(name, logs, GEOMETRY, reference=reference).deviance for name in ("none", "icr", "icr_radius")
    }
    assert deviance["none"] > deviance["icr"] > deviance["icr_radius"] - 1
