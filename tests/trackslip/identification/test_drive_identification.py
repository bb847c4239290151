import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, STILL, drive_log
from slip_data import grid

from trackslip.errors import InvalidValueError, LogError, TrackslipError
from trackslip.identification.identify import identify, identify_source
from trackslip.identification.result import identification_to_json
from trackslip.identification.samples import Sampling
from trackslip.identification.source import ReadOptions, Source, source_of_runs
from trackslip.kinematics import advance
from trackslip.laws.file import load_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog

SIZE = {"half_gauge": GEOMETRY.half_gauge, "sprocket_radius": GEOMETRY.sprocket_radius}


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    laws = ("none", "icr_radius")
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: laws)


@cache
def identified():
    return identify([drive_log(seed, 40) for seed in (1, 2)], GEOMETRY, method="drive")


def test_a_drive_gives_laws_intervals_and_predictions():
    found = identified()
    assert found.method == "drive"
    assert found.steady is None
    assert set(found.laws) == {"none", "icr_radius"}
    assert found.best == "icr_radius"
    assert found.alarms == ()
    low, high = found.intervals["icr_radius"]["offset"]
    assert low < ICR.offset < high
    error = {name: found.drive.errors[name][2.0].heading.rms for name in ("icr_radius", "none")}
    assert error["icr_radius"] < error["none"]
    assert "2 drives" in repr(found)
    assert found.best in repr(found)
    with pytest.raises(TrackslipError, match="there are no steady samples"):
        found.samples  # noqa: B018


def test_a_summary_is_json_that_load_laws_reads(tmp_path):
    content = json.loads(json.dumps(identification_to_json(identified()), allow_nan=False))
    assert content["method"] == "drive"
    assert content["drive"]["laws"]["icr_radius"]["held"]["lag"] == "not asked for"
    assert set(content["prediction"]["icr_radius"]) <= {"1", "2", "5", "10"}
    offset = content["answer"]["offset"]
    assert offset["low"] < ICR.offset < offset["high"]
    assert content["alarms"] == []
    file = tmp_path / "summary.json"
    file.write_text(json.dumps(content))
    laws = load_laws(file)
    law = laws["icr_radius"]
    assert law.offset == pytest.approx(float(identified().laws["icr_radius"].offset))


def test_closed_loops_are_drives_and_steady_samples_are_none():
    closed = replace(drive_log(1, 12.0), metadata={"controller": {"name": "any"}})
    assert identify(closed, GEOMETRY).method == "drive"
    with pytest.raises(LogError, match="in closed loop"):
        identify(closed, GEOMETRY, method="steady")
    source = Source("samples", GEOMETRY, ReadOptions(), rows=Sampling(grid(ICR), (), ()))
    with pytest.raises(LogError, match="only method steady can be used"):
        identify_source(source, "drive")
    with pytest.raises(InvalidValueError, match="steady or drive"):
        identify_source(source, "quick")


SAMPLES = Source("samples.csv", GEOMETRY, ReadOptions(), rows=Sampling(grid(ICR), (), ()))
FREE = replace(drive_log(1, 12.0), metadata={"controller": {"name": "any"}})  # not steady
ONLY_STEADY = [("settle", 2.0), ("motion", "arc")]
ONLY_DRIVE = [("sensor", (0.1, 0.0, 0.0)), ("lag", True)]


@pytest.mark.parametrize(
    ("source", "method", "options", "reason"),
    [
        (SAMPLES, None, ONLY_STEADY + ONLY_DRIVE, "samples.csv holds steady samples, not traces"),
        (FREE, "steady", ONLY_DRIVE, "only method drive estimates it"),
        (FREE, "drive", ONLY_STEADY, "only method steady uses it"),
        (FREE, None, ONLY_STEADY, "most of the driving isn't steady, so whole drives are used; m"),
    ],
)
def test_an_option_without_effect_is_refused(source, method, options, reason):
    for name, value in options:
        reading = ReadOptions(**{name: value}) if (name, value) in ONLY_STEADY else ReadOptions()
        others = {name: value} if (name, value) in ONLY_DRIVE else {}
        if source is FREE:
            read = source_of_runs([FREE], replace(reading, **SIZE))
        else:
            read = replace(source, reading=reading)
        said = f"{name} = .*: must be left out: {reason}"
        with pytest.raises(InvalidValueError, match=said):
            identify_source(read, method, **others)


def circles(count, steady):
    """Runs of 20 s on circles, steady for so many seconds; then the sprockets run ever faster."""
    time = np.arange(0, 20, 0.05)
    faster = np.interp(time, [steady, 20.0], [1.0, 3.0])
    runs = []
    for number in range(count):
        twist = np.array([0.15, 0.1 + 0.05 * number])
        omega = np.outer(faster, ICR.sprocket_speeds(twist, GEOMETRY))
        turned = np.append(0.0, np.cumsum(faster[1:] * np.diff(time)))
        runs.append(RunLog(f"run {number}", time, omega, advance([0, 0, 0], twist, turned)))
    return runs


class SteadyLawsFitted(Exception):
    """Raised in place of a cross-check by whole drives."""


def stop(_):
    raise SteadyLawsFitted


@pytest.mark.parametrize(
    ("count", "steady", "are_steady"),
    [(4, 20.0, True), (3, 20.0, False), (4, 11.0, True), (4, 8.5, False)],
)
def test_four_runs_that_are_mostly_steady_are_steady(count, steady, are_steady):
    """Whole drives refuse the option `settle`."""
    source = source_of_runs(circles(count, steady), ReadOptions(settle=1.0, **SIZE))
    if are_steady:
        with pytest.raises(SteadyLawsFitted):
            identify_source(source, step=stop)
    else:
        with pytest.raises(InvalidValueError, match="most of the driving isn't steady"):
            identify_source(source, step=stop)


def test_what_a_robot_shows_too_little_of_is_an_alarm():
    short = identify(drive_log(1, 20), GEOMETRY, method="drive")
    assert {alarm.kind for alarm in short.alarms} == {"little"}
    assert np.isnan(short.answer["offset"].low)
    json.dumps(identification_to_json(short))


def test_too_little_driving_hides_no_other_alarm():
    """Of a robot that hardly turns: laws have D of at most fifty half gauges."""
    stubborn = ConstantIcr(120 * GEOMETRY.half_gauge, GEOMETRY.half_gauge, 0.0)
    found = identify(drive_log(1, 20, EXACT, STILL, stubborn), GEOMETRY, method="drive")
    kinds = {alarm.kind for alarm in found.alarms}
    assert {"little", "units", "bound"} <= kinds
    # that parts of driving are too few is said already
    assert "blocks" not in kinds


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (
            RunLog("two", np.array([0.0, 1.0]), np.ones((2, 2)), np.zeros((2, 3))),
            "1 pose while it drives",
        ),
        (RunLog("still", np.arange(40.0), np.zeros((40, 2)), np.zeros((40, 3))), "stand still"),
        (RunLog("held", np.arange(40.0), np.ones((40, 2)), np.zeros((40, 3))), "needs at least 2"),
    ],
)
def test_what_is_no_drive_is_said(log, said):
    with pytest.raises(LogError, match=said):
        identify(log, GEOMETRY, method="drive")


GROUND = {"along": 0.7, "across": 0.778, "slope": 0.0, "uphill": 0.0, "shear": 0.01}


def run(loads: bool = True, **changed: float) -> RunLog:
    time = np.arange(0, 5, 0.05)
    return RunLog(
        "run",
        time,
        np.ones((100, 2)),
        np.zeros((100, 3)),
        load=np.zeros((100, 2)) if loads else None,
        metadata={"geometry": vars(GEOMETRY), "ground": GROUND | changed},
    )


def test_runs_that_tell_their_loads_may_differ_in_slope():
    (note,) = source_of_runs([run(), run(slope=0.1, uphill=1.0)]).notes
    said = "its runs differ in ground (slope, uphill): only icr_load takes that into account"
    assert note == said
    assert source_of_runs([run(), run()]).notes == ()


@pytest.mark.parametrize(
    ("runs", "named"),
    [
        ([run(), run(loads=False, slope=0.1)], "slope"),
        ([run(), run(shear=0.02)], "shear"),
        ([run(), run(slope=0.1, along=0.6)], "along, slope"),
    ],
)
def test_other_differences_are_refused(runs, named):
    with pytest.raises(LogError, match=rf"differ in ground \({named}\): choose with --where"):
        source_of_runs(runs)
