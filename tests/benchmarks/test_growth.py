"""Growth of reading with the size of a log: linear, with memory for a few runs at a time."""

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pytest

from experiments.cli import main
from trackslip.logs.logfile import join_parquet, read_runs, write_parquet

FEWER = 250
TIMES = 4
MOST = 5.0
"""Largest ratio of times for TIMES as many runs: 4 if the time is linear, 16 if it is quadratic."""
GROUP = 25  # runs in the file of a fleet


@pytest.fixture(scope="module")
def fleets(tmp_path_factory):
    """A grid's stored file of runs with scans, and the names of its runs."""
    folder = tmp_path_factory.mktemp("fleets")
    main(["grid", "--duration", "5", "--out", str(folder / "grid")])
    logs = read_runs(folder / "grid" / "runs.parquet")
    assert len(logs) == GROUP
    write_parquet(logs, folder / "fleet.parquet")
    return folder / "fleet.parquet", [log.run for log in logs]


@pytest.fixture
def grows_linearly(benchmark, within):
    """A function that bounds the ratio of computing times of a large and a small task.

    Time on the processor doesn't depend on what else the machine does.
    """

    def check(small: Callable[[], object], large: Callable[[], object]) -> None:
        small()  # imports
        benchmark.pedantic(large)
        few = least_processor_seconds(small)
        many = least_processor_seconds(large)
        within(many / few, most=MOST)

    return check


def least_processor_seconds(task: Callable[[], object]) -> float:
    """The shorter of two times on the processor."""
    times = []
    for _ in range(2):
        start = time.process_time()
        task()
        times.append(time.process_time() - start)
    return min(times)


def joined(fleets, count, path):
    """A file of `count` runs with different names."""
    file, names = fleets
    runs = []
    for k in range(count):
        name = names[k % GROUP]
        runs.append((file, name, f"{name} {k}"))
    join_parquet(runs, path)
    return path


@pytest.fixture(scope="module")
def files(fleets, tmp_path_factory):
    """Files of FEWER and of TIMES as many runs with scans."""
    folder = tmp_path_factory.mktemp("files")
    return [joined(fleets, n, folder / f"{n}.parquet") for n in (FEWER, TIMES * FEWER)]


def test_joining_the_runs_of_a_sweep(grows_linearly, fleets, tmp_path):
    path = tmp_path / "runs.parquet"
    grows_linearly(lambda: joined(fleets, FEWER, path), lambda: joined(fleets, TIMES * FEWER, path))


@pytest.mark.parametrize(
    "command",
    [
        "log {file}",
        "log {file} --out {out}/runs.csv --overwrite",
        "log {file} --out {out}/runs.parquet --overwrite",
        "view {file} --save {out}/runs.rrd",
        "identify {file} --motion paper --out {out}/identified --overwrite",
    ],
)
def test_many_runs(grows_linearly, files, command, tmp_path, capsys):
    small, large = files
    few = command.format(file=small, out=tmp_path).split()
    many = command.format(file=large, out=tmp_path).split()
    grows_linearly(lambda: main(few), lambda: main(many))


def driven_csv(rows, path):
    """A CSV file of a drive with `rows` rows."""
    time = 0.01 * np.arange(rows)
    turn = 0.2 * np.sin(time / 7)
    heading = np.cumsum(turn) * 0.01
    pose = np.cumsum([np.cos(heading), np.sin(heading)], axis=1) * 0.003
    columns = {"t": time, "omega_l": 5 - 2.8 * turn, "omega_r": 5 + 2.8 * turn}
    columns |= {"x": pose[0], "y": pose[1], "phi": heading}
    pa.csv.write_csv(pa.table(columns), path)
    return path


def peak_of(*command):
    """The largest memory of a command in a process of its own [bytes]."""
    code = """
import resource, sys
from experiments.cli import main
main(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    run = [sys.executable, "-c", code, *command]
    done = subprocess.run(run, check=True, capture_output=True, text=True)
    kilobytes = int(done.stdout.splitlines()[-1])
    return 1024 * kilobytes


def test_a_long_csv_file(grows_linearly, tmp_path, capsys):
    few = driven_csv(250_000, tmp_path / "few.csv")
    many = driven_csv(1_000_000, tmp_path / "many.csv")
    grows_linearly(lambda: main(["log", str(few)]), lambda: main(["log", str(many)]))


def test_memory_for_a_row_of_a_csv_file(benchmark, within, tmp_path):
    """A file of ten million rows takes below 3 GB."""
    few = driven_csv(500_000, tmp_path / "few.csv")
    many = driven_csv(2_000_000, tmp_path / "many.csv")
    more = benchmark.pedantic(peak_of, ("log", str(many))) - peak_of("log", str(few))
    within(more / 1.5e6, most=290)


def test_memory_for_a_run(benchmark, within, files):
    """Ten thousand runs with scans take below 3 GB: only some are in memory at a time."""
    few, many = map(str, files)
    more = benchmark.pedantic(peak_of, ("log", many)) - peak_of("log", few)
    within(more / ((TIMES - 1) * FEWER), most=250e3)
