"""What is plotted over time, and the axes of the plots."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.blueprint as rrb

from experiments.recording.blueprint import blueprint
from experiments.recording.series import COMPARED, LEFT, PANELS, RIGHT, panels, readable, series_of
from experiments.recording.stream import telling_names
from experiments.recording.traces import traces_of
from trackslip.kinematics import RobotGeometry, limit_sprocket_speeds
from trackslip.slip.exponential import ExponentialSpeed


def has_labels(low: float, high: float) -> bool:
    """Whether an axis of the viewer's has two labels or more, but not more than there is room for."""
    powers = 10.0 ** np.arange(-5, 5)
    count = np.floor(high / powers) - np.ceil(low / powers) + 1
    return bool(((count >= 2) & (count <= 5)).any())


def test_slips_agree_in_steady_turns(driven):
    traces = traces_of(driven[1][1])
    steady = slice(160, 260)
    for other in (traces.identified, traces.law):
        np.testing.assert_allclose(np.nanmean(other[steady], axis=0), traces.slip[steady].mean(axis=0), atol=0.01)
    assert traces.law_name == "icr_radius"
    assert traces.moment > 11.9
    assert traces.distance[0] == pytest.approx(np.hypot(0.1, 0.1), abs=1e-6)  # the circle is the one that was asked for


def test_the_law_shown_is_the_one_that_compensated(driven):
    """Also one from a file of the user's, and one that depends on speed."""
    log = driven[1][0]
    geometry = RobotGeometry(**log.metadata["geometry"])
    law = ExponentialSpeed(0.12, -0.9, -0.3, -1.1, gamma_outer=0.2, gamma_inner=-0.3)
    limit = log.metadata["drive"]["top_speed"] / geometry.sprocket_radius
    command = limit_sprocket_speeds(law.sprocket_speeds(log.twist_command, geometry), limit)
    traces = traces_of(replace(log, command=command, metadata=log.metadata | {"compensation": "exponential"}))
    slip = law.slip(log.twist_command)
    shown = np.isfinite(traces.law)
    assert shown.mean() > 0.8
    np.testing.assert_allclose(traces.law[shown], slip[shown], atol=1e-9)
    assert not shown[np.abs(command).max(axis=1) >= limit].any()  # scaled down: it can't be told there
    assert traces.law_name == "exponential"


def test_slips_are_on_their_axis(driven):
    traces = traces_of(driven[1][1])
    slip = {panel.title: panel.range for panel in panels([traces]) if "lip" in panel.title}
    assert slip == {"Slip [-]": (-0.25, 0.20)}
    more = replace(traces, slip=np.tile([-0.7, 0.3], (len(traces.time), 1)))
    for runs in ([more], [traces, more]):
        ranges = [panel.range for panel in panels(runs) if "lip" in panel.title]
        assert all(low < -0.7 and high > 0.3 for low, high in ranges)


def test_axes_hold_what_they_show_and_can_be_read(driven):
    log = driven[1][1]
    wild = replace(log, command=log.command + np.array([-6.0, 0.0]))
    for runs in ([log], [wild], [log, wild]):
        traces = [traces_of(run) for run in runs]
        shown = {panel.title.split(" [")[0]: panel.range for panel in panels(traces)}
        low, high = shown["Sprocket speed"]
        for run in runs:
            speeds = run.omega if len(runs) > 1 else np.append(run.omega, run.command)
            assert low < speeds.min() <= speeds.max() < high
        assert all(has_labels(*shown[name]) for name in shown if "lip" not in name)


def test_runs_without_a_reference_have_a_legend(driven, monkeypatch):
    shown = []
    view = rrb.TimeSeriesView
    monkeypatch.setattr(rrb, "TimeSeriesView", lambda **about: shown.append(about) or view(**about))
    sent = [f"{root}/slip/{name}" for root in ("run/a", "run/b") for name in ("true", "identified")]
    blueprint(["run/a", "run/b"], COMPARED, sent, np.zeros((1, 2)), 1.0, 6.0)
    assert [about["name"].split()[0] for about in shown] == ["True", "Identified"]
    visible = [about["plot_legend"].visible.as_arrow_array()[0].as_py() for about in shown]
    assert visible == [True, False]


def test_lines_lie_on_thicker_ones(driven):
    """The viewer draws by the alphabet."""
    series = {line.entity: line for line in series_of(traces_of(driven[1][1]))}
    for panel in PANELS:
        widths = [series[entity].width for entity in sorted(panel.entities)]
        assert max(widths) == widths[0]
    for entity, line in series.items():
        if entity.endswith(("true", "measured", "load", "traction")) and line.names[0].startswith("left"):
            assert line.colours == (LEFT, RIGHT)
        elif line.names[0].startswith("left"):
            assert not set(line.colours) & {LEFT, RIGHT}


@pytest.mark.parametrize(
    "values", [(-40.0, 50.0), (0.2, 11.9), (-0.7, 0.99), (-5.0, -0.1), (0.0, 0.0), (0.0, 1420.0), (0.0, 4.0)]
)
def test_errors_axes_have_two_labels_or_more(values):
    low, high = readable(np.array(values))
    assert low < min(values) <= max(values) < high
    assert has_labels(low, high)


def test_an_axis_is_not_much_longer_than_what_it_shows():
    """Unless there would be only one label: speeds up to 4 rad/s don't get an axis up to 10."""
    for high in np.linspace(1.0, 4.5, 15):
        assert readable(np.array([0.0, high]))[1] < 1.25 * high


def test_names_that_tell_runs_apart():
    assert telling_names(["linear none stone 0", "linear icr stone 0"]) == ["none", "icr"]
    assert telling_names(["a b", "a b c"]) == ["a b", "a b c"]
