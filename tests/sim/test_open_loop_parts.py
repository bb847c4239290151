import numpy as np
import pytest

from sim.fleet import Fleet
from sim.runs import open_loop, open_loop_parts
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.errors import InvalidValueError, RunFailedError
from trackslip.localization.plate import PlateLocator
from trackslip.logs.logfile import StoredRuns
from trackslip.logs.run_writer import RunWriter
from trackslip.logs.table import to_table

START = np.array([[-1.5, 0.0, 0.0]] * 2)
OMEGA = np.array([[2.0, 3.0], [3.0, 4.0]])


def arguments(robot, scanned):
    fleet = Fleet(robot, START, threads=1)
    if not scanned:
        return fleet, OMEGA, 3.03
    feed = ScannerFeed(LaserScanner(dropout=0.1), fleet, [generator(0, f"{k}") for k in range(2)])
    return fleet, OMEGA, 3.03, feed, PlateLocator(robot.plate)


@pytest.mark.parametrize(("rows", "scanned"), [(7, False), (59, False), (1, False), (7, True)])
def test_parts_are_the_same_runs_to_the_last_bit(robot, tmp_path, monkeypatch, rows, scanned):
    monkeypatch.setattr("sim.deferred_scans._AT_ONCE", 20)
    whole = open_loop(*arguments(robot, scanned))
    lengths = []
    with RunWriter(tmp_path / "runs.parquet") as file:
        for logs in open_loop_parts(*arguments(robot, scanned), rows_at_once=rows):
            lengths.append(len(logs[0].time))
            file.write(logs)
    assert sum(lengths) == len(whole[0].time) == 61
    assert min(lengths) >= 2
    assert len(lengths) > 1
    stored = StoredRuns(tmp_path / "runs.parquet")
    for log in whole:
        piecewise, table = stored.table(log.run, log.run), to_table([log])
        assert piecewise.schema.equals(table.schema)
        for name in table.column_names:
            assert repr(piecewise[name].to_pylist()) == repr(table[name].to_pylist()), name  # NaN equals NaN


def test_parts_are_not_kept(robot):
    parts = open_loop_parts(Fleet(robot, START[:1], threads=1), OMEGA[0], 2.0, rows_at_once=10)
    first = next(parts)[0]
    before = first.pose.copy()
    assert [len(logs[0].time) for logs in parts] == [10, 10, 11]
    np.testing.assert_array_equal(first.pose, before)


@pytest.mark.parametrize(("robots", "rows"), [(1, 300), (128, 256), (1100, 32)])
def test_parts_are_the_shorter_the_more_robots_there_are(robot, monkeypatch, robots, rows):
    fleet = Fleet(robot, np.zeros((robots, 3)), threads=1)
    monkeypatch.setattr(fleet, "advance", lambda period: None)
    part = next(open_loop_parts(fleet, OMEGA[0], 600.0))
    assert {len(log.time) for log in part} == {rows}


def test_a_failure_comes_with_what_was_recorded_since_the_last_part(robot):
    fleet = Fleet(robot, START[:1], threads=1)
    parts = open_loop_parts(fleet, OMEGA[0], 2.0, rows_at_once=10)
    next(parts)
    fleet.batch.qpos[0, 3:7] = [np.cos(0.5), np.sin(0.5), 0, 0]
    with pytest.raises(RunFailedError, match=r"tips over after 0\.5") as caught:
        next(parts)
    assert caught.value.logs == []


def test_too_short_a_run_is_refused_at_once(robot):
    with pytest.raises(InvalidValueError, match="duration"):
        next(open_loop_parts(Fleet(robot, START[:1]), OMEGA[0], 0.01))
