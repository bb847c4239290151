"""The command line: what it refuses, and how; a refused value prints one line, a wrong option tyro's explanation."""

import os
import pty
import shlex
import signal
import subprocess
import sys

import pytest

from experiments.cli import command_modules, parse

PLAN = ("plan", "--half-gauge", "0.168", "--sprocket-radius", "0.06")
SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("paint",), "COMMAND = 'paint': must be one of bag, bench, benchmark, calibrate, "),
        (("grid", "--out", ""), "--out = '': must be non-empty"),
        (("grid", "--out="), "--out = '': must be non-empty"),
        (("grid", "--out", "\udcff"), "--out = '\\udcff': must be valid UTF-8"),
        (("grid", "--radii", "1", "--radii", "2"), "--radii is given twice; give it once, with all its values"),
        (("grid", "--seed=1", "--seed", "2"), "--seed is given twice"),
        (("grid", "--random-phase", "--no-random_phase"), "--no-random-phase is given twice"),
        (("grid", "--grounds"), "grounds = (): must be at least one value"),
        (("grid", "--seeds", "--threads", "1"), "seeds = (): must be at least one value"),
        (("grid", "--vary"), "vary = (): must be at least one value"),
        (("grid", "--radii"), "radii = (): must be at least one number"),
        (("identify", "x.csv", "--where"), "where = (): must be at least one NAME=VALUE"),
        (("export", "x", "--run"), "run = (): must be at least one value"),
        (("benchmark", "--grounds"), "grounds = (): must be at least one value"),
        (("--tyro-print-completion", "tclsh"), "--tyro-print-completion = 'tclsh': must be one of bash, zsh, fish"),
        (("grid", "--ground.across", "0"), "ground.across = 0.0: must be a finite number > 0"),
        (("grid", "--drive.motor.gear", "0"), "drive.motor.gear = 0.0: must be a finite number > 0"),
        (("grid", "--seeds", *map(str, range(60_000))), "runs = 1500000: must be at most 1,000,000"),
        (("predict", "--friction-ratio", "1e-300"), "friction_ratio = 1e-300: must be at least 0.01"),
        (("predict", "--radii", "1e-300"), "radii = 1e-300: must be at least 0.001 m"),
        (("train", "--seed", "99999999999"), "seed = 99999999999: must be an integer from 0 to 4294967295"),
        (("train", "--learning-rate", "2"), "learning_rate = 2.0: must be at most 1"),
        (("train", "--authority", "1e300", "1"), "authority = 1e+300: must be at most 10"),
        (("train", "--threads", "99999"), "threads = 99999: must be an integer from 0 to 1024"),
        (("train", "--network", "1000000000"), "network = 1000000000: must be integers from 1 to 4096"),
        (("grid", "--radii", "-1"), "radii = -1.0: must be a finite number > 0"),
        (("grid", "--radii", "0.5", "0.168"), "radii = 0.168: must be greater than the half gauge, 0.168 m"),
        (("grid", "--radii", "nan"), "radii = nan"),
        (("grid", "--radii", "1", "1"), "radii = (1.0, 1.0): must be all different"),
        (("grid", "--speeds", "0.5"), "speeds = 0.5: must be at most drive.top_speed = 0.3 m/s"),
        (("grid", "--duration", "0"), "duration = 0.0: must be from 4 to 3600 s"),
        (("grid", "--duration", "1e9"), "duration = 1000000000.0: must be from 4 to 3600 s"),
        (("grid", "--scanner.resolution", "1e-9"), "scanner.resolution = 1e-09: must be at least"),
        (("grid", "--radii", "1e6"), "radii = 1000000.0: must be at most 1000"),
        (
            ("track", "--reference", "circle", "--circle-speed", "1e-9"),
            "circle_speed = 1e-09: must be at least 0.001",
        ),
        (("identify", "x" * 300), "path = 'xxx"),
        (("grid", "--scanner.rate", "2"), "scanner.rate = 2.0: must be at least 5 Hz"),
        (("grid", "--radius-error", "9"), "radius_error = 9.0: must be from -0.5 to 0.5"),
        (("reproduce", "--radii", "1"), "radii = (1.0,): must be at least two"),
        (("grid", "--seed", "-1"), "seed = -1"),
        (("grid", "--threads", "-1"), "threads = -1"),
        (("grid", "--scanner.noise", "-0.1"), "scanner.noise = -0.1"),
        (("grid", "--scanner.rate", "33"), "scanner.rate = 33.0"),
        (("reproduce", "--drive.period", "0.0025"), "drive.period = 0.0025: must be a multiple of the physics step"),
        (("track", "--controller", "pid"), "controller = 'pid': must be one of feedforward"),
        (("track", "--compensation", "magic"), "compensation = 'magic': must be one of none, published"),
        (("track", "--start", "0", "nan", "0"), "start = nan"),
        (("track", "--circle-duration", "0"), "circle_duration = 0.0"),
        (("track", "--laws", "nowhere.json"), "nowhere.json: No such file"),
        (("identify", "nowhere.csv"), "nowhere.csv: no such file"),
        (("identify", ".", "--settle", "-1"), "settle = -1.0"),
        (("plan",), "half_gauge = None: must be given (--half-gauge on the command line)"),
        (
            ("plan", "--half-gauge", "0.2"),
            "sprocket_radius = None: must be given (--sprocket-radius on the command line)",
        ),
        ((*PLAN, "--area", "3"), "area = '3': must be length x width in metres, such as 3x3 or 4.5x2"),
        ((*PLAN, "--area", "3x-3"), "area = '3x-3': must be length x width in metres"),
        ((*PLAN, "--area", "0.6x3"), "area = '0.6x3': must be more than 0.672 m long and wide, for the robot to turn"),
        ((*PLAN, "--max-speed", "0"), "max_speed = 0.0: must be a finite number > 0"),
        ((*PLAN, "--acceleration", "nan"), "acceleration = nan: must be a finite number > 0"),
        ((*PLAN, "--duration", "5"), "duration = 5.0: must be at least 10 s"),
        ((*PLAN, "--clearance", "-1"), "clearance = -1.0: must be a finite number >= 0"),
        ((*PLAN, "--clearance", "2"), "area = '3x3': must be more than twice the clearance, 2 m"),
        ((*PLAN, "--offset", "-0.2"), "offset = -0.2: must be greater than -half_gauge = -0.168 m"),
        ((*PLAN, "--doubt", "1"), "doubt = 1.0: must be from 0 to 0.9"),
        (("plan", "--after", "nowhere"), "nowhere: No such file or directory"),
    ],
)
def test_a_refused_value_prints_one_line(refused, arguments, message):
    assert message in refused(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "Expected one of {bag, bench,"),
        (("grid", "--colour", "red"), "Unrecognized options: --colour"),
        (("coverage", "--motion", "arc"), "--motion (applied to trackslip coverage)"),
        (("coverage", "--random-phase"), "--random-phase (applied to trackslip coverage)"),
        (("grid", "--seed", "1.5"), "Error parsing --seed"),
        (("grid", "--seed"), "Missing value for argument '--seed'"),
        (("grid", "--radii", "1", "½"), "Error parsing --radii"),
        (("grid", "--motion", "None"), "Error parsing --motion"),
        (("track", "--start", "1", "2"), "Error parsing --start"),
        (("track", "--localization", "eye"), "invalid choice 'eye' for argument '--localization'"),
        (("identify",), "PATH"),
        ((*PLAN, "--poses", "sonar"), "invalid choice 'sonar' for argument '--poses'"),
        (("--tyro-print-completion",), "Unrecognized options: --tyro-print-completion"),
    ],
)
def test_tyro_explains_what_it_rejects(rejected, arguments, message):
    assert message in rejected(*arguments)


def test_every_command_has_a_runner_and_examples_that_parse():
    for name, module in command_modules().items():
        assert isinstance(parse(shlex.split(module.EXAMPLES[0][1])[1:]), module.Config), name


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(refused, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    assert "can't be written" in refused("grid", *SMALL, "--out", str(locked / "out"))


def test_an_output_path_that_is_a_file(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "can't be written" in refused("grid", *SMALL, "--out", str(tmp_path / "file"))
    assert "can't be written" in refused("grid", *SMALL, "--out", str(tmp_path / "file" / "below"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_laws_file_of_deeply_nested_json(refused, tmp_path):
    (tmp_path / "laws.json").write_text("[" * 100_000)
    assert "laws.json" in refused("track", "--laws", "laws.json")


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
