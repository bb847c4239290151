from dataclasses import replace

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, constant_speeds, drive_log, fitted, model
from law_motion import WHITE

from sim.wander.pose_sensor import PoseSensor
from trackslip.drives.conditioning import drive_of, drives_of
from trackslip.drives.drive import Drives
from trackslip.drives.first_look import first_look
from trackslip.identification.comparison import FittedLaw, choose, ranked
from trackslip.identification.drive_comparison import compare_drives
from trackslip.identification.prediction import HORIZONS, Pairs
from trackslip.laws.base import NoSlip
from trackslip.laws.families import FAMILIES
from trackslip.laws.icr import ConstantIcr

TRUTH = np.array([[ICR.offset, ICR.radius_error, *np.zeros(6)]])


def pairs_of(*logs, horizons=HORIZONS):
    return Pairs.of(Drives.of([drive_of(log) for log in logs]), GEOMETRY, horizons)


def compared(*logs, names=("none", "icr_radius", "turn_loss", "icr_sides")):
    drives, _ = drives_of(logs)
    return compare_drives(first_look(drives, GEOMETRY), GEOMETRY, names=names)


@pytest.mark.parametrize("heading", [True, False])
def test_the_true_law_predicts_exactly(heading):
    pairs = pairs_of(drive_log(1, 40, replace(EXACT, heading=heading), STILL))
    summaries = pairs.summaries(pairs.errors(model(), TRUTH))
    assert tuple(summaries) == HORIZONS
    for errors in summaries.values():
        assert errors.position.median <= errors.position.p90 <= 1e-4
        assert (errors.heading is None) != heading
    without = pairs.summaries(pairs.errors(model("none"), TRUTH[:, 2:]))
    if heading:
        assert without[2.0].heading.rms > without[1.0].heading.rms > 0.03


def test_pairs_are_a_horizon_apart_in_one_drive_in_motion():
    driving = constant_speeds(0.1, 0.15, 40.0)
    driving[500:] = 0.0  # from 10 s on
    moving = drive_log(1, 20, EXACT, STILL)
    stopping = drive_log(2, 40, EXACT, STILL, driving=driving)
    pairs = pairs_of(moving, stopping, horizons=(0.5, 1.8))
    time = pairs.drives.time
    border = pairs.drives.first[1]
    np.testing.assert_allclose(time[pairs.end] - time[pairs.start], pairs.horizon, atol=0.051)
    assert set(pairs.horizon) == {0.5, 1.8}
    assert ((pairs.start < border) == (pairs.end < border)).all()
    starts_of_second = pairs.start[pairs.start >= border] - border
    assert pairs.drives.drives[1].time[starts_of_second].max() < 10.1
    too_short = pairs_of(drive_log(1, 3.0, EXACT, STILL), horizons=(10.0,))
    assert len(too_short.start) == 0


def test_rare_poses_are_paired_with_their_neighbours():
    """Of poses every 12 s, none are as near as the horizons, of up to 10 s."""
    rare = PoseSensor(rate=1 / 12)
    pairs = pairs_of(drive_log(1, 200, rare, STILL))
    count = len(pairs.drives.time)
    np.testing.assert_array_equal(pairs.start, np.arange(count - 1))
    np.testing.assert_array_equal(pairs.end, pairs.start + 1)
    np.testing.assert_allclose(pairs.horizon, 12.0)


@pytest.mark.parametrize("source", [replace(SLAM, position_noise=0.002, heading_noise=0.002), SLAM])
def test_noise_of_slip_is_what_longer_predictions_miss_more(source):
    """Poses with noise of 2 cm and 1° hide slip of 2 mm/√m."""
    logs = [drive_log(seed, 300, source) for seed in (1, 2)]
    noise = fitted("icr_radius", *logs).noise
    within = 1.0 if source is SLAM else 0.3
    assert noise["slip_turn"] == pytest.approx(WHITE.turning, rel=within)
    assert noise["slip_forward"] < 0.01
    assert noise["slip_sideways"] < 0.01
    assert noise["position"] == pytest.approx(source.position_noise, rel=0.3)
    if source is not SLAM:
        assert noise["slip_forward"] == pytest.approx(WHITE.along, rel=0.4)
        assert noise["slip_sideways"] == pytest.approx(WHITE.across, rel=0.6)


def law(name):
    values = dict.fromkeys(FAMILIES[name].names, 0.0)
    return FittedLaw(
        name=name, law=NoSlip(), values=values, stderr={}, interval95={}, correlation=np.eye(0)
    )


def best_of(**errors):
    laws = {name: law(name) for name in errors}
    return ranked(laws, paired().criteria(errors))


def paired(count=20):
    """200 pairs of 20 drives at each horizon."""
    drive = drive_of(drive_log(1, 2.0, EXACT, STILL, driving=constant_speeds(0.1, 0.1, 2.0)))
    data = Drives.of([drive] * count)
    starts = np.repeat(data.first[:-1], 200 // count)
    start = np.tile(starts, len(HORIZONS))
    horizon = np.repeat(HORIZONS, 200)
    return Pairs(data, start, start + 1, horizon, np.ones(len(start)))


def missed(sizes, seed=0):
    """Errors (800, 3) of these sizes at each horizon."""
    rng = np.random.default_rng(seed)
    of_horizons = []
    for size in sizes:
        of_horizons.append(size * np.abs(rng.normal(1.0, 0.2, (200, 3))))
    return np.concatenate(of_horizons)


def test_the_best_law_has_the_smallest_errors_at_most_horizons():
    icr_radius = missed((1.0, 1.0, 1.0, 2.0))
    turn_loss = missed((0.9, 0.9, 0.9, 9.0), 1)
    found = best_of(icr_radius=icr_radius, turn_loss=turn_loss)
    assert found.reason == "smallest errors of all laws at 3 of 4 horizons"
    assert found.best == "turn_loss"
    assert found.score["icr_radius"] < found.score["turn_loss"]  # 10 s would decide a mean


def test_of_laws_that_differ_by_chance_the_simpler_is_best():
    rich = missed((1.0,) * 4)
    simple = missed((1.0,) * 4)
    chance = np.random.default_rng(2).normal(0.0, 0.05, simple.shape)
    simple += chance - chance.mean(axis=0)
    assert best_of(turn_loss=rich, icr_radius=simple).best == "icr_radius"
    assert best_of(turn_loss=rich, icr_radius=simple + 0.03).best == "turn_loss"


def test_wrong_poses_and_unpredicted_pairs_choose_no_law():
    errors = {"turn_loss": missed((1.0,) * 4), "icr_radius": missed((1.2,) * 4, 1)}
    errors["turn_loss"][0, :2] += [1000.0, 0.2]  # equal but for what the laws predict
    errors["icr_radius"][0, :2] += [1000.0, 0.0]
    assert best_of(**errors).best == "turn_loss"
    errors["icr_radius"][::2] = np.nan
    assert best_of(**errors).best == "turn_loss"
    errors["icr_radius"][:] = np.nan
    assert best_of(**errors) is None


@pytest.mark.parametrize(("source", "variation"), [(SLAM, WHITE), (EXACT, STILL)])
def test_of_laws_that_predict_equally_well_the_simplest_is_best(source, variation):
    """Motion exactly by icr_radius: icr_sides and turn_loss contain it; none doesn't."""
    found = compared(drive_log(1, 120, source, variation))
    assert found.best == "icr_radius"
    assert [*found.laws][-1] == "none"
    assert found.score["none"] > 2
    assert found.alarms == ()


def test_what_the_robot_has_today_knows_no_delay_and_no_gains():
    late = replace(EXACT, delay=0.3)
    truth = ConstantIcr(0.08, 0.168, -0.1)
    logs = [drive_log(seed, 40, late, STILL, law=truth) for seed in (1, 2)]
    errors = compared(*logs).errors
    assert list(errors)[:2] == ["today", "two_gains"]
    today = errors["today"][2.0]
    gains = errors["two_gains"][2.0]
    none = errors["none"][2.0]
    best = errors["icr_radius"][2.0]
    assert best.position.rms < 1e-3 < none.position.rms < today.position.rms
    assert best.heading.rms < gains.heading.rms < none.heading.rms


@pytest.mark.parametrize("ends", [{}, {"turn_loss": (np.nan, np.nan)}])
def test_a_parameter_without_an_interval_may_be_0(ends):
    laws = {name: law(name) for name in ("icr_radius", "turn_loss")}
    laws["turn_loss"] = replace(laws["turn_loss"], interval95=ends)
    errors = {"icr_radius": missed((1.0,) * 4), "turn_loss": missed((0.8,) * 4, 1)}

    def rank(some):
        of_some = {name: errors[name] for name in some}
        return ranked(some, paired().criteria(of_some))

    assert rank(laws).best == "turn_loss"
    assert choose(laws, rank).best == "icr_radius"
    # a law with the parameters of others has none that could differ from 0
    laws["turn_loss"] = replace(laws["turn_loss"], values=laws["icr_radius"].values)
    assert choose(laws, rank).reason.endswith("but it has no parameter of its own")


def test_errors_after_10_m_of_driving():
    found = compared(drive_log(1, 120, EXACT, STILL), names=("none", "icr_radius"))
    today = found.far_errors["today"]
    none = found.far_errors["none"]
    best = found.far_errors["icr_radius"]
    assert best.way == pytest.approx(10.0, rel=0.1)
    assert best.position.median < 1e-3 < none.position.median
    assert today.heading.median > 10 * best.heading.median
    short = compared(drive_log(1, 20, EXACT, STILL), names=("none", "icr_radius"))
    assert short.far_errors == {}
