"""Resuming grids that were interrupted, damaged or changed, and runs that fail."""

import io
import json
import shutil
from functools import partial

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sweeps import SHORT, SWEEP, fragile, logs

from experiments.cli import main
from experiments.common import sweep as engine
from experiments.common.manifest import made_by
from experiments.common.parts import StoredPart, StoredParts
from experiments.grid.config import PARTS
from experiments.simulate.grid_runs import drive_cells
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.logs.logfile import read_runs


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A folder with the parts of a grid, interrupted after its last run."""
    folder = tmp_path_factory.mktemp("driven") / "stopped"

    def stop(*_):
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StoredParts, "gather", stop)
        with pytest.raises(SystemExit):
            main(["grid", *SHORT, "--out", str(folder)])
    return folder


@pytest.fixture
def stopped(driven, tmp_path):
    return shutil.copytree(driven, tmp_path / "out")


def rewritten(change, content):
    """A Parquet file with another table, and all its checksums."""
    file = io.BytesIO()
    pq.write_table(change(pq.read_table(io.BytesIO(content))), file, write_page_checksum=True)
    return file.getvalue()


def numbered(table):
    return table.set_column(0, "run", pa.array(range(len(table))))


def twice(table):
    return table.append_column("t", table.column("t"))


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_is_stored_is_not_driven_again(trackslip, monkeypatch):
    first = trackslip("grid", *SWEEP)
    content = (first.folder / "runs.parquet").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr("experiments.grid.runs.drive_cells", None)
        again = trackslip("grid", *SWEEP)
        assert (again.folder / "runs.parquet").read_bytes() == content
        assert again.summary["timing"]["taken"] == 8
        part = trackslip("grid", *SHORT, "--vary", "friction_ratio=1.0")
        assert len(logs(part.folder)) == 2
    whole = trackslip("grid", *SWEEP)
    assert whole.summary["timing"]["taken"] == 2
    assert (whole.folder / "runs.parquet").read_bytes() == content
    assert not (whole.folder / PARTS).exists()
    (whole.folder / "runs.parquet").unlink()
    assert trackslip("grid", *SWEEP).summary["timing"]["driven"] == 8


def test_runs_of_other_code_are_refused_but_by_force(trackslip, refused, tmp_path, monkeypatch):
    out = ("--out", str(tmp_path / "out"))
    trackslip("grid", *SHORT, *out)
    now = made_by()
    for change, named in (({"code": "0"}, "trackslip's code"), ({"versions": {"mujoco": "9.9"}}, "mujoco (")):
        with monkeypatch.context() as patch:
            changed = now | change | {"versions": now["versions"] | change.get("versions", {})}
            patch.setattr("experiments.common.parts.made_by", lambda c=changed: c)
            message = refused("grid", *SHORT, *out)
            assert f"2 of these runs were driven before a change of {named}" in message
            assert trackslip("grid", *SHORT, *out, "--force").summary["timing"]["taken"] == 2
            assert trackslip("grid", *SHORT, "--seed", "9", *out).summary["timing"]["driven"] == 2  # others aren't
        trackslip("grid", *SHORT, *out, "--no-resume")


def test_a_worker_with_other_code_is_refused(tmp_path, monkeypatch):
    parts = StoredParts(tmp_path, PARTS)
    with monkeypatch.context() as worker:
        worker.setattr("experiments.common.parts.made_by", lambda: {"code": "other"})
        part = StoredPart.of([{"run": "a run", "id": "its id", "error": None}], [])
    with pytest.raises(TrackslipError, match="a worker has other code"):
        parts.keep(part)


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("runs.parquet", lambda content: content[:-100], "runs.parquet: damaged; --no-resume"),
        ("summary.json", lambda content: content[:300], "summary.json: not JSON"),
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
    assert trackslip("grid", *SHORT, *out, "--no-resume").summary["timing"]["driven"] == 2


def test_an_interrupted_grid_goes_on(trackslip, tmp_path, monkeypatch, capsys):
    arguments = ("grid", *SHORT, "--vary", "scanner.noise=0.001,0.002,0.003,0.004")
    whole = trackslip(*arguments, "--out", str(tmp_path / "whole")).folder
    real, driven = engine.drive_fleet, []

    def twice(*arguments, **options):
        if len(driven) == 2:
            raise KeyboardInterrupt
        driven.append(1)
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(engine, "drive_fleet", twice)
        with pytest.raises(SystemExit) as stop:
            main([*arguments, "--out", str(tmp_path / "part")])
    assert stop.value.code == 130
    assert "interrupted with 4 of 8 runs driven; the same command resumes" in capsys.readouterr().err
    spoilt = min((tmp_path / "part" / PARTS).glob("*.parquet"))
    spoilt.write_bytes(spoilt.read_bytes()[:5000])
    result = trackslip(*arguments, "--out", str(tmp_path / "part"))
    assert result.summary["timing"]["taken"] == 2
    for name in ("runs.parquet", "table.parquet"):
        assert (whole / name).read_bytes() == (result.folder / name).read_bytes()


@pytest.mark.parametrize(
    ("kind", "spoil"),
    [
        *(("json", lambda _, text=text: text) for text in (b"", b"{}", b"[]", b'{"runs": 1, "made_by": 2}')),
        ("json", lambda content: content[:200]),
        ("json", lambda content: content.replace(b'"radius": 0.6', b'"radius": 0.7')),
        ("json", lambda content: content.replace(b'"run": "radius=0.6', b'"run": ["radius=0.6"], "x": "')),
        ("parquet", partial(rewritten, numbered)),
        ("parquet", partial(rewritten, twice)),
        ("parquet", lambda content: content[:1000]),
        ("parquet", lambda content: content[:1000] + bytes([content[1000] ^ 1]) + content[1001:]),
    ],
)
def test_damaged_parts_are_driven_again(stopped, kind, spoil):
    """Truncated or foreign rows, rows that were changed, truncated logs, a single flipped bit, and other tables."""
    (file,) = (stopped / PARTS).glob("*.json")
    ids = {row["id"] for row in json.loads(file.read_text())["runs"]}
    file = file.with_suffix(f".{kind}")

    def found():
        parts = StoredParts(stopped, PARTS)
        parts.take(ids, force=False)
        return {*parts}

    assert found() == ids
    file.write_bytes(spoil(file.read_bytes()))
    assert not found()


def test_a_grid_that_fails_or_ends_leaves_the_parts_of_another(stopped, refused, trackslip):
    out = ("--out", str(stopped))
    before = contents(stopped)
    assert "all 2 runs fail" in refused("grid", *SHORT, "--vary", "slope=0.9", *out)
    assert contents(stopped) == before
    trackslip("grid", *SHORT, "--seed", "7", *out)
    assert trackslip("grid", *SHORT, *out).summary["timing"]["taken"] == 2
    assert not (stopped / PARTS).exists()


def test_a_run_that_is_taken_under_another_name_is_noted_under_it(trackslip):
    """A robot that barely moves gives no sample."""
    slow = ("grid", "--radii", "1.5", "--speeds", "0.001", *SHORT[-4:])
    first = trackslip(*slow, "--ground.slope", "0.05").summary
    again = trackslip(*slow, "--vary", "slope=0.05").summary
    assert again["timing"]["taken"] == 1
    assert first["runs"][0]["note"].startswith("run 'radius=1.5 speed=0.001' left out: ")
    assert again["warnings"] == [again["runs"][0]["note"]]
    assert again["warnings"][0].startswith("run 'radius=1.5 speed=0.001 slope=0.05' left out: ")


# runs that fail


def test_failed_runs_are_rows_and_are_driven_again(trackslip):
    """On a slope steeper than its friction angle a robot can't be parked."""
    arguments = ("grid", *SHORT, "--vary", "slope=0,0.9")
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
    (failure,) = result.summary["failures"]
    assert failure["run"] == "radius=0.25 speed=0.2 robot.half_gauge=0.3"
    assert failure["error"].startswith("radii = 0.25: must be greater than the half gauge, 0.3 m")


def test_a_failing_run_does_not_take_its_fleet_with_it(trackslip, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("experiments.grid.runs.drive_cells", fragile)
        result = trackslip("grid", *SWEEP)
    assert {row["error"] for row in result.summary["runs"]} == {None, "MemoryError: too wide"}
    assert len(logs(result.folder)) == 4
    assert len(logs(trackslip("grid", *SWEEP).folder)) == 8


def test_a_run_that_fails_leaves_a_recording(trackslip, monkeypatch):
    def tips_over(cells, worlds, *rest):
        logs = drive_cells(cells, worlds, *rest)
        if wide := [log for log in logs if log.metadata["radius"] == 1.5]:
            error = RunFailedError(f"run {wide[0].run!r}: the robot tips over")
            error.logs = logs
            raise error
        return logs

    monkeypatch.setattr("experiments.grid.runs.drive_cells", tips_over)
    result = trackslip("grid", *SHORT, "--rrd")
    assert [log.metadata["radius"] for log in read_runs(result.folder / "runs.parquet")] == [0.6]
    recordings = {path.name for path in (result.folder / "recordings").iterdir()}
    assert recordings == {"radius=0.6_speed=0.2.rrd", "radius=1.5_speed=0.2.rrd"}
