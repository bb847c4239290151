"""Helpers that begin before their command."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments.parallel import early
from experiments.parallel.early import EarlyHelpers, helpers_of


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("reproduce", 3),
        ("reproduce --threads 2 --seed 1", 1),
        ("reproduce --threads=3", 2),
        ("reproduce --threads 0", 3),
        ("reproduce --threads 4", 3),
        ("reproduce --threads 1", 0),
        ("reproduce --threads 5", 0),  # more than processors: once the option is known to be allowed
        ("reproduce --threads 100000", 0),
        ("reproduce --threads two", 0),
        ("reproduce --threads", 0),
        ("reproduce --help", 0),
        ("reproduce -h", 0),
        ("grid --threads 2", 0),
        ("", 0),
    ],
)
def test_as_many_as_the_command_line_asks_for(monkeypatch, line, count):
    monkeypatch.setattr(early, "processors", lambda: 4)
    assert helpers_of(line.split()) == count


@pytest.fixture
def helpers(monkeypatch):
    monkeypatch.setattr(early, "processors", lambda: 2)
    monkeypatch.setitem(early.NEEDED, "reproduce", ("colorsys",))
    helpers = EarlyHelpers()
    yield helpers
    helpers.end()


def test_they_are_taken_once_and_have_imported_what_they_need(helpers):
    helpers.begin(["reproduce"])
    assert helpers.take(2) is None  # other than what was begun
    with helpers.take(1) as pool:
        assert helpers.take(1) is None
        assert pool.submit(eval, "'colorsys' in __import__('sys').modules").result()
        helpers.end()  # they are somebody's
        assert pool.submit(abs, -1).result() == 1
    assert multiprocessing.active_children() == []


def test_they_end_if_nobody_takes_them(helpers):
    helpers.begin(["reproduce"])
    assert len(multiprocessing.active_children()) == 1
    helpers.end()
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert multiprocessing.active_children() == []


def test_a_command_line_that_is_refused_leaves_no_helper():
    code = """
import multiprocessing, sys, time
from experiments.__main__ import main
sys.argv = ["trackslip", "reproduce", "--radii", "1"]
try:
    main()
except SystemExit as stop:
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    print(stop.code, len(multiprocessing.active_children()))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "2 0\n"
    assert done.stderr.splitlines() == [
        "trackslip: radii = (1.0,): must be at least two: slip laws are functions of radius"
    ]


@pytest.mark.parametrize(("after", "number"), [(0.1, signal.SIGINT), (0.6, signal.SIGINT), (2.0, signal.SIGTERM)])
def test_an_interrupt_leaves_one_line_no_process_and_no_file(tmp_path, after, number):
    """While helpers start, while modules are imported, and while runs are driven."""
    command = [sys.executable, "-m", "experiments", "reproduce", "--threads", "2", "--duration", "300", "--out", "out"]
    environment = {**os.environ, "TMPDIR": str(tmp_path), "PYTHONPATH": str(Path(__file__).parents[3])}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        time.sleep(after)
        process.send_signal(number)
        said = process.communicate(timeout=30)[1].decode()  # no helper holds its end of the pipe any more
    if process.returncode != -number:  # before it handled the signal
        assert process.returncode == 130
        assert [line for line in said.splitlines() if not line.endswith(" s")] == ["trackslip: interrupted"]
    assert list(tmp_path.iterdir()) == []
