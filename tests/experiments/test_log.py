import csv
import re
from dataclasses import replace

import numpy as np
import pyarrow.parquet
import pytest
from bags import (
    in_order,
    joints_of,
    odometry,
    pose_with_covariance,
    poses_of,
    write_bag,
    write_session,
)
from beside import drive, room, teleoperated
from bombs import repeated_numbers
from plain_drives import wandered

import trackslip as package
from experiments.cli import main, parse
from experiments.identify.command import source_of
from trackslip.bags.open import open_bags
from trackslip.logs.logfile import read_runs
from trackslip.logs.schema import COLUMNS

LOG = wandered(duration=20.0)
ROBOT = "--half-gauge 0.168 --sprocket-radius 0.06"
PLATE = ("--plate", "0.6x0.04")


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_bag(folder / "run", "foxglove", in_order(joints_of(LOG), poses_of(LOG)))
    motors = joints_of(LOG, names=("x1", "x2"), topic="/motors")
    both = in_order(
        motors,
        joints_of(LOG),
        poses_of(LOG, pose_with_covariance),
        poses_of(LOG),
        poses_of(LOG, odometry),
    )
    write_bag(folder / "doubtful", "mcap", both)
    return folder


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results") / "grid"
    main(
        [
            "grid",
            "--radii",
            "0.5",
            "1",
            "--speeds",
            "0.1",
            "0.2",
            "--duration",
            "8",
            "--out",
            str(folder),
        ]
    )
    return folder


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    session = drive(teleoperated(np.random.default_rng(1), 20.0, 4.0), things=room(), beams=241)
    return session, write_session(tmp_path_factory.mktemp("scanned") / "run", "foxglove", session)


def words(printed, start):
    return next(line.split() for line in printed.splitlines() if line.strip().startswith(start))


def test_topics_uses_columns_runs_and_doubts_are_shown(bags, capsys):
    main(["log", str(bags / "run.mcap")])
    printed = capsys.readouterr().out
    assert words(printed, "/joint_states")[1:] == [
        "sensor_msgs/JointState",
        "400",
        "20.0",
        "0.05",
        "*",
        "encoders",
    ]
    assert words(printed, "/slam/pose")[-4:] == ["*", "poses:", "measured", "poses"]
    assert words(printed, "omega_l")[1:3] == ["rad/s", "sprocket"]
    assert words(printed, "run  4")[1:5] == ["400", "19.95", "0.05", str(LOG.is_valid.sum())]
    assert "encoders: /joint_states, left " in printed
    main(["log", str(bags / "doubtful")])
    printed = capsys.readouterr().out
    assert "/motors" in printed
    assert "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC" in printed


def test_a_bag_of_unknown_messages_is_shown_by_its_topics(tmp_path, capsys):
    odd = [("/odd", "odd_msgs/msg/Odd", 10**18 + k, {"text": "x"}) for k in range(3)]
    main(["log", str(write_bag(tmp_path / "run", "mcap", odd))])
    printed = capsys.readouterr().out
    assert words(printed, "/odd")[1:3] == ["odd_msgs/Odd", "3"]
    assert "warning: " in printed
    assert "no encoders" in printed


def test_a_bag_without_messages_is_refused_in_one_line(tmp_path, refused):
    assert refused("log", str(write_bag(tmp_path / "run", "mcap", []))).endswith(
        "run: it has no messages"
    )


def test_a_topics_table_says_that_no_message_was_recorded(tmp_path, capsys, monkeypatch):
    """As in a bag whose index counts messages that its data lack."""
    path = write_bag(tmp_path / "run", "mcap", joints_of(LOG))
    (bag,) = open_bags(path)
    empty = replace(bag, read=lambda topics, decode: iter(()))
    monkeypatch.setattr("experiments.log.open_bags", lambda path, max_memory: [empty])
    monkeypatch.setattr("trackslip.bags.drives.open_bags", lambda path, max_memory: [empty])
    main(["log", str(path)])
    printed = " ".join(capsys.readouterr().out.split())  # a long path wraps the title
    assert "run: no messages" in printed
    assert "warning: " in printed


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_bag_is_written_exactly_and_not_replaced_unasked(bags, tmp_path, refused, capsys, suffix):
    file = tmp_path / "new" / f"log{suffix}"
    command = ["log", str(bags / "run.mcap"), "--out", str(file)]
    main(command)
    assert f"{file}: 1 run, 400 rows" in capsys.readouterr().out
    (written,) = package.load(file)
    (read,) = package.load(bags / "run.mcap")
    for name in ("time", "omega", "pose"):
        np.testing.assert_array_equal(getattr(written, name), getattr(read, name))
    if suffix == ".parquet":
        for field in pyarrow.parquet.read_schema(file):
            assert field.metadata[b"unit"].decode() == COLUMNS[field.name].unit
    before = sorted(file.parent.iterdir())
    main(command)
    assert f"{file}: 1 run, 400 rows" in capsys.readouterr().out
    file.write_text("mine")
    line = f"log{suffix}: exists already, with other content; --overwrite replaces it"
    assert line in refused(*command)
    assert file.read_text() == "mine"
    main([*command, "--overwrite"])
    assert sorted(file.parent.iterdir()) == before


def test_a_csv_has_units_beside_it_and_identify_reads_it(grid, tmp_path, capsys):
    file = tmp_path / "all.csv"
    main(["log", str(grid), "--out", str(file)])
    command = capsys.readouterr().out.splitlines()[-1].split()
    for before, after in zip(package.load(grid), package.load(file), strict=True):
        assert after.run == before.run
        np.testing.assert_array_equal(after.truth.twist, before.truth.twist)
    with file.open(newline="") as text, file.with_suffix(".columns.csv").open(newline="") as units:
        header = next(csv.reader(text))
        about = list(csv.DictReader(units))
    assert [row["column"] for row in about] == header
    assert all(row["unit"] == COLUMNS[row["column"]].unit and row["description"] for row in about)
    assert command[:2] == ["trackslip", "identify"]
    of_csv = source_of(parse(command[1:]), file)
    of_grid = source_of(parse(["identify", str(grid), "--motion", "arc"]), grid)
    slip = of_grid.sampling.samples.slip
    np.testing.assert_allclose(of_csv.sampling.samples.slip, slip, rtol=1e-12)


def test_a_plate_in_scans_is_found_by_log_and_by_identify(scanned, tmp_path, capsys):
    session, bag = scanned
    file = tmp_path / "located.parquet"
    main(["log", str(bag), *PLATE, "--scan", "/scan", "--out", str(file)])
    printed = capsys.readouterr().out
    place = "run: scanner at x = 0.000 m, y = 0.000 m, yaw = 0.00°, noise "
    assert place in printed
    noise = float(printed.partition(place)[2].split()[0])  # [mm]
    assert noise == pytest.approx(5.0, abs=0.2)
    assert "warning" not in printed
    identified = source_of(parse(["identify", str(bag), *PLATE, *ROBOT.split()]), bag)
    assert "the plate's in /scan" in identified.taken[0]
    for (log,) in (read_runs(file), identified.logs):
        valid = log.is_valid
        assert valid.sum() > 0.85 * len(session.time)
        error = log.pose[valid] - session.local(log.time[valid])
        assert np.linalg.norm(error[:, :2], axis=1).max() < 0.03
        assert log.scans is not None


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("log {bags}/none.mcap", "none.mcap: no such file or folder"),
        (
            "log {bags}/run.mcap --out log.txt",
            "out = 'log.txt': must be a file that ends in .parquet or .csv",
        ),
        (
            "log log.csv --out ./log.csv --overwrite",
            "out = 'log.csv': must be a file other than the one being read",
        ),
        (
            "log {bags}/run.mcap --left a,,b --right c",
            "left = 'a,,b': must be names of joints, separated by",
        ),
        (
            "log {bags}/doubtful --out x.csv",
            "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC",
        ),
        (
            "log {scanned} --plate nanx0.1",
            "plate = 'nanx0.1': must be LENGTHxTHICKNESS in m, as in 0.5x0.02, longer",
        ),
        ("log {scanned} --plate 0.6x0.04 --poses /a", "poses = '/a': must be left out with plate"),
        (f"identify {{bags}}/run.mcap {ROBOT} --where a=1", "holds bags, not runs of a sweep"),
    ],
)
def test_what_is_refused(bags, scanned, refused, line, message):
    assert message in refused(*line.format(bags=bags, scanned=scanned[1]).split())


@pytest.mark.parametrize("source", ["slam", "gnss"])
def test_a_drive_and_its_bag_are_read_alike(trackslip, source):
    result = trackslip("wander", "--source", source, "--duration", "10", "--bag")
    (log,) = package.load(result.folder)
    (again,) = package.load(result.folder / "bags")
    elapsed = log.time - log.time[0]
    nanosecond = 1e-9
    np.testing.assert_allclose(again.time - again.time[0], elapsed, atol=2 * nanosecond)
    np.testing.assert_allclose(again.omega[1:], log.omega[1:], atol=1e-4)
    np.testing.assert_array_equal(again.is_valid, log.is_valid)
    places = log.pose[log.is_valid, :2]
    origin = places[0] if source == "gnss" else 0.0  # fixes have the first one as origin
    np.testing.assert_allclose(again.pose[again.is_valid, :2], places - origin, atol=1e-6)


@pytest.mark.parametrize("command", ["log", "identify", "evaluate", "view"])
def test_commands_that_read_logs_take_the_memory_they_may(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    path = repeated_numbers(tmp_path / "log.parquet")
    arguments = [command, str(path), "--max-memory", "100MB"]
    if command in ("identify", "evaluate"):
        arguments += ROBOT.split()
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    allowed = r"must be at most 100 MB \(max_memory\)\n$"
    assert re.search(rf"^trackslip: .*log\.parquet: reading .*{allowed}", capsys.readouterr().err)
    assert [file.name for file in tmp_path.iterdir()] == ["log.parquet"]


def test_a_limit_that_is_no_size_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["log", str(tmp_path), "--max-memory", "8"])
    assert "max_memory = '8': must be a size of at least 1 MB" in capsys.readouterr().err
