from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log

from sim.wander.motion import WHITE
from trackslip.identification.comparison import compare_drives
from trackslip.identification.drive_law import fit_drives
from trackslip.identification.drive_prediction import HORIZONS, DrivePredictions, ScoredPairs, best_of_drives, held_out
from trackslip.identification.drive_residuals import Nodes
from trackslip.identification.drives import drive_of, drives_of
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.turn_loss import Centrifugal, TurnLossSides

MOUNTED = replace(EXACT, ahead=0.2, left=0.05, mounting=0.1)


@cache
def exact(name="icr_radius", heading=True):
    return fit_drives(name, [drive_log(1, 40, replace(MOUNTED, heading=heading), STILL)], GEOMETRY)


def test_an_exact_law_predicts_motion_without_noise():
    errors = held_out(exact().fit).errors()
    assert tuple(errors) == HORIZONS
    for one in errors.values():
        assert one.position_rms < 1e-4
        assert one.heading_rms < 1e-4
        assert one.position_median <= one.position_rms * 2


def test_without_compensation_headings_are_missed():
    errors = held_out(fit_drives("none", [drive_log(1, 40, MOUNTED, STILL)], GEOMETRY, reference=exact()).fit).errors()
    assert min(one.heading_rms for one in errors.values()) > 0.03
    assert errors[2.0].heading_rms > errors[1.0].heading_rms


def test_predictions_are_of_the_second_half_alone_and_of_their_horizon():
    fit = exact().fit
    found = held_out(fit)
    assert found.start.min() >= len(fit.nodes.time) // 2
    assert set(found.horizon) == set(HORIZONS)
    for horizon in HORIZONS:
        last = fit.nodes.time[found.start[found.horizon == horizon]].max()
        assert last + horizon <= fit.nodes.time[-1] + 0.051


def test_each_drive_is_predicted_by_the_others():
    logs = [drive_log(seed, 15, MOUNTED, STILL) for seed in range(6)]
    found = fit_drives("icr_radius", logs, GEOMETRY)
    predicted = held_out(found.fit)
    drive = np.searchsorted(found.fit.nodes.first, predicted.start, side="right") - 1
    assert set(drive) == set(range(6))
    assert max(one.position_rms for one in predicted.errors().values()) < 1e-4


def test_folds_and_horizons_may_be_given():
    logs = [drive_log(seed, 15, MOUNTED, STILL) for seed in range(4)]
    found = fit_drives("icr_radius", logs, GEOMETRY)
    pairs = ScoredPairs.of(found.fit, (0.5, 1.8), np.array([0, 0, 1, 0]))
    assert set(pairs.horizon) == {0.5, 1.8}
    predicted = held_out(found.fit, pairs)
    assert len(predicted.values) == 2
    np.testing.assert_array_equal(predicted.part, pairs.drive == 2)
    assert tuple(predicted.errors()) == (0.5, 1.8)


def test_lasting_jumps_are_not_predicted_across():
    log = drive_log(2, 40, replace(SLAM, jumps=3, jump_size=1.0))
    fit = fit_drives("icr_radius", [log], GEOMETRY).fit
    broken = fit.nodes.time[np.flatnonzero(fit.nodes.link == 0)]
    assert len(broken) == 3
    found = held_out(fit)
    begin = fit.nodes.time[found.start]
    for jump in broken:
        assert not ((begin <= jump) & (begin + found.horizon > jump + 0.11)).any()
    assert np.hypot(found.error[:, 0], found.error[:, 1]).max() < 0.5


def test_without_headings_positions_are_predicted_from_the_trail():
    errors = held_out(exact(heading=False).fit).errors()
    assert set(errors) <= set(HORIZONS)
    assert len(errors) > 1
    for one in errors.values():
        assert one.position_rms < 1e-3
        assert one.heading_rms is None
        assert one.heading_median is None


def test_robots_that_stand_are_not_predicted_and_outlying_poses_are():
    driving = constant_speeds(0.1, 0.15, 40.0)
    driving[500:] = 0.0  # from 10 s on
    moving = drive_log(1, 40, EXACT, STILL, driving=constant_speeds(0.1, 0.15, 40.0))
    moving.pose[np.flatnonzero(moving.is_valid)[100], :2] += 0.2  # a pose that jumps away and back
    standing = replace(drive_log(2, 40, EXACT, STILL, driving=driving), run="stands")
    fit = fit_drives("icr_radius", [moving, standing], GEOMETRY).fit
    pairs = ScoredPairs.of(fit)
    nodes = fit.nodes
    assert (nodes.weight[:, 0] == 0).sum() == 1
    left_out = int(np.flatnonzero(nodes.weight[:, 0] == 0)[0])
    assert left_out in pairs.start
    assert left_out in pairs.end
    late = pairs.start[pairs.start >= nodes.first[1]] - nodes.first[1]
    assert nodes.drives[1].time[late].max() < 10.1
    assert len(late) > 100
    errors = held_out(fit).errors()[1.0]
    assert errors.count == (pairs.horizon == 1.0).sum()
    assert errors.position_median < errors.position_p90 < errors.position_rms


def test_what_the_robot_has_today_knows_no_delay_and_no_gains():
    late = replace(EXACT, delay=0.3)
    drives = [drive_of(drive_log(seed, 30, late, STILL, law=ConstantIcr(0.08, 0.168, -0.1))) for seed in (1, 2)]
    found = compare_drives(drives, GEOMETRY, names=("none", "icr_radius"))
    today, gains, none, best = (found.errors[name][2.0] for name in ("today", "two_gains", "none", "icr_radius"))
    assert list(found.errors)[:2] == ["today", "two_gains"]
    assert best.position_rms < 1e-3 < none.position_rms < today.position_rms
    assert best.heading_rms < gains.heading_rms < none.heading_rms
    timely = compare_drives([drive_of(drive_log(1, 30, EXACT, STILL))], GEOMETRY, names=("icr_radius",))
    assert timely.errors["two_gains"][2.0].position_rms < 0.002


def predictions(size, seed=0):
    """Predictions of a law whose errors at horizons are `size`; 200 pairs of 20 drives at each."""
    rng = np.random.default_rng(seed)
    error = np.concatenate([one * np.abs(rng.normal(1.0, 0.2, (200, 3))) for one in size])
    pairs = paired()
    none = np.zeros(len(error))
    return DrivePredictions(pairs.start, none, pairs.horizon, error, none.astype(int), np.zeros((1, 0)))


def paired():
    drives = [drive_of(drive_log(1, 2.0, EXACT, STILL, driving=constant_speeds(0.1, 0.1, 2.0)))] * 20
    start = np.tile(np.repeat(np.arange(20) * len(drives[0].time), 10), len(HORIZONS))
    return ScoredPairs(Nodes.of(drives), start, start + 1, np.repeat(HORIZONS, 200))


FREE = {"simple": 1, "rich": 4}


def test_the_best_law_has_the_smallest_errors_at_most_horizons():
    laws = {"simple": predictions((1.0, 1.0, 1.0, 2.0)), "rich": predictions((0.9, 0.9, 0.9, 9.0), 1)}
    best, why, score = best_of_drives(laws, FREE, paired())
    assert best == "rich"
    assert why == "rich has the smallest errors at 3 of 4 horizons"
    assert score["simple"] < score["rich"]  # 10 s would decide a mean


def test_of_laws_that_differ_by_chance_the_simpler_is_best():
    rich, simple = predictions((1.0,) * 4), predictions((1.0,) * 4)
    chance = np.random.default_rng(2).normal(0.0, 0.05, simple.error.shape)
    simple.error[:] += chance - chance.mean(axis=0)
    best, why, _ = best_of_drives({"rich": rich, "simple": simple}, FREE, paired())
    assert best == "simple"
    assert "simple is as good at" in why or why.startswith("simple has")
    simple.error[:] += 0.02
    best, why, _ = best_of_drives({"rich": rich, "simple": simple}, FREE, paired())
    assert (best, why) == ("rich", "rich has the smallest errors at 4 of 4 horizons")


def test_one_wrong_pose_does_not_choose_the_law():
    laws = {"rich": predictions((1.0,) * 4), "simple": predictions((1.2,) * 4, 1)}
    laws["rich"].error[0, :2] += [1000.0, 0.2]  # equal but for what the laws predict
    laws["simple"].error[0, :2] += [1000.0, 0.0]
    assert best_of_drives(laws, FREE, paired())[0] == "rich"


def test_of_laws_that_predict_equally_well_the_simplest_is_best():
    """Motion exactly by icr_radius: icr_sides and turn_loss contain it; none and icr don't."""
    drives, refused = drives_of([drive_log(1, 40)])
    assert refused == []
    seen = []
    names = ("none", "icr", "icr_radius", "icr_sides", "turn_loss")
    found = compare_drives(drives, GEOMETRY, names=names, step=seen.append)
    assert seen == [1.0] * len(names)
    assert found.best in ("icr", "icr_radius")
    assert set(found.ranking) == set(names)
    assert found.ranking[-1] == "none"
    assert found.score["none"] > 2
    assert found.clock is not None
    middle = np.argmin(found.clock.rise)
    assert abs(middle - len(found.clock.offset) // 2) <= 1
    half = found.laws[found.best].stderr["clock_offset"]
    np.testing.assert_allclose(found.clock.rise[[0, -1]], 36, rtol=0.5)  # six standard errors
    assert found.clock.offset[-1] - found.clock.offset[0] == pytest.approx(12 * half)


def test_the_best_law_of_motion_without_noise_is_the_simplest_exact_one():
    drives = [drive_of(drive_log(1, 30, EXACT, STILL))]
    found = compare_drives(drives, GEOMETRY, names=("none", "icr", "icr_radius", "icr_sides", "turn_loss"))
    assert found.best == "icr_radius"


def fast_drive(law, source=SLAM, variation=WHITE):
    """A drive of 40 s at belt speeds up to 2 m/s, changed every second."""
    speeds = np.random.default_rng(0).uniform(-1, 2, (41, 2))
    time = np.arange(2001) / 50
    driving = np.stack([np.interp(time, np.arange(41), side) for side in speeds.T], axis=-1)
    return drive_of(drive_log(1, 40, source, variation, law, driving))


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("turn_loss_sides", TurnLossSides(0.1, 0.03, -0.02, 0.168, 0.4)),
        ("centrifugal", Centrifugal(0.1, 0.168, 0.01, 0.4, 0.3)),
    ],
)
def test_unequal_sides_and_skidding_are_found_in_drives_within_errors(name, law):
    found = compare_drives(
        [fast_drive(law)], GEOMETRY, names=("icr_radius", "turn_loss", "turn_loss_sides", "centrifugal")
    )
    assert found.best == name
    fit = found.laws[name]
    for key, value in fit.values.items():
        assert value == pytest.approx(getattr(law, key), abs=4 * fit.stderr[key])
    assert "sensor_y" in fit.free  # D is the same on both sides


def test_skidding_is_looked_for_only_where_turns_are_fast_and_kept_only_where_it_shows(monkeypatch):
    monkeypatch.setattr("trackslip.identification.comparison.drive_laws", lambda: ("icr_radius", "centrifugal"))
    slow = compare_drives([drive_of(drive_log(1, 20))], GEOMETRY)
    fast = compare_drives([fast_drive(ICR, EXACT, STILL)], GEOMETRY)
    assert list(slow.laws) == list(fast.laws) == ["icr_radius"]
    line = "law centrifugal: no slip by lateral acceleration shows"
    assert [line in one.warnings for one in (slow, fast)] == [False, True]


def test_poses_too_short_for_any_horizon_give_no_score():
    log = drive_log(1, 12.0, replace(EXACT, rate=20.0), STILL)
    first, end = np.searchsorted(log.time, [6.0, 7.9])
    drives = [drive_of(log.between(first, end))]
    found = compare_drives(drives, GEOMETRY, names=("none", "icr", "icr_radius"))
    assert found.score == {}
    assert found.reason.startswith("no motion could be predicted")
    assert found.best in ("icr", "icr_radius")
