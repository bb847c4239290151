"""`trackslip grid` over axes: names, ids, resuming, failures, executors."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.cli import main, parse
from experiments.commands.grid import PARTS
from experiments.driving.grid_runs import drive_cells, drive_grid
from experiments.driving.world import World
from experiments.options.reproduce import ReproduceConfig
from experiments.parallel.executors import WorkersFailedError
from experiments.storage.manifest import made_by
from experiments.sweep.choose import chosen
from experiments.sweep.plan import fleets, plan
from sim.run_recorder import RunFailedError
from trackslip.logs.logfile import read_runs

SHORT = ("--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "4", "--executor", "inline")
SWEEP = (*SHORT, "--friction-ratio", "1.0", "1.2", "--seeds", "0", "1")


def logs(folder):
    return {log.metadata["id"]: log for log in read_runs(folder / "runs.parquet")}


def planned(*arguments):
    return plan(parse(["grid", *arguments]))


def test_every_combination_is_a_run_with_a_row(trackslip):
    result = trackslip("grid", *SWEEP, "--grounds", "stone", "ice")
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert len(rows) == len(logs(result.folder)) == 16
    assert len({row["id"] for row in rows}) == len({row["run"] for row in rows}) == 16
    for row in rows:
        log = logs(result.folder)[row["id"]]
        assert log.run == row["run"]
        ground, along = log.metadata["ground"], {"stone": 0.7, "ice": 0.12}[row["ground"]]
        assert ground["along"] == along
        assert ground["across"] == pytest.approx(row["friction_ratio"] * along)
        assert (log.metadata["seed"], log.metadata["radius"]) == (row["seed"], row["radius"])
        assert row["slip_l"] == pytest.approx(row["true_slip_l"], abs=0.01)
        assert row["omega_r"] == pytest.approx(log.omega[-20:, 1].mean(), rel=1e-3)
    assert [grid["runs"] for grid in result.summary["grids"]] == [2] * 8
    assert "16 runs in 8 grids" in result.printed
    schema = pq.read_schema(result.folder / "table.parquet")
    for field in schema:
        assert set(field.metadata) == {b"unit", b"description"}, field.name
        assert field.metadata[b"description"], field.name


def test_runs_keep_their_ids_and_bits_when_others_come(trackslip, tmp_path):
    few = logs(trackslip("grid", *SHORT, "--slope", "0.05").folder)
    many = trackslip("grid", *SHORT, "--slope", "0", "0.05", "--seeds", "3", "0", "--vary", "drive.lag=0.05,0.08",
                     "--no-resume").folder  # fmt: skip
    more = logs(many)
    assert set(few) < set(more)
    for key, log in few.items():
        for ours, theirs in ((log.pose, more[key].pose), (log.truth.pose, more[key].truth.pose)):
            np.testing.assert_array_equal(ours, theirs)
    noise = [log.pose[:, :2] - log.truth.pose[:, :2] for log in more.values()]
    assert len({part.tobytes() for part in noise}) == len(more)


def test_a_run_is_the_same_however_it_is_asked_for():
    (one,) = planned("--radii", "1", "--speeds", "0.1", "--ground", "ice", "--ground.slope", "0.02", "--seed", "7")
    (same,) = planned("--radii", "1", "--speeds", "0.1", "--grounds", "ice", "--slope", "0.02", "--seeds", "7")
    assert (one.id, one.cell.key) == (same.id, same.cell.key)
    assert one.name == "radius=1.0 speed=0.1"
    assert same.name == "radius=1.0 speed=0.1 ground=ice seed=7 slope=0.02"
    usual = {"--radii": "1", "--speeds": "0.1", "--ground": "ice", "--ground.slope": "0.02", "--seed": "7"}
    ids = {one.id}
    for option, value in (
        ("--seed", "8"),
        ("--radii", "1.1"),
        ("--scanner.noise", "0.006"),
        ("--drive.lag", "0.06"),
        ("--obstacles", "posts"),
        ("--motion", "arc"),
        ("--radius-error", "0.01"),
        ("--duration", "20"),
    ):
        (other,) = planned(*(word for pair in (usual | {option: value}).items() for word in pair))
        ids.add(other.id)
    assert len(ids) == 9


ONE = ("--radii", "0.6", "--speeds", "0.2", "--duration", "4", "--executor", "inline")


@pytest.mark.parametrize("world", [(), ("--ground", "ice", "--scanner.noise", "0.01")])
def test_methods_are_compared_on_the_same_scans(trackslip, tmp_path, world):
    """Whatever evaluates them, the ranges are the same to the bit; another world has noise of its own."""
    found = []
    for k, options in enumerate(((), ("--motion", "arc"), ("--localization", "line"), ("--seed", "1"))):
        folder = trackslip("grid", *ONE, *world, *options, "--out", str(tmp_path / str(k))).folder
        found += read_runs(folder / "runs.parquet")
    usual, *same, other = (log.scans.cluster.range for log in found)
    for ranges in same:
        np.testing.assert_array_equal(ranges, usual)
    assert not np.array_equal(other, usual, equal_nan=True)
    assert len({log.metadata["id"] for log in found}) == 4


def test_a_grid_in_the_shipped_world_meets_the_scans_of_reproduce(trackslip):
    options = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "4", "--executor", "inline")
    stored = logs(trackslip("grid", *options, "--motion", "arc").folder)
    config = ReproduceConfig(radii=(0.6, 1.5), speeds=(0.1, 0.2), duration=4.0)
    for log, own in zip(stored.values(), drive_grid(config, World.of(config)), strict=True):
        ours, theirs = log.scans.cluster, own.scans.cluster  # padded to different widths
        np.testing.assert_array_equal(ours.range[ours.hit], theirs.range.astype(np.float32)[theirs.hit])  # as stored


def test_any_option_varies_and_only_equal_models_share_a_fleet(tmp_path):
    (tmp_path / "sweep.toml").write_text(
        'radius = [1.0, 2.0]\nspeed = 0.1\nground = ["stone", "gravel"]\n[robot]\nhalf_gauge = [0.15, 0.168]\n'
        "[scanner]\nnoise = [0.005, 0.01]\n"
    )
    runs = planned("--sweep", str(tmp_path / "sweep.toml"), "--vary", "random_phase=false,true")
    assert len(runs) == 32
    assert len(fleets(runs, 2)) == 8
    for fleet in fleets(runs, 2):
        assert len({(run.specification.parameters, run.config.scanner, run.config.random_phase) for run in fleet}) == 1
    narrow = [run for run in runs if run.axes["robot.half_gauge"] == 0.15]
    assert {run.world(1).robot.geometry.half_gauge for run in narrow} == {0.15}
    assert len(narrow) == 16


@pytest.mark.parametrize(
    ("workers", "count", "largest"), [(1, 8, 125), (2, 8, 125), (3, 12, 84), (4, 16, 63), (64, 16, 63)]
)
def test_fleets_are_large_and_yet_every_worker_has_some(workers, count, largest):
    runs = planned("--friction-ratio", *(str(0.8 + 0.01 * k) for k in range(40)))
    parts = fleets(runs, workers)
    assert [run for part in parts for run in part] == runs
    assert len(parts) == count
    assert max(map(len, parts)) == largest


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--vary", "noise"), "vary = 'noise': must be NAME=VALUE,VALUE,..."),
        (("--radii", "1", "--vary", "radius=2,3"), "radii = (1.0,): must be left out where radius is an axis"),
        (
            ("--radii", "0.5", "0.15", "--vary", "robot.half_gauge=0.2,0.3"),
            "radii = 0.15: must be greater than the half gauge, 0.2 m",
        ),
        (("--vary", "colour=red"), "axis = 'colour': must be one of radius, speed, friction_ratio"),
        (("--vary", "scanner.noise=0.1,loud"), "vary scanner.noise = 'loud': must be a number"),
        (("--vary", "scanner.noise=-1"), "scanner.noise = -1.0: must be"),
        (("--vary", "robot.half_gauge=0.2,-1"), "robot.half_gauge = -1.0: must be"),
        (("--vary", "localization=gps"), "vary localization = 'gps': must be plate or line"),
        (("--vary", "drive.encoder_counts=1.5"), "vary drive.encoder_counts = '1.5': must be an integer"),
        (("--vary", "random_phase=maybe"), "vary random_phase = 'maybe': must be true or false"),
        (("--friction-ratio", "1", "1"), "friction_ratio = (1.0, 1.0): must be all different"),
        (("--friction-ratio", "0"), "friction_ratio = 0.0: must be a finite number > 0"),
        (("--friction-ratio", "nan"), "friction_ratio = nan: must be a finite number > 0"),
        (("--slope", "0.1", "--vary", "slope=0.2"), "vary = 'slope': must be an axis that is given once"),
        (("--slope", "-0.1"), "ground.slope = -0.1: must be"),
        (("--grounds", "\udcff.toml"), "must be valid UTF-8"),
        (("--grounds", "moon"), "ground = 'moon': must be one of stone"),
        (("--seeds", "-1"), "seed = -1: must be an integer >= 0"),
        (("--executor", "cloud"), "executor = 'cloud': must be processes, inline, mpi or dask://HOST:PORT"),
        (("--executor", "dask://:"), "executor = 'dask://:': must be processes"),
        (
            ("--vary", "motion=arc", "--vary", "duration=4,6"),
            "--vary is given twice; give it once, with all its values",
        ),
        (("--vary", "rrd=true,false"), "axis = 'rrd': must be one of"),
        (("--friction-ratio", "1.2", "--ground.across", "0.5"), "friction_ratio = (1.2,): must be left out where"),
        (("--friction-ratio", "1.2", "--vary", "ground.across=0.5"), "friction_ratio = (1.2,): must be left out where"),
        (("--jobs", "-1"), "jobs = -1: must be an integer from 0"),
        (("--sweep", "none.toml"), "none.toml: No such file"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("grid", "--duration", "4", *arguments)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("radius = []", "radius = (): must be at least one value"),
        ("radius = [1.0, -1.0]", "radius = -1.0: must be a finite number > 0"),
        ("radius = [[1.0]]", "radius = [1.0]: must be a number"),
        ("speed = [9.0]", "speeds = 9.0: must be at most drive.top_speed"),
        ("colour = [1]", "axis = 'colour'"),
        ("random_phase = [[true]]", "random_phase = [True]: must be true or false"),
        ("radius = [1", "not TOML"),
        ("", "sweep.toml: it has no axis"),
        ("\ufeffradius = [-1.0]", "radius = -1.0: must be"),
        (
            '"scanner.noise" = [0.01]\nscanner = { noise = [0.02] }',
            "'scanner.noise': must be an axis that is given once",
        ),
    ],
)
def test_mistakes_in_a_sweep_file(refused, tmp_path, text, message):
    (tmp_path / "sweep.toml").write_text(text)
    assert message in refused("grid", "--duration", "4", "--sweep", str(tmp_path / "sweep.toml"))


def test_what_is_stored_is_not_driven_again(trackslip, monkeypatch):
    first = trackslip("grid", *SWEEP)
    content = (first.folder / "runs.parquet").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr("experiments.sweep.drive.drive_cells", None)
        again = trackslip("grid", *SWEEP)
        assert (again.folder / "runs.parquet").read_bytes() == content
        assert again.summary["timing"]["taken"] == 8
        part = trackslip("grid", *SHORT, "--friction-ratio", "1.0")
        assert len(logs(part.folder)) == 2
    whole = trackslip("grid", *SWEEP)
    assert whole.summary["timing"]["taken"] == 2
    assert (whole.folder / "runs.parquet").read_bytes() == content
    assert not (whole.folder / PARTS).exists()


def test_runs_of_other_code_are_refused_but_by_force(trackslip, refused, tmp_path, monkeypatch):
    out = ("--out", str(tmp_path / "out"))
    folder = trackslip("grid", *SHORT, *out).folder
    now = made_by()
    for change, named in (({"code": "0"}, "trackslip's code"), ({"versions": {"mujoco": "9.9"}}, "mujoco (")):
        with monkeypatch.context() as patch:
            changed = now | change | {"versions": now["versions"] | change.get("versions", {})}
            patch.setattr("experiments.storage.parts.made_by", lambda c=changed: c)
            message = refused("grid", *SHORT, *out)
            assert f"2 of these runs were driven before a change of {named}" in message
            forced = trackslip("grid", *SHORT, *out, "--force")
            assert forced.summary["timing"]["taken"] == 2
            assert len(trackslip("grid", *SHORT, "--seed", "9", *out).summary["runs"]) == 2  # others aren't refused
        trackslip("grid", *SHORT, *out, "--no-resume")
    assert logs(folder)


def test_failed_runs_are_rows_and_are_driven_again(trackslip, monkeypatch):
    """On a slope steeper than its friction angle a robot can't be parked."""
    arguments = ("grid", *SHORT, "--slope", "0", "0.9")
    result = trackslip(*arguments)
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert [row["error"] is None for row in rows] == [True, True, False, False]
    assert rows[2]["error"].startswith("slope = 0.9: must be less than the friction angle")
    assert rows[2]["slip_l"] is None
    assert len(logs(result.folder)) == 2
    assert [failure["run"] for failure in result.summary["failures"]] == [row["run"] for row in rows[2:]]
    assert "failed: radius=0.6 speed=0.2 slope=0.9: slope = 0.9" in result.printed
    again = trackslip(*arguments)
    assert again.summary["timing"]["taken"] == 2
    assert pq.read_table(result.folder / "table.parquet").to_pylist() == rows


def test_a_radius_too_tight_for_some_robots_is_a_run_that_fails(trackslip):
    result = trackslip("grid", *SHORT[3:], "--radii", "0.25", "1", "--vary", "robot.half_gauge=0.168,0.3")
    failures = [(failure["run"], failure["error"]) for failure in result.summary["failures"]]
    why = "radii = 0.25: must be greater than the half gauge, 0.3 m: else the inner track must stand or reverse"
    assert failures == [("radius=0.25 speed=0.2 robot.half_gauge=0.3", why)]


def fragile(cells, *rest):
    """A fleet of which some radius is too wide."""
    if any(cell.radius == 1.5 for cell in cells):
        raise MemoryError("too wide")
    return drive_cells(cells, *rest)


def test_a_failing_run_does_not_take_its_fleet_with_it(trackslip, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.sweep.drive.drive_cells", fragile)
        result = trackslip("grid", *SWEEP)
    assert {row["error"] for row in result.summary["runs"]} == {None, "MemoryError: too wide"}
    assert len(logs(result.folder)) == 4
    assert len(logs(trackslip("grid", *SWEEP).folder)) == 8


def tips_over(cells, worlds, *rest):
    """A fleet that fails if there is a wide radius in it."""
    logs = drive_cells(cells, worlds, *rest)
    wide = [log for log in logs if log.metadata["radius"] == 1.5]
    if wide:
        error = RunFailedError(f"run {wide[0].run!r}: the robot tips over")
        error.logs = logs
        raise error
    return logs


def test_a_run_that_fails_leaves_a_recording(trackslip, monkeypatch):
    monkeypatch.setattr("experiments.sweep.drive.drive_cells", tips_over)
    result = trackslip("grid", *SHORT, "--rrd")
    assert [log.metadata["radius"] for log in read_runs(result.folder / "runs.parquet")] == [0.6]
    assert {path.name for path in (result.folder / "recordings").iterdir()} == {
        "radius=0.6_speed=0.2.rrd",
        "radius=1.5_speed=0.2.rrd",
    }


def test_recordings_are_left_even_if_every_run_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("experiments.sweep.drive.drive_cells", tips_over)
    with pytest.raises(SystemExit) as stop:
        main(["grid", "--radii", "1.5", *ONE[2:], "--rrd", "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    recordings = tmp_path / "out" / "recordings"
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"trackslip: run 'radius=1.5 speed=0.2': the robot tips over; see {recordings}"
    assert [path.name for path in recordings.iterdir()] == ["radius=1.5_speed=0.2.rrd"]
    assert not (tmp_path / "out" / "runs.parquet").exists()


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("runs.parquet", lambda content: content[:-100], "runs.parquet: damaged; --no-resume"),
        ("summary.json", lambda content: content[:300], "summary.json: not JSON"),
        ("manifest.json", lambda content: content[:300], "manifest.json: not JSON"),
        ("manifest.json", lambda content: content.replace(b'"format": 1', b'"format": 99'), "in format 99; "),
    ],
)
def test_damaged_or_newer_results_are_not_thrown_away(trackslip, refused, tmp_path, name, spoil, message):
    out = ("--out", str(tmp_path / "out"))
    folder = trackslip("grid", *SHORT, *out).folder
    spoilt = spoil((folder / name).read_bytes())
    (folder / name).write_bytes(spoilt)
    assert message in refused("grid", *SHORT, *out, "--seeds", "0", "1")  # at once: there is nothing new
    assert (folder / name).read_bytes() == spoilt
    trackslip("grid", *SHORT, *out, "--no-resume")
    assert len(logs(folder)) == 2


def test_runs_whose_logs_are_gone_are_driven_again(trackslip):
    (trackslip("grid", *SHORT).folder / "runs.parquet").unlink()
    again = trackslip("grid", *SHORT)
    assert again.summary["timing"]["driven"] == len(logs(again.folder)) == 2


def test_what_fails_anew_is_not_taken_from_before(trackslip, monkeypatch):
    trackslip("grid", *SHORT)
    monkeypatch.setattr("experiments.sweep.drive.drive_cells", fragile)
    anew = trackslip("grid", *SHORT, "--no-resume")
    assert [row["error"] for row in anew.summary["runs"]] == [None, "MemoryError: too wide"]


def test_seeds_beyond_64_bits_are_text(trackslip):
    large = 10**20
    table = pq.read_table(trackslip("grid", *SHORT, "--seeds", "1", str(large)).folder / "table.parquet")
    assert set(table["seed"].to_pylist()) == {"1", str(large)}


def test_an_interrupted_grid_goes_on(trackslip, tmp_path, monkeypatch, capsys):
    from experiments.commands import grid as command

    arguments = ("grid", *SHORT, "--vary", "scanner.noise=0.001,0.002,0.003,0.004")
    whole = trackslip(*arguments, "--out", str(tmp_path / "whole")).folder
    real, driven = command.drive, []

    def twice(*arguments, **options):
        if len(driven) == 2:
            raise KeyboardInterrupt
        driven.append(1)
        return real(*arguments, **options)

    monkeypatch.setattr(command, "drive", twice)
    with pytest.raises(SystemExit) as stop:
        main([*arguments, "--out", str(tmp_path / "part")])
    assert stop.value.code == 130
    assert "interrupted with 4 of 8 runs driven; the same command resumes" in capsys.readouterr().err
    assert not (tmp_path / "part" / "runs.parquet").exists()
    monkeypatch.setattr(command, "drive", real)
    spoilt = min((tmp_path / "part" / PARTS).glob("*.parquet"))
    spoilt.write_bytes(spoilt.read_bytes()[:5000])
    result = trackslip(*arguments, "--out", str(tmp_path / "part"))
    assert result.summary["timing"]["taken"] == 2
    for name in ("runs.parquet", "table.parquet"):
        assert (whole / name).read_bytes() == (result.folder / name).read_bytes()


@pytest.mark.parametrize(
    ("stop", "more", "said"),
    [
        (KeyboardInterrupt(), (), "interrupted with 2 of 2 runs driven; the same command resumes"),
        (
            WorkersFailedError("a worker died"),
            ("--no-resume",),
            "a worker died with 2 of 2 runs driven; the same command without --no-resume resumes",
        ),
    ],
)
def test_grids_that_are_stopped_late_say_how_to_go_on(trackslip, tmp_path, monkeypatch, capsys, stop, more, said):
    def gather(*_):
        raise stop

    with monkeypatch.context() as patch:
        patch.setattr("experiments.storage.parts.Parts.gather", gather)
        with pytest.raises(SystemExit):
            main(["grid", *SHORT, *more, "--out", str(tmp_path / "grid")])
    assert said in capsys.readouterr().err
    assert trackslip("grid", *SHORT, "--out", str(tmp_path / "grid")).summary["timing"]["taken"] == 2


def test_a_law_is_identified_from_runs_of_one_setting(trackslip, refused, tmp_path):
    arguments = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8", "--friction-ratio", "1.0", "1.2")
    folder = str(trackslip("grid", *arguments, "--seeds", "0", "1", "--executor", "inline").folder)
    assert "its runs differ in ground (across): choose with --where" in refused("identify", folder)
    assert "where = 'colour=red': must be NAME=VALUE with one of friction_ratio, seed, radius, speed" in refused(
        "identify", folder, "--where", "colour=red"
    )
    assert "where = 'friction_ratio=1.1': must be friction_ratio=one of 1.0, 1.2" in refused(
        "identify", folder, "--where", "friction_ratio=1.1"
    )
    found = trackslip("identify", folder, "--where", "friction_ratio=1.2", "seed=1")
    assert found.summary["samples"] == 4
    assert found.summary["slip_laws"]["icr"]["values"]["offset"] > 0.05  # 40 % more friction across doubles it
    assert {name.split("seed=")[-1] for name in chosen(Path(folder), ["friction_ratio=1", "radius=0.6"])} == {
        "radius=0.6 speed=0.1 friction_ratio=1.0",
        "radius=0.6 speed=0.2 friction_ratio=1.0",
        "1",
    }


def test_choosing_what_is_not_there(trackslip, refused, tmp_path):
    arguments = (*SHORT, "--slope", "0", "0.9", "--vary", "random_phase=true,false")
    folder = trackslip("grid", *arguments).folder
    assert len(chosen(folder, ["random_phase=true", "slope=0"])) == 2
    assert "none of the 4 chosen run(s) is there: they failed" in refused(
        "identify", str(folder), "--where", "slope=0.9"
    )
    samples = tmp_path / "samples.csv"
    samples.write_text("omega_l,omega_r,v,w\n1,2,0.1,0.2\n")
    assert "where = 'slope=0': must be left out" in refused("identify", str(samples), "--where", "slope=0")
