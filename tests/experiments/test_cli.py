import json
import os
import pty
import shutil
import subprocess
import sys
import typing

import numpy as np
import pytest

from experiments.cli import main
from experiments.options import world as config
from trackslip.logs.logfile import read_runs, write_csv
from trackslip.motion.methods import MOTION_METHODS

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
GEOMETRY = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")


def test_small_grid_then_identify_then_csv(trackslip, tmp_path, capsys):
    grid = trackslip("grid", *SMALL, "--seed", "3")
    assert {path.name for path in grid.folder.iterdir()} == {
        "manifest.json",
        "runs.parquet",
        "summary.json",
        "table.parquet",
    }
    assert "4 runs of 8 s" in grid.printed
    assert grid.manifest["seed"] == 3
    assert grid.summary["radius"]["commanded"] == [0.6, 1.5]
    assert grid.summary["radius"]["published"] == [None, 2.05]
    runs = read_runs(grid.folder / "runs.parquet")
    assert [log.run for log in runs] == [f"radius={r} speed={v}" for r in (0.6, 1.5) for v in (0.1, 0.2)]

    found = trackslip("identify", str(grid.folder))
    assert (found.folder / "report.html").read_text().startswith("<!")
    offset = found.summary["slip_laws"]["icr_radius"]["values"]["offset"]
    assert offset == pytest.approx(0.0445, abs=0.005)
    assert "icr_radius" in found.printed

    # a real robot's log: the same without truth and metadata
    write_csv([log for log in runs], tmp_path / "full.csv")
    rows = (tmp_path / "full.csv").read_text().splitlines()
    header = rows[0].replace('"', "").split(",")
    wanted = [header.index(name) for name in ("run", "t", "omega_l", "omega_r", "x", "y", "phi")]
    (tmp_path / "real.csv").write_text("\n".join(",".join(row.split(",")[k] for k in wanted) for row in rows))
    real = trackslip("identify", str(tmp_path / "real.csv"), *GEOMETRY)
    for name in ("exponential", "icr", "icr_radius"):
        ours, theirs = (s.summary["slip_laws"][name]["values"] for s in (real, found))
        for key in ours:
            # without the flag every pose counts as measured: the few bridged ones change little
            assert ours[key] == pytest.approx(theirs[key], rel=0.05, abs=0.002)
    capsys.readouterr()


def test_every_motion_method_is_an_option_and_has_its_errors(trackslip):
    assert set(typing.get_args(config.Motion)) == set(MOTION_METHODS)
    result = trackslip("grid", *SMALL[:-1], "20", "--motion", "butterworth")
    errors = result.summary["slip_error"]
    assert set(errors) == {"outer", "inner", *MOTION_METHODS}
    assert errors["outer"] == errors["butterworth"]["outer"]
    for name, most in (("arc", 0.0006), ("butterworth", 0.004)):
        for track in ("outer", "inner"):
            assert abs(errors[name][track]["bias"]) + errors[name][track]["std"] < most
    offsets = [
        trackslip("identify", str(result.folder), "--motion", name).summary["slip_laws"]["icr_radius"]["values"][
            "offset"
        ]
        for name in ("arc", "butterworth")
    ]
    assert offsets[0] == pytest.approx(offsets[1], abs=0.003)


def test_same_seed_same_files_another_seed_others(trackslip, tmp_path):
    tables = []
    for seed, threads in ((5, 1), (5, 2), (6, 1)):
        grid = trackslip("grid", *SMALL, "--seed", str(seed), "--threads", str(threads))
        tables.append((grid.folder / "runs.parquet").read_bytes())
        shutil.rmtree(grid.folder)
    one, two, other = tables
    assert one == two
    assert one != other


def test_a_run_does_not_depend_on_its_neighbours(trackslip):
    both = read_runs(trackslip("grid", *SMALL).folder / "runs.parquet")
    alone = read_runs(trackslip("grid", "--radii", "0.6", "--speeds", "0.2", "--duration", "8").folder / "runs.parquet")
    np.testing.assert_array_equal(alone[0].pose, both[1].pose)
    np.testing.assert_array_equal(alone[0].covariance, both[1].covariance)


def test_steady_samples_of_a_real_robot(trackslip, tmp_path):
    twist = np.column_stack([np.full(6, 0.2), 0.2 * np.array([1.5, 0.8, 0.4, -0.5, -1.0, 0.1])])
    surface = twist[:, :1] + np.array([-1, 1]) * (0.3 + 0.06) * twist[:, 1:]
    table = np.column_stack([surface / 0.08, twist])
    rows = "\n".join(",".join(map(repr, map(float, row))) for row in table)
    (tmp_path / "samples.csv").write_text("omega_l,omega_r,v,w\n" + rows)
    result = trackslip("identify", str(tmp_path / "samples.csv"), "--half-gauge", "0.3", "--sprocket-radius", "0.08")
    assert result.summary["slip_laws"]["icr"]["values"]["offset"] == pytest.approx(0.06)
    assert result.summary["samples"] == 6
    assert (result.folder / "runs.parquet").is_file()


def test_laws_whose_fit_ends_at_a_limit_are_told_of(trackslip, tmp_path):
    rows = "".join(f"{3 - k / 2},{3 + k / 2},0.2,{0.07 * k}\n" for k in (1, -1, 2, -2, 3, 4))
    (tmp_path / "samples.csv").write_text("omega_l,omega_r,v,w\n" + rows)
    result = trackslip("identify", str(tmp_path / "samples.csv"), "--half-gauge", "0.3", "--sprocket-radius", "0.08")
    assert any("law hyperbola: the 6 samples don't determine pole" in line for line in result.summary["warnings"])


@pytest.mark.parametrize("controller", ["feedforward", "linear"])
@pytest.mark.parametrize("localization", ["plate", "line", "truth"])
def test_track(trackslip, controller, localization):
    options = ("--controller", controller, "--compensation", "icr", "--localization", localization)
    circle = ("--reference", "circle", "--circle-duration", "14", "--circle-radius", "1.0")
    result = trackslip("track", *options, *circle)
    (row,) = result.summary["tracking"]
    assert (row["controller"], row["compensation"], row["localization"]) == (controller, "icr", localization)
    assert row["rms_position"] < 0.05
    assert row["rms_position_after_12s"] > 0


def test_track_takes_a_start_and_laws(trackslip):
    identified = trackslip("identify", str(trackslip("grid", *SMALL).folder)).folder
    result = trackslip(
        "track", "--reference", "circle", "--circle-duration", "6", "--start", "-1.5", "0.2", "0.0",
        "--compensation", "exponential", "--laws", str(identified),
    )  # fmt: skip
    log = read_runs(result.folder / "runs.parquet")[0]
    np.testing.assert_allclose(log.truth.pose[0], [-1.5, 0.2, 0.0], atol=1e-9)
    assert result.manifest["config"]["start"] == [-1.5, 0.2, 0.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "Expected one of"),
        (("paint",), "COMMAND = 'paint': must be one of grid, identify, "),
        (("grid", "--colour", "red"), "--colour, red; trackslip grid --help lists what there is"),
        (("grid", "--out", ""), "--out = '': must be something"),
        (("grid", "--radii", "1", "½"), "--radii = '1 ½': must be numbers"),
        (("grid", "--seed", "1.5"), "--seed = '1.5': must be an integer"),
        (("grid", "--seed"), "Missing value for argument '--seed'"),
        (("grid", "--radius-error", "x"), "--radius-error = 'x': must be a number"),
        (("bench", "--sizes", "1", "many"), "--sizes = '1 many': must be integers"),
        (("track", "--start", "1", "2"), "--start = '1 2': must be X Y PHI"),
        (("track", "--localization", "eye"), "'--localization'. Expected one of ('plate', 'line', 'truth')"),
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
        (("track", "--circle-speed", "1e-9"), "circle_speed = 1e-09: must be at least 0.001 m/s"),
        (("identify", "x" * 300), "path = 'xxx"),
        (("grid", "--scanner.rate", "2"), "scanner.rate = 2.0: must be at least 5 Hz"),
        (("grid", "--radius-error", "9"), "radius_error = 9.0: must be from -0.5 to 0.5"),
        (("reproduce", "--radii", "1"), "radii = (1.0,): must be at least two"),
        (("grid", "--duration", "long"), "--duration = 'long': must be a number"),
        (("grid", "--seed", "-1"), "seed = -1"),
        (("grid", "--threads", "-1"), "threads = -1"),
        (("grid", "--ground.across", "0"), "ground.across = 0.0: must be a finite number > 0"),
        (("grid", "--scanner.noise", "-0.1"), "scanner.noise = -0.1"),
        (("grid", "--scanner.rate", "33"), "scanner.rate = 33.0"),
        (("reproduce", "--drive.period", "0.0025"), "drive.period = 0.0025: must be a multiple of the physics step"),
        (("track", "--controller", "pid"), "controller = 'pid': must be one of feedforward"),
        (("track", "--compensation", "magic"), "compensation = 'magic': must be one of none, published"),
        (("track", "--start", "0", "nan", "0"), "start = nan"),
        (("track", "--circle-duration", "0"), "circle_duration = 0.0"),
        (("track", "--laws", "nowhere.json"), "nowhere.json: No such file"),
        (("identify",), "PATH"),
        (("identify", "nowhere.csv"), "nowhere.csv: no such file"),
        (("identify", ".", "--settle", "-1"), "settle = -1.0"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused(*arguments)


TRACE = "run,t,omega_l,omega_r,x,y,phi\n" + "".join(f"a,{k / 20},2,3,{k / 100},0,0\n" for k in range(200))


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (TRACE, (), "half_gauge = None: must be given with --half-gauge"),
        (TRACE.replace("0.5,0,0", "nan,0,0"), GEOMETRY, "row 51, column x: 'nan' is not a finite number"),
        (TRACE.replace("0.5,0,0", "oops,0,0"), GEOMETRY, "row 51, column x: 'oops' is not a number"),
        (TRACE.replace("omega_r", "omega_right"), GEOMETRY, "column omega_r is missing"),
        ("a,b\n1,2\n", GEOMETRY, "needs the columns"),
        (TRACE.replace(",", ";"), GEOMETRY, "must be separated by commas"),
        (TRACE.replace(",", ";").replace(".", ","), GEOMETRY, "must be separated by commas"),
        ("omega_l,omega_r,v,w\n1,2,0.1,x\n", GEOMETRY, "row 1, column w: 'x' is not a number"),
        ("omega_l,omega_r,v,w\n0,2,0.1,0.2\n", GEOMETRY, "stands still"),
        ("omega_l,omega_r,v,w\n1,1,0.06,0\n", GEOMETRY, "determine"),
        (TRACE[: TRACE.index("a,1.0")], GEOMETRY, "too short"),
    ],
)
def test_bad_logs_get_one_line(refused, tmp_path, text, options, message):
    path = tmp_path / "log.csv"
    path.write_text(text)
    assert message in refused("identify", str(path), *options)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(refused, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    assert "can't be written" in refused("grid", *SMALL, "--out", str(locked / "out"))


def test_a_folder_that_cannot_be_made(refused, monkeypatch):
    """The same for root, whom no permission stops."""

    def deny(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("experiments.storage.results.tempfile.mkdtemp", deny)
    assert "out = 'new/below': can't be written (Permission denied)" in refused("grid", *SMALL, "--out", "new/below")


def test_an_output_path_that_is_a_file(refused, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "can't be written" in refused("grid", *SMALL, "--out", str(tmp_path / "file"))
    assert "can't be written" in refused("grid", *SMALL, "--out", str(tmp_path / "file" / "below"))
    assert (tmp_path / "file").read_text() == "mine"


def test_an_interrupted_command_leaves_nothing(tmp_path, monkeypatch, capsys):
    def interrupt(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("experiments.driving.grid_runs.open_loop", interrupt)
    with pytest.raises(SystemExit) as stop:
        main(["grid", *SMALL, "--out", str(tmp_path / "a" / "b")])
    assert stop.value.code == 130
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err


def test_older_results_are_replaced_and_other_files_left(trackslip, tmp_path):
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid" / "notes.txt").write_text("mine")
    (tmp_path / "grid" / "summary.json").write_text("old")
    result = trackslip("grid", *SMALL)
    assert (result.folder / "notes.txt").read_text() == "mine"
    assert json.loads((result.folder / "summary.json").read_text())["radius"]


def test_one_line_on_a_terminal_too(tmp_path):
    """tyro draws boxes in colours where it finds a terminal."""
    parent, child = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color"}
    for option, value, message in (("--radii", "-1", "radii = -1.0"), ("--ground.across", "0", "ground.across = 0.0")):
        command = [sys.executable, "-m", "experiments", "grid", option, value]
        done = subprocess.run(command, stdout=child, stderr=subprocess.PIPE, text=True, env=environment, check=False)
        assert done.returncode == 2
        assert done.stderr.startswith(f"trackslip: {message}: must be")
        assert done.stderr.count("\n") == 1
    os.close(parent)
    os.close(child)


def test_runs_that_cannot_be_used_are_stored_and_named(trackslip):
    """A short-sighted scanner loses the faster run before it is steady."""
    grid = ("--radii", "3.0", "--speeds", "0.05", "0.25", "--duration", "10")
    result = trackslip("grid", *grid, "--scanner.max-range", "1.5")
    assert len(read_runs(result.folder / "runs.parquet")) == 2
    (warning,) = result.summary["warnings"]
    assert "speed=0.25" in warning
    assert warning in result.printed
    assert None in result.summary["radius"]["observed"]


def test_identify_takes_the_steady_runs_of_a_reproduction(trackslip):
    folder = trackslip("reproduce", *SMALL).folder
    result = trackslip("identify", str(folder))
    assert result.summary["samples"] == 4
    assert result.manifest["seed"] == 0
    assert len(result.manifest["model_sha256"]) == 64


def test_nothing_old_is_left_beside_new_results(trackslip, tmp_path):
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid" / "report.html").write_text("of another command")
    assert not (trackslip("grid", *SMALL).folder / "report.html").exists()


def test_help_starts_no_simulator():
    code = (
        "import sys, contextlib\nfrom experiments.cli import main\n"
        "with contextlib.suppress(SystemExit): main(['grid', '--help'])\n"
        "print([m for m in ('mujoco', 'scipy', 'matplotlib', 'rerun') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "--radii" in done.stdout
