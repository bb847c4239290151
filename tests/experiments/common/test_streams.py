"""Standard output and standard error that are closed, full, or unable to write a character."""

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.cli import commands
from experiments.common.stored import RecordedOutput

ROOT = Path(__file__).parents[3]
FULL = Path("/dev/full")
PREDICT = ("predict", "--out", "out")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")


def run(folder, *arguments, redirect="", **environment):
    """Run a command by a shell, with a redirection."""
    line = f'"$0" -m experiments "$@" {redirect}'
    return subprocess.run(
        ["sh", "-c", line, sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        timeout=60,
        check=False,
    )


def test_a_closed_output_is_refused_before_anything_is_done(tmp_path):
    done = run(tmp_path, *PREDICT, redirect=">&-")
    line = b"trackslip: standard output is closed; to discard it, send it to /dev/null\n"
    assert (done.returncode, done.stderr) == (2, line)
    assert not list(tmp_path.iterdir())


def test_a_closed_standard_error_is_refused_on_standard_output(tmp_path):
    done = run(tmp_path, *PREDICT, redirect="2>&-")
    line = b"trackslip: standard error is closed; to discard it, send it to /dev/null\n"
    assert (done.returncode, done.stdout) == (2, line)
    assert not list(tmp_path.iterdir())


def test_nothing_is_printed_if_both_are_closed(tmp_path):
    done = run(tmp_path, *PREDICT, redirect=">&- 2>&-")
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", b"")


@needs_full
@pytest.mark.parametrize("arguments", [PREDICT, ("deploy",), ("--help",), ("plan", "--help")])
def test_a_full_output_is_one_line(arguments, tmp_path):
    done = run(tmp_path, *arguments, redirect=">/dev/full")
    line = b"trackslip: output: can't be written (No space left on device)\n"
    assert (done.returncode, done.stderr) == (2, line)


class FullWhenFlushed(io.StringIO):
    """A stream that keeps what is written, and can't pass it on."""

    def flush(self):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_what_was_kept_until_the_end_must_be_written_too():
    output = RecordedOutput(FullWhenFlushed())
    output.write("a line\n")
    with pytest.raises(OSError, match="No space left"):
        output.finish()


@needs_full
def test_an_error_goes_to_the_output_if_standard_error_is_full(tmp_path):
    done = run(tmp_path, "predict", "--out", "/dev/null", redirect="2>/dev/full")
    assert done.returncode == 2
    assert done.stdout.startswith(b"trackslip: out = '/dev/null'")


@needs_full
def test_the_exit_code_is_kept_if_both_are_full(tmp_path):
    assert run(tmp_path, "nothing", redirect=">/dev/full 2>/dev/full").returncode == 2


ENCODINGS = [
    ({"PYTHONIOENCODING": "utf-8"}, "± 1 mm → 速".encode()),
    ({"PYTHONIOENCODING": "cp1252"}, "± 1 mm -> ?".encode("cp1252")),
    ({"PYTHONIOENCODING": "ascii"}, b"+/- 1 mm -> ?"),
    ({"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, b"+/- 1 mm -> ?"),
]


@pytest.mark.parametrize(("environment", "expected"), ENCODINGS)
def test_characters_are_replaced_that_a_terminal_cannot_write(environment, expected):
    script = (
        "import sys; from experiments.common import streams; streams.prepare()\n"
        r"text = '\u00b1 1 mm \u2192 \u901f'; print(text); print(text, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        check=True,
    )
    assert (done.stdout.rstrip(), done.stderr.rstrip()) == (expected, expected)


@pytest.mark.slow
@pytest.mark.parametrize(("environment", "expected"), ENCODINGS)
def test_results_are_printed_in_every_encoding(environment, expected, tmp_path):
    plan = ("plan", "--half-gauge", "0.15", "--sprocket-radius", "0.05", "--duration", "30")
    commands = (("validate",), plan, ("calibrate",), ("predict",), ("wander",), ("track",))
    for number, command in enumerate(commands):
        done = run(tmp_path, *command, "--out", str(number), **environment)
        assert (command, done.returncode, done.stderr) == (command, 0, b"")


@pytest.mark.slow
@pytest.mark.parametrize("command", commands())
def test_every_help_is_printed_in_every_encoding(command, tmp_path):
    for encoding in ("ascii", "cp1252", "utf-8"):
        done = run(tmp_path, command, "--help", PYTHONIOENCODING=encoding)
        assert (done.returncode, done.stderr) == (0, b"")
        assert b"examples:" in done.stdout
