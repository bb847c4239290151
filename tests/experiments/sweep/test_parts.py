"""The folder of a sweep: what is kept of one that was stopped, and what is told from damage."""

import errno
import json
import shutil

import pytest

from experiments.cli import main, parse
from experiments.commands.grid import PARTS
from experiments.storage.lock import locked
from experiments.sweep.parts import Part, Parts
from experiments.sweep.plan import plan
from experiments.sweep.table import RunRow, is_row
from trackslip.errors import OutputError, TrackslipError

LIKE = ("grid", "--radii", "1.5", "--duration", "4", "--executor", "inline")
SHORT = (*LIKE, "--speeds", "0.1", "0.2")


def stop(*_):
    raise KeyboardInterrupt


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A folder with the parts of a grid that was stopped when all was driven, and one where it was finished."""
    folder = tmp_path_factory.mktemp("driven")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Parts, "gather", stop)
        with pytest.raises(SystemExit):
            main([*SHORT, "--out", str(folder / "stopped")])
    main([*SHORT, "--out", str(folder / "finished")])
    return folder


@pytest.fixture
def stopped(driven, tmp_path):
    return shutil.copytree(driven / "stopped", tmp_path / "out")


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_grid_that_fails_leaves_the_parts_of_another(stopped, refused):
    before = contents(stopped)
    assert "all 2 runs fail" in refused(*SHORT, "--vary", "slope=0.9", "--out", str(stopped))
    assert contents(stopped) == before


def test_parts_are_deleted_before_another_command_can_come(trackslip, tmp_path, monkeypatch):
    real, seen, folder = Parts.discard, [], tmp_path / "grid"

    def discard(parts):
        with pytest.raises(OutputError, match="another command"), locked(folder):
            pass
        seen.append((folder / "manifest.json").exists())
        real(parts)

    monkeypatch.setattr(Parts, "discard", discard)
    trackslip(*SHORT, "--out", str(folder))
    assert seen == [True]
    assert not (folder / PARTS).exists()


def spoil(path, change):
    """Change a row of a record, or what made it."""
    content = json.loads(path.read_text())
    row = content["runs"][0]
    change(row, content["made_by"])
    path.write_text(json.dumps(content))


DAMAGES = (
    lambda row, by: row.pop("run"),
    lambda row, by: row.update(id=[1]),
    lambda row, by: row.update(v="fast"),
    lambda row, by: row.update(saturated=True),
    lambda row, by: by.update({row["made_by"]: 5}),
    lambda row, by: by[row["made_by"]].update(versions=None),
    lambda row, by: row.update(run="another"),
)


def found(folder, ids):
    """Which of the runs a grid takes from a folder."""
    parts = Parts(folder, PARTS, is_row)
    parts.take(ids, force=False)
    return {id for id in ids if id in parts}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_rows_of_a_part_are_driven_again(stopped, damage):
    (record,) = (stopped / PARTS).glob("*.json")
    ids = {run.id for run in plan(parse(SHORT))}
    assert found(stopped, ids) == ids
    spoil(record, damage)
    assert not found(stopped, ids)


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_rows_of_results_are_refused(driven, refused, tmp_path, damage):
    folder = shutil.copytree(driven / "finished", tmp_path / "out")
    spoil(folder / "summary.json", damage)
    before = contents(folder)
    assert "damaged; --no-resume" in refused(*SHORT, "--out", str(folder))
    assert contents(folder) == before


def test_a_run_that_is_taken_under_another_name_is_noted_under_it(trackslip):
    """A robot that stands still, nearly, gives no sample."""
    slow = (*LIKE, "--speeds", "0.001")
    first = trackslip(*slow, "--ground.slope", "0.05").summary
    again = trackslip(*slow, "--vary", "slope=0.05").summary
    assert again["timing"]["taken"] == 1
    assert first["runs"][0]["note"].startswith("run 'radius=1.5 speed=0.001' left out: ")
    assert again["runs"][0]["note"].startswith("run 'radius=1.5 speed=0.001 slope=0.05' left out: ")
    assert again["warnings"] == [again["runs"][0]["note"]]


def test_files_that_change_while_it_drives_are_recorded_as_driven(trackslip, tmp_path, monkeypatch):
    from experiments.sweep import drive as command

    ground, real = tmp_path / "ground.toml", command.drive_fleet
    ground.write_text("along = 0.5\nacross = 0.6\n")

    def drive(*arguments, **options):
        ground.unlink()
        return real(*arguments, **options)

    monkeypatch.setattr(command, "drive_fleet", drive)
    assert trackslip(*SHORT, "--ground", str(ground)).manifest["ground"]["along"] == 0.5


@pytest.mark.parametrize(
    ("step", "says"),
    [
        ("sweep.parts.write_whole", ""),
        ("sweep.table.write_table", " with 2 of 2 runs driven; the same command resumes"),
    ],
)
def test_a_full_disk_leaves_whole_parts_or_nothing(capsys, tmp_path, monkeypatch, step, says):
    """There is no space for the part; or there is, but not for the results made of it."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(f"experiments.{step}", full)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main([*SHORT, "--out", str(out)])
    assert stopped.value.code == 2
    line = f"trackslip: out = {str(out)!r}: can't be written (No space left on device){says}"
    assert capsys.readouterr().err.splitlines()[-1] == line
    assert out.exists() == bool(says)
    assert {path.suffix for path in contents(out)} == ({".json", ".parquet"} if says else set())


def test_a_worker_with_other_code_is_refused(tmp_path, monkeypatch):
    parts = Parts(tmp_path, PARTS)
    with monkeypatch.context() as worker:
        worker.setattr("experiments.sweep.parts.made_by", lambda: {"code": "other"})
        part = Part.of([RunRow("a run", "its id", {})], [])
    with pytest.raises(TrackslipError, match="a worker has other code"):
        parts.keep(part)
