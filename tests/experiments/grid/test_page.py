from pathlib import Path

import numpy as np
import pytest

from experiments.common.page import Plot
from experiments.grid.page import page, radius_chart, slip_charts
from experiments.grid.summary import RunGrid


def row(radius, speed=0.1, *, slip=(-0.1, 0.05), error=None, **more):
    """A run that drove 1.2 times the commanded radius; without a slip if `slip` is None."""
    known = error is None and slip is not None
    slip_l, slip_r = slip if known else (None, None)
    return {
        "run": f"radius={radius} speed={speed}",
        "error": error,
        "radius": radius,
        "observed_radius": 1.2 * radius if known else None,
        "slip_l": slip_l,
        "slip_r": slip_r,
        "true_slip_l": slip_l,
        "true_slip_r": slip_r,
        **more,
    }


def page_of(rows, axes=None, manifest=None):
    """The page on one grid with these runs, or on one for each value of an axis."""
    several = [{}] if axes is None else axes
    grids = [RunGrid.of_rows(each, rows) for each in several]
    return page(grids, rows * len(grids), 8.0, Path("out/my grid"), [], manifest or {})


def test_slip_over_radius_has_the_mean_of_the_speeds():
    rows = [row(1.0, 0.1, slip=(-0.10, 0.04)), row(1.0, 0.2, slip=(-0.12, 0.06)), row(2.0)]
    inner, outer = slip_charts([RunGrid.of_rows({}, rows)])
    (published, measured) = inner.curves
    assert (published.label, measured.label) == ("published", "measured")
    np.testing.assert_allclose(measured.x, [1.2, 2.4])
    np.testing.assert_allclose(measured.y, [-0.11, -0.10])
    np.testing.assert_allclose(outer.curves[1].y, [0.05, 0.05])


@pytest.mark.usefixtures("with_figures")
def test_one_run_has_a_page_with_its_answer():
    found = page_of([row(1.0)])
    facts = dict(found.answer.facts)
    assert found.answer.heading == "1 run"
    assert facts["slip of the inner track"] == "−10.0 %"
    assert facts["radius driven over commanded"] == "1.20"
    assert found.answer.next == ["trackslip identify 'out/my grid'"]
    assert found.html().count('<div class="zoom">') == 3


def test_failed_runs_are_warned_of_first_and_listed():
    rows = [row(1.0), row(2.0, error="the robot tips over")]
    found = page_of(rows)
    assert found.answer.heading == "1 run"
    assert found.answer.warnings[0] == "1 run of 2 failed"
    text = found.html()
    assert text.index("1 run of 2 failed") < text.index("slip of the inner track")
    assert "radius=2.0 speed=0.1: the robot tips over" in text


@pytest.mark.usefixtures("with_figures")
def test_runs_without_slips_are_an_alarm_and_have_no_figures():
    found = page_of([row(1.0, slip=None, note="run left out")])
    assert found.answer.alarms == ["No run gave a slip"]
    assert found.answer.next == []
    text = found.html()
    assert '<section class="answer alarm">\n<h2>No run gave a slip</h2>' in text
    assert "<svg" not in text


def test_grids_of_a_sweep_are_told_apart_by_their_axes():
    axes = [{"ground": name, "seed": seed} for name in ("stone", "ice") for seed in range(20)]
    grids = [RunGrid.of_rows(each, [row(1.0)]) for each in axes]
    labels = [curve.label for curve in radius_chart(grids).curves]
    assert labels[:3] == ["without slip", "ground=stone seed=0", "ground=stone seed=1"]
    looks = {(curve.colour, curve.dashes) for curve in radius_chart(grids).curves}
    assert len(looks) == len(labels) == 25
    ground = {"along": 0.7, "across": 0.8}
    found = page_of([row(1.0)], axes, {"seed": 0, "ground": ground})
    captions = {block.name: block.caption for block in found.blocks if isinstance(block, Plot)}
    assert "The first 24 of 40 grids are drawn." in captions["slip_over_radius"]
    assert "friction 0.7 along" not in found.html().partition("How it was made")[0]
