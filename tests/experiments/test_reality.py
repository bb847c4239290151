"""`trackslip reality` on shipped logs, and on one of your own."""

from math import cos, sin

import pytest
from command_runs import ran

import experiments.evaluate.reality as predictions


def copied(folder, name, **changes):
    """A file of a data set beside a log elsewhere, with other values of some fields, without bounds or calibration."""
    lines = (predictions.FOLDER / f"{name}.toml").read_text().partition("[[bounds]]")[0].splitlines()
    log = next(line for line in lines if line.startswith("log")).split('"')[1]
    values = {"log": f'"{predictions.FOLDER / log}"', "free": "[]", **changes}
    lines = [f"{key} = {values[key]}" if (key := line.partition(" ")[0]) in values else line for line in lines]
    (folder / "mine.toml").write_text("\n".join(lines) + "\n")
    return folder / "mine.toml"


def thinned(folder, **changes):
    """A data set of every 8th row of a MAXXII, in two folds."""
    header, *rows = (predictions.FOLDER / "maxxii.csv").read_text().splitlines(keepends=True)
    (folder / "thinned.csv").write_text("".join([header, *rows[::8]]))
    return copied(folder, "maxxii", log='"thinned.csv"', folds=2, apart="[]", **changes)


def test_steady_rows_are_predicted_as_well_as_their_scatter_allows(tmp_path):
    result = ran(tmp_path / "out", "reality", str(copied(tmp_path, "maxxii")))
    rows = {name: one["0.0"] for name, one in result.summary["datasets"]["mine"]["rows"].items()}
    assert 1e3 * rows["scatter"]["v"] == pytest.approx(4.4, abs=0.1)
    assert 1e3 * rows["scatter"]["w"] == pytest.approx(21.4, abs=0.3)
    assert 1e3 * rows["scatter"]["w_rest"] == pytest.approx(17.7, abs=0.2)
    assert rows["scatter"]["w"] < rows["icr_sides"]["w"] < rows["two_gains"]["w"] < rows["today"]["w"]
    assert rows["data_sheet"]["w"] < 0.5 * rows["today"]["w"]
    assert result.summary["datasets"]["mine"]["best_law"] == "icr_sides"
    assert result.summary["checks"] == []
    assert "checks" not in result.printed
    page = (result.folder / "report.html").read_text()
    assert "Apache-2.0" in page
    assert "D by kind of turn" in page


def test_a_calibrated_robot_predicts_better_than_its_data_sheet_with_the_same_bits(tmp_path):
    def rows(name, *options):
        path = thinned(tmp_path, free='["contact_length"]')
        return ran(tmp_path / name, "reality", str(path), *options).summary["datasets"]["mine"]["rows"]

    found = rows("one", "--threads", "1")
    assert found["calibrated"]["0.0"]["w"] < 0.97 * found["data_sheet"]["0.0"]["w"]
    assert found == rows("two", "--threads", "2")


def test_drives_are_predicted_on_the_same_pairs_with_the_same_bits(tmp_path):
    def rows(name, *options):
        path = copied(tmp_path, "grass")
        return ran(tmp_path / name, "reality", str(path), *options).summary["datasets"]["mine"]["rows"]

    found = rows("one", "--threads", "1")
    for ahead in ("1.0", "1.8", "5.0"):
        errors = {name: one[ahead] for name, one in found.items()}
        assert len({one["count"] for one in errors.values()}) == 1
        assert errors["data_sheet"]["position_median"] < errors["two_gains"]["position_median"]
        assert errors["turn_loss_sides"]["position_median"] < errors["today"]["position_median"] / 2
    assert found == rows("two", "--threads", "2")


@pytest.mark.slow
def test_the_simulator_is_calibrated_on_the_shipped_logs(tmp_path):
    result = ran(tmp_path / "out", "reality", "maxxii", "grass")
    assert all(check["holds"] for check in result.summary["checks"])
    assert len(result.summary["checks"]) == 3
    drives = result.summary["datasets"]["grass"]["rows"]
    assert len({one["1.0"]["count"] for one in drives.values()}) == 1
    assert drives["calibrated"]["1.0"]["position_median"] < drives["two_gains"]["1.0"]["position_median"]


def test_a_bound_that_does_not_hold_ends_with_1(tmp_path, capsys):
    path = thinned(tmp_path)
    bound = '[[bounds]]\nrow = "{}"\nquantity = "w"\nmost = 0.05\n'
    held, broken = path.read_text() + bound.format("laws"), path.read_text() + bound.format("today")
    path.write_text(held)
    assert "1 of 1 checks hold" in ran(tmp_path / "out", "reality", str(path)).printed
    path.write_text(broken)
    with pytest.raises(SystemExit) as stop:
        ran(tmp_path / "out", "reality", str(path))
    assert stop.value.code == 1
    assert (tmp_path / "out" / "report.html").exists()


def test_logs_that_hold_too_little_are_refused(refused, tmp_path):
    def of(log):
        (tmp_path / "log.csv").write_text(log)
        return refused("reality", str(copied(tmp_path, "maxxii", log='"log.csv"', folds=2)))

    steady = "omega_l,omega_r,v,w\n2,3,0.2,0.1\n3,2,0.2,-0.1\n3,3,0.25,0\n"
    assert "log.csv: has 3 usable rows, too few for folds = 2" in of(steady)
    assert "log.csv: has 1 different command, too few for folds = 2" in of(steady[:31])
    drive = "run,t,omega_l,omega_r,x,y,phi\n" + "".join(f"a,{k / 20},2,2,{k * 0.00856},0,0\n" for k in range(40))
    assert "log.csv: has 1 different command, too few for folds = 2" in of(drive)
    arc = "".join(f"a,{k / 20},2,2.5,{sin(k / 200):.5f},{1 - cos(k / 200):.5f}\n" for k in range(400))
    assert "log.csv: run 'a 1' has no headings (phi)" in of("run,t,omega_l,omega_r,x,y\n" + arc)


def test_without_the_shipped_logs_a_file_must_be_named(failing, monkeypatch, tmp_path):
    monkeypatch.setattr(predictions, "FOLDER", tmp_path)
    assert "dataset = (): must be a .toml file" in failing("reality")
