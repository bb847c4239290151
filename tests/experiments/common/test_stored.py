"""A command that is run again prints its stored result, unless anything that it depends on has
changed.
"""

import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from tracked_files import URDF, write_robot

from experiments.cli import main
from experiments.common.stored import RecordedOutput
from trackslip.files import read_manifest

pytestmark = pytest.mark.usefixtures("few_laws")
ROOT = Path(__file__).parents[3]
LOG = ROOT / "examples" / "logs" / "maxxii.csv"
IDENTIFY = ("identify", "mine.csv", "--half-gauge", "0.2", "--sprocket-radius", "0.1")
FOLLOWER = """import numpy as np
from helper import GAIN
class Mine:
    def reset(self): pass
    def twist(self, time, pose, reference):
        return np.tile(GAIN * reference.twist(time), (len(pose), 1))
"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """A function that runs a command in an empty folder and returns its exit code, its output and
    its errors.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("experiments.common.page.drawn_plot", lambda plot, pdf=False: ())

    def call(*arguments):
        code = 0
        try:
            main(list(arguments))
        except SystemExit as stop:
            code = stop.code or 0
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def log(tmp_path):
    """A user's log, in the folder in which commands run."""
    return Path(shutil.copy(LOG, tmp_path / "mine.csv"))


def test_a_command_run_again_prints_the_same(run, log):
    code, printed, _ = run(*IDENTIFY)
    assert code == 0
    times = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*")}
    again, reprinted, note = run(*IDENTIFY)
    assert (again, reprinted) == (0, printed)
    assert note.startswith("out/identify/report.html: from ")
    assert note.endswith(", --overwrite runs it again\n")
    files = {path: path.stat().st_mtime_ns for path in Path("out").rglob("*") if path.is_file()}
    assert files.items() <= times.items()


@pytest.mark.filterwarnings("default")
def test_a_warning_is_printed_again(run, tmp_path):
    (tmp_path / "wide.toml").write_text("half_gauge = 0.612\n")  # no other test has loaded it
    grid = ("grid", "--robot", "wide.toml", "--radii", "3", "--speeds", "0.1", "--duration", "4")
    _, printed, warned = run(*grid)
    line = "warning: half_gauge = 0.612: turns are verified up to 0.51 m, 1.5 contact lengths"
    assert line in warned.splitlines()
    _, reprinted, note = run(*grid)
    assert reprinted == printed
    assert note.splitlines()[0] == line


def touch(log):
    os.utime(log, (0, 0))


def replace_by_equal(log):
    text = log.read_bytes()
    log.unlink()
    log.write_bytes(text)


@pytest.mark.parametrize("change", [touch, replace_by_equal])
def test_a_file_with_the_same_content_is_unchanged(run, log, change):
    _, printed, _ = run(*IDENTIFY)
    change(log)
    assert run(*IDENTIFY)[:2] == (0, printed)


def test_a_changed_file_is_named(run, log):
    run(*IDENTIFY)
    log.write_text(log.read_text().replace("1", "2", 1))
    line = (
        "trackslip: out/identify holds a result of other inputs: mine.csv has changed since; "
        "--overwrite runs it again\n"
    )
    assert run(*IDENTIFY) == (2, "", line)
    log.unlink()
    assert "mine.csv is gone" in run(*IDENTIFY)[2]


def test_a_folder_may_be_named_by_another_path_or_have_moved(run):
    _, printed, _ = run("predict")
    assert run("predict", "--out", str(Path("out/predict").absolute()))[:2] == (0, printed)
    Path("out/predict").rename("elsewhere")
    assert run("predict", "--out", "elsewhere")[:2] == (0, printed)


def test_overwrite_runs_again_and_is_stored(run):
    run("predict")
    created = read_manifest(Path("out/predict"))["recording"]
    code, printed, note = run("predict", "--overwrite")
    assert (code, note) == (0, "")
    assert read_manifest(Path("out/predict"))["recording"] != created
    assert run("predict")[:2] == (0, printed)


def test_other_options_are_named(run):
    run("predict", "--half-gauge", "0.2")
    code, printed, line = run("predict", "--shear", "0.01")
    assert (code, printed) == (2, "")
    assert line.startswith("trackslip: out/predict holds a result of other options: ")
    assert "half_gauge was 0.2 and is not given, shear was not given and is 0.01; " in line


def test_the_folder_of_another_command_is_refused(run):
    run("predict")
    code, printed, line = run(
        "plan", "--half-gauge", "0.2", "--sprocket-radius", "0.1", "--out", "out/predict"
    )
    assert (code, printed) == (2, "")
    assert "contains results; --overwrite replaces them" in line


def test_other_code_is_refused(run, monkeypatch):
    run("predict")
    monkeypatch.setattr("experiments.common.stored.code_digest", lambda: "other")
    assert "the code of trackslip has changed since" in run("predict")[2]


def test_other_libraries_are_refused(run, monkeypatch):
    run("predict")
    monkeypatch.setattr("experiments.common.stored.versions", lambda: {"numpy": "0.1"})
    assert "numpy was 2" in run("predict")[2]


def test_results_of_a_run_that_was_killed_do_not_count(run):
    """A run that was killed before it had printed all has a manifest without what it printed."""
    run("predict")
    manifest = json.loads(Path("out/predict/manifest.json").read_text())
    del manifest["stored"]
    Path("out/predict/manifest.json").write_text(json.dumps(manifest))
    assert "contains results; --overwrite replaces them" in run("predict")[2]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"command": "predict"}'])
def test_a_half_written_manifest_does_not_count(run, text):
    run("predict")
    Path("out/predict/manifest.json").write_text(text)
    code, printed, _ = run("predict")
    assert (code, printed) == (2, "")


def test_a_result_without_one_of_its_files_does_not_count(run):
    run("predict")
    Path("out/predict/summary.json").unlink()
    line = "trackslip: out/predict holds a result without its summary.json; --overwrite runs it"
    assert run("predict")[2].startswith(line)
    assert run("predict", "--overwrite")[0] == 0


def test_a_failed_check_fails_again(run, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.predict.Table.print", lambda table: sys.exit(1))
        assert run("predict")[0] == 1
    assert run("predict")[0] == 1


def test_a_command_that_only_prints_reads_no_stored_result(run):
    run("predict")
    by_hand = run("predict", "--turns", "10", "--measured", "8")
    assert by_hand[0] == 0
    assert "wheel_separation_multiplier" in by_hand[1]
    assert run("predict")[0] == 0


def test_a_summary_counts_without_its_computing_times(run, log):
    run(*IDENTIFY)
    evaluate = ("evaluate", "mine.csv", "--law", "out/identify")
    code, printed, _ = run(*evaluate)
    assert code == 0
    run(*IDENTIFY, "--overwrite")
    assert run(*evaluate)[:2] == (0, printed)


def test_the_files_of_a_robot_are_inputs(run, tmp_path):
    write_robot(tmp_path)
    drive = (
        "drive",
        "--robot",
        "mine.toml",
        "--course",
        "flat",
        "--duration",
        "0.2",
        "--speed",
        "0.2",
    )
    assert run(*drive)[0] == 0
    (tmp_path / "mine.urdf").write_text(URDF.replace('mass value="20"', 'mass value="21"'))
    assert "mine.urdf has changed since" in run(*drive)[2]


@pytest.mark.parametrize("module", ["follower.py", "helper.py"])
def test_own_modules_are_inputs(run, tmp_path, monkeypatch, module):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "follower.py").write_text(FOLLOWER)
    (tmp_path / "helper.py").write_text("GAIN = 1.0\n")
    track = ("track", "--controller", "follower:Mine", "--localization", "truth")
    try:
        assert run(*track)[0] == 0
        assert run(*track)[0] == 0
        (tmp_path / module).write_text((tmp_path / module).read_text() + "# changed\n")
        assert f"{module} has changed since" in run(*track)[2]
    finally:
        for name in ("follower", "helper"):
            sys.modules.pop(name, None)


def test_a_bag_that_joins_a_folder_is_an_input(run, tmp_path):
    run("wander", "--drives", "1", "--duration", "20", "--bag")
    (bag,) = Path("out/wander/bags").iterdir()
    shutil.copytree(bag, tmp_path / "mine" / "one")
    identify = ("identify", "mine", "--half-gauge", "0.168", "--sprocket-radius", "0.06")
    assert run(*identify)[0] == 0
    assert run(*identify)[0] == 0
    shutil.copytree(bag, tmp_path / "mine" / "two")
    assert "mine has changed since" in run(*identify)[2]


class ClosedPipe:
    """A stream that nobody reads."""

    encoding = "utf-8"

    def write(self, text):
        raise BrokenPipeError

    flush = write


def test_output_is_kept_when_nobody_reads_it():
    output = RecordedOutput(ClosedPipe())
    print("all of it", file=output)
    assert "".join(output.parts) == "all of it\n"
    with pytest.raises(BrokenPipeError):
        output.finish()
