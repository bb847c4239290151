"""The command line: what it refuses, and how; a refused value prints one line, a wrong option tyro's explanation."""

import os
import pty
import shlex
import signal
import subprocess
import sys

import pytest

from experiments.cli import command_modules, parse


def test_every_command_has_a_runner_and_examples_that_parse():
    for name, module in command_modules().items():
        assert isinstance(parse(shlex.split(module.EXAMPLES[0][1])[1:]), module.Config), name


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(refused, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    assert "can't be written" in refused("grid", "--out", str(locked / "out"))


def test_an_output_path_that_is_a_file(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "can't be written" in refused("grid", "--out", str(tmp_path / "file"))
    assert "can't be written" in refused("grid", "--out", str(tmp_path / "file" / "below"))
    assert (tmp_path / "file").read_text() == "mine"


def test_one_line_on_a_terminal_too():
    """tyro draws boxes in colours where it finds a terminal; our own lines are plain."""
    parent, child = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "40"}
    command = [sys.executable, "-m", "experiments", "grid", "--ground.across", "0"]
    done = subprocess.run(command, stdout=child, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert (done.returncode, done.stderr) == (2, "trackslip: ground.across = 0.0: must be a finite number > 0\n")
    os.close(parent)
    os.close(child)


def test_an_interrupt_prints_one_line_while_modules_are_imported():
    """Interrupted in the middle of the imports, wherever these are then: they are made to wait for it."""
    code = (
        "import importlib, sys, time\nimport experiments.__main__ as start\n"
        "class Finder:\n    def find_spec(self, name, *_):\n"
        "        if name == {module!r}:\n            print('waiting', flush=True)\n            time.sleep(60)\n"
        "sys.meta_path.insert(0, Finder())\nsys.argv = ['trackslip', 'predict']\nstart.main()"
    )
    for module in ("tyro", "experiments.commands.predict"):
        command = [sys.executable, "-c", code.format(module=module)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout.readline() == "waiting\n"
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=30)
        assert (process.returncode, said) == (130, "trackslip: interrupted\n"), module


def test_the_module_itself_is_no_command():
    done = subprocess.run([sys.executable, "-m", "experiments.cli"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "trackslip: start it as `trackslip` or `python -m experiments`\n")
