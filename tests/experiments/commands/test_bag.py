"""`trackslip bag`, and the options of `identify` for bags."""

import numpy as np
import pyarrow.parquet
import pytest
from bags import in_order, joints_of, odometry, pose_with_covariance, poses_of, write_bag
from wandered import wandered

import trackslip as package
from experiments.cli import main, parse
from experiments.commands.identify import source_of
from trackslip.logs.schema import COLUMNS

LOG = wandered(duration=20.0)
GEOMETRY = "--half-gauge 0.168 --sprocket-radius 0.06"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_bag(folder / "run", "foxglove", in_order(joints_of(LOG), poses_of(LOG)))
    motors = joints_of(LOG, names=("x1", "x2"), topic="/motors")
    both = in_order(motors, joints_of(LOG), poses_of(LOG, pose_with_covariance), poses_of(LOG), poses_of(LOG, odometry))
    write_bag(folder / "doubtful", "mcap", both)
    return folder


def test_topics_are_listed_with_what_they_are_for(folder, capsys):
    main(["bag", str(folder / "run.mcap")])
    printed = capsys.readouterr().out
    assert "run.mcap: 19.9 s" in printed
    rows = {line.split()[0]: line for line in printed.splitlines() if line.strip().startswith("/")}
    assert rows["/joint_states"].split()[1:5] == ["sensor_msgs/JointState", "400", "20.0", "0.05"]
    assert "* encoders" in rows["/joint_states"]
    assert "encoders: /joint_states, left left_wheel, right right_wheel\nposes: /slam/pose" in printed
    assert "* poses: measured poses" in rows["/slam/pose"]


def test_doubts_are_listed_not_refused(folder, capsys):
    main(["bag", str(folder / "doubtful")])
    printed = capsys.readouterr().out
    assert "warning:" in printed
    assert "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC" in printed
    assert "poses: odometry, perhaps from the wheels" in printed
    main(["bag", str(folder / "doubtful"), "--poses", "/slam/pose"])
    assert "choose with" not in capsys.readouterr().out


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_the_log_is_written_with_units_and_not_replaced_unasked(folder, tmp_path, refused, capsys, suffix):
    file = tmp_path / f"log{suffix}"
    command = ["bag", str(folder / "run.mcap"), "--export", str(file)]
    main(command)
    assert f"{file}: 1 run(s), 400 rows" in capsys.readouterr().out
    (log,) = package.load(file)
    (read,) = package.load(folder / "run.mcap")
    for name in ("time", "omega", "pose"):
        np.testing.assert_array_equal(getattr(log, name), getattr(read, name))
    if suffix == ".parquet":
        for field in pyarrow.parquet.read_schema(file):
            assert field.metadata[b"unit"].decode() == COLUMNS[field.name].unit
    assert f"log{suffix}: exists already; --overwrite replaces it" in refused(*command)
    main([*command, "--overwrite"])
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bag {0}/none.mcap", "none.mcap: no such file or folder"),
        ("bag {0}/run.mcap --export log.txt", "export = 'log.txt': must be a file that ends in .parquet or .csv"),
        ("bag {0}/run.mcap --left a", "right = None: must be given where left is"),
        ("bag {0}/run.mcap --left a,,b --right c", "left = 'a,,b': must be names of joints, separated by"),
        ("bag {0}/doubtful --export x.csv", "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC"),
        (f"identify {{0}}/doubtful {GEOMETRY}", "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC"),
        (f"identify {{0}}/run.mcap {GEOMETRY} --poses /scan", "it has no topic '/scan'; its topics are /joint_states"),
        (f"identify {{0}}/run.mcap {GEOMETRY} --where a=1", "holds bags, not runs of a sweep"),
    ],
)
def test_what_is_refused(folder, refused, line, message):
    assert message in refused(*line.format(folder).split())


def test_identify_takes_what_it_is_told(folder):
    options = ("--encoders", "/motors", "--left", "x2", "--right", "x1", "--reversed", "both", "--poses", "/amcl_pose")
    source = source_of(parse(["identify", str(folder / "doubtful"), *GEOMETRY.split(), *options]))
    (log,) = source.logs
    np.testing.assert_allclose(log.omega[1:], -LOG.omega[1:, ::-1], atol=1e-9)
    assert source.taken == ("encoders: /motors, left x2, right x1; poses: /amcl_pose (as asked for)",)


def test_export_and_view_read_bags_too(folder, tmp_path, capsys):
    main(["export", str(folder / "run.mcap"), "--csv", "--out", str(tmp_path / "run.csv")])
    assert package.load(tmp_path / "run.csv")[0].run == "run"
    assert "1 run(s), 400 rows" in capsys.readouterr().out
