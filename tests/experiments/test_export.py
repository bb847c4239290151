"""`trackslip export`: runs as CSV."""

import csv

import numpy as np
import pytest

import trackslip as package
from experiments.cli import main, parse
from experiments.identify.config import source_of
from trackslip.logs.logfile import RUNS
from trackslip.logs.schema import COLUMNS


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "grid"
    main(["grid", "--radii", "0.5", "1", "--speeds", "0.1", "0.2", "--duration", "8", "--out", str(folder)])
    return folder


def test_csv_holds_every_digit_and_the_units_are_beside_it(grid, tmp_path, capsys):
    file = tmp_path / "new" / "all.csv"
    main(["export", str(grid), "--csv", "--out", str(file)])
    for before, after in zip(package.load(grid), package.load(file), strict=True):
        assert after.run == before.run
        np.testing.assert_array_equal(after.pose, before.pose)
        np.testing.assert_array_equal(after.truth.twist, before.truth.twist)
    with file.open(newline="") as text:
        header = next(csv.reader(text))
    with file.with_suffix(".columns.csv").open(newline="") as text:
        about = list(csv.DictReader(text))
    assert [row["column"] for row in about] == header
    assert all(row["unit"] == COLUMNS[row["column"]].unit and row["description"] for row in about)
    assert sorted(path.name for path in file.parent.iterdir()) == ["all.columns.csv", "all.csv"]
    assert "4 runs" in capsys.readouterr().out


def test_identify_reads_it_with_the_options_that_are_printed(grid, tmp_path, capsys):
    main(["export", str(grid), "--csv", "--out", str(tmp_path / "all.csv")])
    command = capsys.readouterr().out.splitlines()[-1].split()
    assert command[:2] == ["trackslip", "identify"]
    from_csv, from_parquet = (
        source_of(parse(options)).sampling.samples
        for options in (command[1:], ["identify", str(grid), "--motion", "arc"])
    )
    np.testing.assert_allclose(from_csv.slip, from_parquet.slip, rtol=1e-12)


def test_runs_are_listed_and_chosen_ones_go_beside_their_file(grid, tmp_path, capsys):
    main(["export", str(grid)])
    printed, names = capsys.readouterr().out, [log.run for log in package.load(grid)]
    assert all(name in printed for name in names)
    (tmp_path / RUNS).write_bytes((grid / RUNS).read_bytes())
    main(["export", str(tmp_path / RUNS), "--csv", "--run", names[1]])
    assert [log.run for log in package.load(tmp_path / "runs.csv")] == names[1:2]


def test_a_file_is_replaced_only_when_asked_and_never_the_one_that_is_read(grid, tmp_path, refused, capsys):
    (tmp_path / "log.csv").write_text("mine")
    command = ["export", str(grid), "--csv", "--out", str(tmp_path / "log.csv")]
    assert "log.csv: exists already; --overwrite replaces it" in refused(*command)
    main([*command, "--overwrite"])
    assert len(package.load(tmp_path / "log.csv")) == 4
    capsys.readouterr()
    assert "a file other than the one being read" in refused("export", "log.csv", "--csv", "--overwrite")
    assert "run = 'none': must be one of 'radius=0.5 speed=0.1'," in refused("export", str(grid), "--run", "none")
