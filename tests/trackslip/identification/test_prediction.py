from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, SLAM, STILL, drive_log

from sim.wander.motion import WHITE
from trackslip.identification.comparison import compare_drives
from trackslip.identification.drive_law import fit_drives
from trackslip.identification.drives import drive_of, drives_of
from trackslip.identification.prediction import HORIZONS, PredictionErrors, held_out, score
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


def test_the_score_is_the_mean_ratio_to_the_smallest_error():
    def errors(position, heading):
        return PredictionErrors(10, position, position, heading, heading)

    table = {"a": {1.0: errors(0.1, 0.2), 2.0: errors(0.2, None)}, "b": {1.0: errors(0.2, 0.1), 2.0: errors(0.2, None)}}
    assert score(table, ("a", "b")) == pytest.approx({"a": (1 + 2 + 1) / 3, "b": (2 + 1 + 1) / 3})
    assert np.isnan(score({"a": {}, "b": {}}, ("a", "b"))["a"])


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
    assert all(np.isnan(value) for value in found.score.values())
    assert found.best in ("icr", "icr_radius")
