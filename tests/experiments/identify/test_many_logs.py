"""`trackslip identify` and `evaluate` with several logs."""

import json
import re

import pytest
from drives import ICR, SLAM, drive_log

from experiments.common.log_names import log_names
from trackslip.deploy.deploy import deploy_law
from trackslip.laws.file import load_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.logfile import write_parquet

SIZE = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
SLIPPERY = ConstantIcr(0.10, 0.168, -0.02)


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    monkeypatch.setattr(
        "trackslip.identification.drive_comparison.drive_laws", lambda: ("none", "icr_radius")
    )


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name, seed, law in (("monday", 1, ICR), ("tuesday", 2, ICR), ("ice", 3, SLIPPERY)):
        write_parquet([drive_log(seed, 90.0, SLAM, law=law)], folder / f"{name}.parquet")
    return folder


@pytest.mark.usefixtures("with_figures")
def test_two_days_are_served_by_one_law_that_deploys(trackslip, logs):
    files = (str(logs / "monday.parquet"), str(logs / "tuesday.parquet"))
    result = trackslip("identify", *files, *SIZE)
    summary = result.summary
    assert summary["one_law"] == "yes"
    assert list(summary["logs"]) == ["monday", "tuesday"]
    law = load_laws(result.folder)["diff_drive"]
    assert law.offset == pytest.approx(ICR.offset, abs=0.002)
    low, high = summary["slip_laws"]["diff_drive"]["interval95"]["offset"]
    assert low < ICR.offset < high
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    assert "One law serves all logs" in page
    # three multipliers and the cost, and a report of each log
    assert len([*(result.folder / "figures").glob("*.svg")]) == 4
    for name in ("monday", "tuesday"):
        own = json.loads((result.folder / name / "summary.json").read_text())
        assert own["best"] == summary["logs"][name]["best"]
        assert (result.folder / name / "report.html").is_file()
        assert (result.folder / name / "runs.parquet").is_file()
        assert f'href="{name}/report.html"' in page
        assert load_laws(result.folder / name)["icr_radius"].half_gauge == 0.168
    assert '"offset"' in deploy_law(result.folder, "json")


def test_another_ground_is_named_and_no_law_is_stored(trackslip, logs):
    files = [str(logs / f"{name}.parquet") for name in ("monday", "tuesday", "ice")]
    result = trackslip("identify", *files, *SIZE)
    printed = result.printed
    assert result.summary["one_law"] == "no"
    assert "slip_laws" not in result.summary
    assert "One law doesn't serve all logs: in ice" in printed
    assert "(the logs differ)" in printed
    assert re.search(r"wheel_separation_multiplier.* differ.* between the logs", printed)


def panels_of(figure):
    """Axes of a figure without those of legends."""
    return [axes for axes in figure.axes if axes.axison]


def test_evaluate_makes_a_table_of_models_and_logs(trackslip, logs, monkeypatch):
    plots = {}

    def kept(plot, pdf=False):
        plots[plot.name] = plot
        return ()

    monkeypatch.setattr("experiments.common.page.drawn_plot", kept)
    identified = trackslip(
        "identify", str(logs / "monday.parquet"), str(logs / "ice.parquet"), *SIZE
    )
    laws = [f"{identified.folder / name}:icr_radius" for name in ("monday", "ice")]
    options = ("--law", laws[0], "--law", laws[1], "--law", "none")
    result = trackslip(
        "evaluate", str(logs / "tuesday.parquet"), str(logs / "ice.parquet"), *options
    )
    median = result.summary["median"]
    assert list(median) == ["tuesday", "ice"]
    assert median["tuesday"][laws[0]]["position"] < median["tuesday"][laws[1]]["position"]
    assert median["ice"][laws[1]]["position"] < median["ice"][laws[0]]["position"]
    assert set(result.summary["mean_ratio"]) == {*laws, "none"}
    assert result.summary["best"] in laws
    rows = [line.split("  ")[0].strip() for line in result.printed.splitlines()]
    assert {*laws, "none", "best in the log"} <= set(rows)
    assert [*(result.folder / "tuesday" / "trajectories").glob("*_measured.tum")]
    assert (result.folder / "ice" / "report.html").is_file()
    for figure in plots["errors_in_all_logs"].figure():
        (axes,) = panels_of(figure)
        assert [text.get_text() for text in axes.get_yticklabels()] == ["tuesday", "ice"]
        assert axes.get_xscale() == "log"
    for figure in plots["errors_ahead"].figure():
        (axes,) = panels_of(figure)
        assert axes.get_xscale() == "log"


def test_one_log_of_several_that_cannot_be_read_is_named(refused, logs, tmp_path):
    (tmp_path / "empty.csv").write_text("omega_l,omega_r,v,w\n")
    monday = str(logs / "monday.parquet")
    assert refused("identify", monday, "none.csv", *SIZE) == "none.csv: no such file"
    assert refused("identify", monday, "empty.csv", *SIZE).startswith("empty.csv: ")
    assert refused("evaluate", monday, "none.csv", *SIZE) == "none.csv: no such file"


@pytest.mark.parametrize("command", ["identify", "evaluate"])
def test_logs_must_be_given_and_differ(refused, logs, command, monkeypatch):
    assert refused(command) == "logs = (): must be at least one log"
    monkeypatch.chdir(logs)
    line = refused(command, "ice.parquet", f"../{logs.name}/ice.parquet")
    assert line == f"logs = ('ice.parquet', '../{logs.name}/ice.parquet'): must be all different"


def test_a_data_set_is_evaluated_alone(refused, logs, tmp_path):
    (tmp_path / "set.toml").write_text("")
    line = refused("evaluate", "set.toml", str(logs / "ice.parquet"))
    assert line == "logs = 'set.toml': must be a log: a data set is evaluated alone"


def test_names_tell_logs_apart(tmp_path):
    files = [tmp_path / place for place in ("ice/log.csv", "stone/log.csv", "ice.csv")]
    for file in files:
        file.parent.mkdir(exist_ok=True)
        file.touch()
    assert log_names(files[1:]) == ["log", "ice"]
    assert log_names(files[:2]) == ["ice/log", "stone/log"]
    twins = [tmp_path / "ice.csv", tmp_path / "ice.parquet"]
    twins[1].touch()
    assert log_names(twins) == [str(twin.resolve()) for twin in twins]
    assert log_names([tmp_path / "ice", tmp_path / "stone"]) == ["ice", "stone"]
