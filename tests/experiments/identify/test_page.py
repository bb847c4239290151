import re
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable
from slip_data import GEOMETRY, circles, driven, identified

from experiments.common.page import Answer, Plot
from experiments.identify import figures
from experiments.identify.card import LINES, print_card
from experiments.identify.page import page, steady_slip, whole_drives
from experiments.identify.turns import Turns, slip_at
from trackslip.identification.samples import SlipSamples
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.icr import ConstantIcr, IcrSides

OF_STEADY = ["fig06_slip_laws", "fig05_slip_over_speed"]


def plots(found):
    return [block.name for block in page(found, "Laws", "", {}).blocks if isinstance(block, Plot)]


def floats(text):
    return [float(number.replace("−", "-")) for number in re.findall(r"−?\d+\.\d+", text)]


@pytest.fixture(scope="module")
def found():
    return identified(driven(circles()), outliers=[("run 9", "it is 0.3 off")])


def test_the_answer_has_values_intervals_and_next_commands(found, two_drives):
    about = {"config": {"out": "out/mine"}}
    for each, gain in (
        (found, "yaw rate at left-out radii: "),
        (two_drives, "5 s ahead, position"),
    ):
        answer = page(each, "Laws", "trackslip identify", about).answer
        assert answer.heading == f"Best law: {each.best}"
        facts = dict(answer.facts)
        assert [*facts][:3] == [name for name in each.answer if name.endswith("multiplier")]
        expected = each.answer["wheel_separation_multiplier"]
        said = floats(facts["wheel_separation_multiplier"])
        assert said == pytest.approx(
            [number for number in expected if np.isfinite(number)], abs=6e-3
        )
        fit = each.main.laws[each.expressible]
        assert floats(facts["D"])[0] == pytest.approx(1e3 * fit.values["offset"], rel=0.06)
        assert gain in facts["error today → now"]
        assert facts["best law"].endswith(each.main.reason[1:])
        assert answer.next[0] == "trackslip evaluate ANOTHER_LOG --law out/mine"
        assert ("trackslip deploy out/mine" in answer.next) == (not each.alarms)
    assert page(found, "Laws", "", {}).answer.next == []


def test_a_card_leaves_out_sentences_that_do_not_fit(capsys):
    facts = [("value", str(number)) for number in range(10)]
    lines = [f"sentence {number}" for number in range(20)]
    answer = Answer("", facts, lines, alarms=["wrong"], next=["trackslip deploy out"])
    print_card(answer, "out/report.html")
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == LINES
    assert printed[0] == "ALARM: wrong"
    assert printed[11:-2] == lines[: LINES - 13]
    assert printed[-2:] == ["next: trackslip deploy out", "report: out/report.html"]


def test_turns_of_all_kinds_and_straight_runs_have_a_page():
    on_the_spot = [(0.0, 0.4), (0.0, -0.4), (0.0, 0.6)]
    for twists in (
        [*circles(), *circles(side=-1), (0.1, 0.0), (0.2, 0.0)],
        [*on_the_spot, *circles()[:4]],
    ):
        found = identified(driven(twists), ("icr", "icr_radius"))
        assert plots(found) == OF_STEADY
        turns = Turns.of(found.samples, GEOMETRY)
        for figure in (
            *figures.fitted_laws(turns, found.steady, [*found.steady.laws]),
            *figures.slip_against_speed(turns),
        ):
            assert_readable(figure)


def said_of_steady(twists):
    """What a page says first of steady stretches with these twists, without noise."""
    law = ConstantIcr(0.05, GEOMETRY.half_gauge, 0.007)
    twists = np.array(twists)
    names = [f"run {k}" for k in range(len(twists))]
    samples = SlipSamples.of(law.sprocket_speeds(twists, GEOMETRY), twists, GEOMETRY, names)
    said, *_ = steady_slip(identified(samples, ("none", "icr_radius"))).blocks
    return said


def test_the_page_says_how_many_turns_how_tight_and_how_fast():
    turns = circles()
    where = "at observed radii from 0.60 to 3.00 m and speeds from 0.10 to 0.20 m/s"
    each = ", each with one mean slip per track. A slip law gives"
    assert said_of_steady(turns).startswith(f"8 turns {where}{each}")
    one_straight = [*turns, (0.3, 0.0)]
    others = ", and 1 nearly straight run"
    assert said_of_steady(one_straight).startswith(f"8 turns {where}{others}{each}")
    two_straight = [*one_straight, (0.3, 0.01)]
    others = ", and 2 nearly straight runs"
    assert said_of_steady(two_straight).startswith(f"8 turns {where}{others}{each}")


def test_the_page_says_how_long_the_drives_are(two_drives):
    """Of 250 and 150 poses, 4 of them wrong, each a second after the one before."""
    drive = two_drives.drive
    drives = []
    for each, count in zip(drive.look.drives, (250, 150), strict=True):
        drives.append(replace(each, time=np.linspace(1000, 1000 + count, len(each.time))))
    slower = replace(drive, look=replace(drive.look, drives=tuple(drives)))
    said, *_ = whole_drives(replace(two_drives, drive=slower)).blocks
    assert said == "2 drives, 400 s, 396 poses."


def test_laws_of_drives_are_compared_if_most_driving_was_steady(two_drives):
    section = whole_drives(replace(two_drives, method="steady"))
    said, *_ = section.blocks
    assert "Most of the driving was steady, so its laws are the result" in said
    assert section.folded
    assert not whole_drives(two_drives).folded


def in_view(axes, x, y):
    """Whether points (n,) and zero are within the limits of axes, and fill more than half of their
    height.
    """
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    filled = np.ptp([*y, 0.0]) / (high - low)
    inside = left <= x.min() < x.max() <= right and low <= min(0, y.min())
    return inside and max(0, y.max()) <= high and filled > 0.5


def test_slips_over_speed_are_those_of_the_runs(found):
    turns = Turns.of(found.samples, GEOMETRY)
    inner, outer = figures.slip_against_speed(turns)
    for track, figure in enumerate((inner, outer)):
        axes, colours = figure.axes
        bars, points = axes.collections
        slip = turns.slip[:, track]
        np.testing.assert_allclose(points.get_offsets(), np.column_stack([turns.speed, slip]))
        np.testing.assert_allclose(points.get_array(), turns.radius)
        assert colours.get_ylabel() == "observed radius R [m]"
        ends = np.array(bars.get_segments())[..., 1]
        error = turns.slip_error[:, track]
        np.testing.assert_allclose(ends, np.column_stack([slip - error, slip + error]))
        assert in_view(axes, turns.speed, slip)
    assert inner.axes[0].get_title(loc="left").startswith("Inner")
    assert outer.axes[0].get_title(loc="left").startswith("Outer")


def test_curves_over_radius_are_those_of_the_laws(found):
    """At the median speed, in turns to the left, whose inner track is the left one."""
    turns = Turns.of(found.samples, GEOMETRY)
    laws = {name: found.steady.laws[name].law for name in ("none", "exponential", "icr_radius")}
    panels = figures.fitted_laws(turns, found.steady, [*laws])
    laws["published"] = PUBLISHED
    speed = np.median(found.samples.twist[:, 0])
    for track, figure in enumerate(panels):
        axes, *_ = figure.axes
        lines = {line.get_label(): line for line in axes.get_lines()}
        runs = lines.pop("runs")
        slip = turns.slip[:, track]
        np.testing.assert_allclose(runs.get_xdata(), turns.radius)
        np.testing.assert_allclose(runs.get_ydata(), slip)
        assert in_view(axes, turns.radius, slip)

        assert [*lines] == ["icr_radius (best)", "none", "exponential", "published"]
        widths = [line.get_linewidth() for line in lines.values()]
        assert widths[0] > max(widths[1:])
        for label, line in lines.items():
            radius = line.get_xdata()
            twist = np.column_stack([np.full(len(radius), speed), speed / radius])
            expected = laws[label.split()[0]].slip(twist)[:, track]
            np.testing.assert_allclose(line.get_ydata(), expected)
            assert radius.min() < turns.radius.min() < turns.radius.max() < radius.max()


def test_predictions_begin_at_marked_measured_positions(two_drives):
    curves = {
        curve.label: np.column_stack([curve.x, curve.y])
        for curve in figures.predicted_paths(two_drives, ["icr_radius"]).curves
    }
    marked = curves["start of a prediction"]
    marked = marked[np.isfinite(marked).all(axis=1)]
    path = curves["icr_radius"]
    is_known = np.isfinite(path).all(axis=1)
    begins = path[1:][is_known[1:] & ~is_known[:-1]]
    assert len(marked) > 1
    np.testing.assert_allclose(marked, begins, atol=1e-12)
    measured = two_drives.logs[0].pose[:, :2]  # of the longer drive
    away = np.linalg.norm(marked[:, None] - measured, axis=-1).min(axis=1)
    np.testing.assert_allclose(away, 0.0, atol=1e-9)


def test_turns_to_both_sides_have_the_same_inner_and_outer_slips():
    left = Turns.of(driven(circles(side=1)), GEOMETRY)
    right = Turns.of(driven(circles(side=-1)), GEOMETRY)
    assert left.left.all()
    assert not right.left.any()
    for turns in (left, right):
        assert (turns.slip[:, 0] < 0).all()  # the inner track runs slower than it moves
        assert (turns.slip[:, 1] > 0).all()


def test_straight_runs_are_left_out_and_spins_have_radius_zero():
    turns = Turns.of(driven([(0.1, 0.0), (0.1, 0.1), (0.0, 0.4), (0.0, -0.4)]), GEOMETRY)
    assert len(turns) == 3
    np.testing.assert_allclose(turns.radius, [1, 0, 0], atol=0.02)


def test_errors_are_the_scatter_of_many_measurements():
    twist = np.array([[0.15, 0.12]])
    many = [Turns.of(driven(twist, seed=seed), GEOMETRY) for seed in range(1000)]
    scatter = np.std([each.radius[0] for each in many])
    assert scatter == pytest.approx(many[0].radius_error[0], rel=0.06)
    scatter = np.std([each.slip[0] for each in many], axis=0)
    np.testing.assert_allclose(scatter, many[0].slip_error[0], rtol=0.06)


def test_a_law_has_a_curve_for_each_side_that_it_tells_apart():
    radius = np.array([0.5, 1.0, 2.0])
    of_one_side = Turns.of(driven(circles()), GEOMETRY)
    of_both_sides = Turns.of(driven([*circles(), *circles(side=-1)]), GEOMETRY)
    (curve,) = of_one_side.curves(PUBLISHED, radius)
    inner = PUBLISHED.alpha_inner * np.exp(PUBLISHED.beta_inner * radius)
    np.testing.assert_allclose(curve[:, 0], inner)
    np.testing.assert_allclose(curve, slip_at(PUBLISHED, radius, 0.1, left=False))
    law = IcrSides(0.03, 0.07, 0.0, 0.01, GEOMETRY.half_gauge)
    assert len(of_both_sides.curves(law, radius)) == 2
    assert len(of_one_side.curves(law, radius)) == 1
