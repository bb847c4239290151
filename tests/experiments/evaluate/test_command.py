import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from command_runs import ran
from drives import EXACT, GEOMETRY, ICR, STILL, drive_log, without_poses
from plain_drives import identified_from, wandered

from experiments.common.plain_json import write_json
from experiments.evaluate.config import Config
from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.log import parts, read_log
from trackslip.errors import TrackslipError
from trackslip.identification.result import identification_to_json
from trackslip.kinematics import RobotGeometry
from trackslip.laws.file import save_laws
from trackslip.logs.logfile import read_runs, write_parquet

SIZE = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("mine")
    write_json(
        out / "summary.json", identification_to_json(identified_from(wandered(duration=15.0)))
    )
    return str(out)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    out = tmp_path_factory.mktemp("logs")
    save_laws(out / "true.json", {"icr_radius": ICR}, GEOMETRY)
    logs = [drive_log(seed, duration, EXACT, STILL) for seed, duration in ((0, 90.0), (1, 20.0))]
    write_parquet(logs, out / "two.parquet")
    write_parquet([without_poses(logs[0], logs[0].is_valid)], out / "no_poses.parquet")
    (out / "steady.csv").write_text("omega_l,omega_r,v,w\n2,3,0.15,0.1\n")
    return out


@pytest.fixture(scope="module")
def wander(tmp_path_factory):
    return ran(
        tmp_path_factory.mktemp("wander") / "out", "wander", "--drives", "2", "--duration", "12"
    ).folder


@pytest.mark.usefixtures("with_figures")
def test_the_true_law_is_right_and_none_is_not(trackslip, files):
    true = f"{files / 'true.json'}:icr_radius"
    result = trackslip(
        "evaluate", str(files / "two.parquet"), "--law", true, "--law", "none", "--pdf"
    )
    models = result.summary["models"]
    assert list(models) == ["icr_radius", "none"]
    for lengths in ("after_metres", "after_seconds"):
        assert list(models["none"][lengths]) == ["1", "2", "5", "10"]
        for length, errors in models["icr_radius"][lengths].items():
            assert errors["position"]["largest"] < 1e-9
            assert errors["heading"]["largest"] < 1e-9
            assert errors["count"] == models["none"][lengths][length]["count"]
    ahead = models["none"]["after_metres"]["10"]
    assert ahead["position"]["mean"] > 0.03 * ahead["way"]
    assert ahead["position"]["median"] < ahead["position"]["p90"] < ahead["position"]["largest"]
    assert "icr_radius, after 10 m, compared with no slip compensation" in result.printed
    assert sorted(file.name for file in result.folder.iterdir()) == [
        "figures",
        "manifest.json",
        "report.html",
        "summary.json",
        "trajectories",
    ]


@pytest.mark.parametrize(
    ("measured", "better"),
    [((1, 1, np.nan), "position"), ((np.nan, np.nan, 1), "heading")],
    ids=["positions", "headings"],
)
def test_positions_or_headings_alone_are_predicted(trackslip, files, tmp_path, measured, better):
    log, _ = read_runs(files / "two.parquet")
    write_parquet([replace(log, pose=log.pose * measured)], tmp_path / "log.parquet")
    true = f"{files / 'true.json'}:icr_radius"
    result = trackslip("evaluate", str(tmp_path / "log.parquet"), "--law", true, "--law", "none")
    ahead = {name: model["after_seconds"]["10"] for name, model in result.summary["models"].items()}
    assert ahead["icr_radius"][better]["median"] < 0.2 * ahead["none"][better]["median"]
    other = "heading" if better == "position" else "position"
    assert ahead["none"][other] is None
    assert f"{better} " in result.printed.split("compared with no slip compensation: ")[1]
    for file in (result.folder / "trajectories").iterdir():
        assert np.isfinite(np.loadtxt(file)).all()


@pytest.mark.parametrize("options", [("--law", "TRUE", "--law", "none"), ("--folds", "2")])
def test_the_headings_of_a_gyro_alone_are_predicted(trackslip, files, tmp_path, options):
    _, log = read_runs(files / "two.parquet")
    rate = ICR.twist(log.omega, GEOMETRY)[:, 1]
    gyro = rate + np.random.default_rng(0).normal(0.01, 0.002, len(rate))
    every = np.ones(len(rate), bool)
    alone = replace(without_poses(log, every), gyro=gyro, beyond=None)
    write_parquet([alone], tmp_path / "log.parquet")

    options = [option.replace("TRUE", f"{files / 'true.json'}:icr_radius") for option in options]
    result = trackslip("evaluate", str(tmp_path / "log.parquet"), *SIZE, *options)
    models = result.summary["models"]
    none = models["none" if "none" in models else "today"]["after_seconds"]["5"]
    errors = models["icr_radius"]["after_seconds"]["5"]
    assert errors["heading"]["median"] < 0.1 * none["heading"]["median"]
    assert errors["position"] is None
    assert not any("with gyro" in name for name in models)


def test_sensor_and_clock_are_the_identified_ones_unless_given(trackslip, files, folder):
    log = str(files / "two.parquet")
    known = json.loads((files.parent / folder / "summary.json").read_text())
    extras = known["drive"]["laws"][known["best"]]["extras"]
    result = trackslip("evaluate", log, "--law", folder, "--law", "none")
    for model in result.summary["models"].values():
        place = {
            "x": extras["sensor_x"],
            "y": extras["sensor_y"],
            "yaw": pytest.approx(extras["sensor_yaw"]),
        }
        assert model["sensor"] == place
        assert model["clock_offset"] == extras["clock_offset"] - extras["lag"]
    assert result.summary["geometry"] == known["geometry"]
    both = ("--law", f"{folder}:icr", "--law", f"{folder}:icr_radius")
    models = trackslip("evaluate", log, *both).summary["models"]
    icr = models["icr"]
    icr_radius = models["icr_radius"]
    assert icr["sensor"]["x"] == known["drive"]["laws"]["icr"]["extras"]["sensor_x"]
    assert icr["after_seconds"]["1"]["count"] == icr_radius["after_seconds"]["1"]["count"]
    options = ("--sensor", "0.1", "-0.2", "0.3", "--clock-offset", "0.05")
    given = trackslip("evaluate", log, "--law", folder, *options)
    (model,) = given.summary["models"].values()
    assert model["sensor"] == {"x": 0.1, "y": -0.2, "yaw": 0.3}
    assert model["clock_offset"] == 0.05


def test_names_of_drives_become_names_of_files(trackslip, tmp_path):
    log = drive_log(6, 8.0, EXACT, STILL)
    file = tmp_path / "log.parquet"
    write_parquet([replace(log, run=name) for name in ("../a b", "a_b", "é")], file)
    result = trackslip("evaluate", str(file), *SIZE, "--rrd", "--out", str(tmp_path / "out"))
    trajectories = result.folder / "trajectories"
    names = sorted(file.name for file in trajectories.iterdir())
    assert names == [
        "a_b_2_measured.tum",
        "a_b_2_none.tum",
        "a_b_measured.tum",
        "a_b_none.tum",
        "é_measured.tum",
        "é_none.tum",
    ]
    assert np.isfinite(np.loadtxt(trajectories / names[0])).all()
    assert len(list((result.folder / "recordings").glob("*.rrd"))) == 3


@pytest.mark.slow
def test_simulated_drives_return_and_another_ground_fits_worse(wander, tmp_path):
    def errors(*options):
        result = ran(
            tmp_path / f"out{len(options)}", "evaluate", str(wander), "--robot", "shipped", *options
        )
        return {
            name: model["after_seconds"]["5"] for name, model in result.summary["models"].items()
        }

    ahead = errors()
    assert list(ahead) == ["none", "robot"]
    assert ahead["robot"]["position"]["rms"] < 0.06  # the poses' own noise
    assert ahead["robot"]["position"]["rms"] < 0.6 * ahead["none"]["position"]["rms"]
    other = errors("--ground.across", "1.4")
    assert other["robot"]["heading"]["rms"] > 1.5 * ahead["robot"]["heading"]["rms"]


@pytest.mark.slow
def test_folds_fit_laws_gains_and_the_robot_to_the_other_parts(wander, tmp_path):
    options = ("--folds", "2", "--law", "icr_radius", "--law", "none", "--robot", "shipped")
    options += ("--ground.across", "0.9", "--free", "friction_ratio")
    result = ran(tmp_path / "out", "evaluate", str(wander), *options)
    ahead = {name: model["after_seconds"]["5"] for name, model in result.summary["models"].items()}
    assert list(ahead) == ["today", "two_gains", "icr_radius", "none", "robot", "calibrated"]
    assert len({errors["count"] for errors in ahead.values()}) == 1
    heading = {name: errors["heading"]["rms"] for name, errors in ahead.items()}
    assert heading["icr_radius"] < 0.5 * heading["today"]
    assert heading["two_gains"] < 0.8 * heading["today"]
    assert heading["calibrated"] < 0.8 * heading["robot"]
    assert len(result.summary["calibrated"]["folds"]) == 2


def test_errors_of_steady_samples_are_those_of_their_twists(trackslip, files, tmp_path):
    omega = np.array([[2.0, 3.0], [-1.0, 4.0], [3.0, 3.0]] * 4)
    v, w = ICR.twist(omega, GEOMETRY).T
    columns = {"omega_l": omega[:, 0], "omega_r": omega[:, 1], "v": v + 0.01, "w": w + 0.02}
    pq.write_table(pa.table(columns), tmp_path / "steady.parquet")
    true = f"{files / 'true.json'}:icr_radius"
    result = trackslip("evaluate", str(tmp_path / "steady.parquet"), "--law", true)
    errors = result.summary["models"]["icr_radius"]["after_seconds"]["1"]
    assert errors["count"] == len(omega)
    assert errors["heading"]["rms"] == pytest.approx(0.02)
    assert errors["position"]["rms"] == pytest.approx(0.01, rel=0.2)  # and what the turn adds


def test_mistakes_are_told_in_a_line(refused, files, folder):
    log = str(files / "two.parquet")
    for arguments, message in (
        ((log,), "half_gauge = None: must be given (--half-gauge on the command line)"),
        (
            (log, "--law", "x" * 300),
            ": must be none, a folder or file with laws, or with --folds a law of drives",
        ),
        ((log, "--law", f"{folder}:power"), "law = 'power': must be one of none, "),
        ((log, "--law", folder, "--half-gauge", "0.2"), "its laws are for half_gauge = 0.168 m"),
        (
            (log, "--sensor", "0", "0", "9", *SIZE),
            "sensor = 9.0: must be from -3.14159 to 3.14159 rad",
        ),
        (
            (str(files / "no_poses.parquet"), *SIZE),
            "encoders were read at less than two of its poses",
        ),
        (
            (log, *SIZE, "--folds", "2", "--law", "exponential"),
            "law = 'exponential': must be none, a folder or file",
        ),
        ((log, "--law", folder, "--law", folder), "must be all different"),
    ):
        assert message in refused("evaluate", *arguments), arguments


LOGS = Path(__file__).parents[3] / "examples" / "logs"
TOML = (
    'title = "t"\nlog = "log.csv"\nsource = "s"\nlicence = "l"\nrobot = ["husky"]\nground = "ice"\n'
)
BOUND = '[[bounds]]\nrow = "{}"\nquantity = "heading_rms"\nmost = {}\n'


def test_one_command_is_in_one_part_and_parts_are_in_order():
    drives = []
    for k, speed in enumerate([1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 1.0]):
        drives.append(SimpleNamespace(run=str(k), command=np.full((3, 2), speed)))
    np.testing.assert_array_equal(parts(drives, 2, ""), [0, 0, 0, 0, 0, 1, 1, 0])
    np.testing.assert_array_equal(parts(drives, 4, ""), [0, 0, 1, 1, 1, 2, 3, 0])
    said = r"log.csv: has 4 different commands, too few for folds = 5"
    with pytest.raises(TrackslipError, match=said):
        parts(drives, 5, "log.csv")


@pytest.fixture(scope="module")
def three_drives(tmp_path_factory):
    """Drives of 24 s in a log that doesn't state the robot's size."""
    path = tmp_path_factory.mktemp("three") / "log.parquet"
    drives = [wandered(name=name, duration=24.0, seed=ord(name)) for name in "abc"]
    write_parquet([replace(drive, metadata={}) for drive in drives], path)
    return path


@pytest.mark.parametrize(("folds", "count"), [(None, 3), (3, 3), (4, 12)])
def test_drives_are_cut_only_if_they_are_fewer_than_the_folds(three_drives, folds, count):
    source = read_log(Config((three_drives,), folds=folds), three_drives, GEOMETRY)
    assert len(source.logs) == count
    durations = [log.time[-1] - log.time[0] for log in source.logs]
    np.testing.assert_allclose(durations, 72.0 / count, atol=0.15)


def test_options_and_the_known_robot_give_a_size_a_log_lacks(three_drives):
    known = RobotGeometry(0.2, 0.07)
    for options, size in (
        ({}, (0.2, 0.07)),
        ({"half_gauge": 0.168}, (0.168, 0.07)),
        ({"sprocket_radius": 0.06}, (0.2, 0.06)),
        ({"half_gauge": 0.168, "sprocket_radius": 0.06}, (0.168, 0.06)),
    ):
        source = read_log(Config((three_drives,), **options), three_drives, known)
        assert (source.geometry.half_gauge, source.geometry.sprocket_radius) == size
    with pytest.raises(TrackslipError, match="half_gauge"):
        read_log(Config((three_drives,)), three_drives, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TOML + "colour = 1", "colour is unknown; known are title, log"),
        (
            TOML.replace("log.csv", "gone.csv"),
            "log = .*gone.csv.*: must be a file beside the data set",
        ),
        (TOML + "folds = 1", "folds = 1: must be"),
        (TOML + 'free = ["wax"]', "free = 'wax': must be one of half_gauge"),
        (TOML + BOUND.format("today", -1.0), "most = -1.0: must be"),
        (
            TOML + BOUND.replace("heading_rms", "v").format("today", 1.0),
            "quantity = 'v': must be one of position_",
        ),
    ],
)
def test_a_bad_file_names_field_value_and_what_is_allowed(tmp_path, text, message):
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(TrackslipError, match=message) as caught:
        load_data_set(tmp_path / "mine.toml")
    assert "mine.toml" in str(caught.value)


def test_files_beside_a_data_set_are_found_and_names_stay(tmp_path):
    for name in ("log.csv", "robot.toml", "soil.toml", "laws.json"):
        (tmp_path / name).write_text("")
    text = TOML.replace('["husky"]', '["husky", "robot.toml"]').replace('"ice"', '"soil.toml"')
    text += 'law = ["none", "laws.json", "laws.json:icr", "absent.json:icr"]\n'
    (tmp_path / "mine.toml").write_text(text)
    found = load_data_set(tmp_path / "mine.toml")
    assert found.log == tmp_path / "log.csv"
    assert found.robot == ("husky", str(tmp_path / "robot.toml"))
    assert found.ground == str(tmp_path / "soil.toml")
    laws = str(tmp_path / "laws.json")
    assert found.law == ("none", laws, f"{laws}:icr", "absent.json:icr")


@pytest.fixture(scope="module")
def data_set(tmp_path_factory):
    """A data set of the first commands of a Husky, whose bounds all hold."""
    folder = tmp_path_factory.mktemp("husky")
    table = pq.read_table(LOGS / "husky_windows.parquet")
    pq.write_table(table.filter(pc.less(table["command"], 4)), folder / "log.parquet")
    text = TOML.replace("log.csv", "log.parquet").replace('"ice"', '"asphalt"')
    text += (
        'law = ["icr_radius"]\n' + BOUND.format("icr_radius", 0.5) + BOUND.format("two_gains", 0.5)
    )
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"


def test_a_data_set_states_models_and_bounds(data_set, tmp_path, refused):
    result = ran(tmp_path / "out", "evaluate", str(data_set))
    models = result.summary["models"]
    heading = {
        name: model["after_seconds"]["1"]["heading"]["rms"] for name, model in models.items()
    }
    assert list(heading) == ["today", "two_gains", "icr_radius", "robot"]
    assert heading["two_gains"] < 0.6 * heading["today"]
    for check, model in zip(result.summary["checks"], ("icr_radius", "two_gains"), strict=True):
        assert check["name"] == f"t: {model}, heading_rms"
        assert check["value"] == heading[model]
        assert check["bound"] == 0.5
        assert check["unit"] == "rad"
        assert check["holds"]
    assert "2 of 2 checks passed" in result.printed
    assert "Best after 1 s: " in (result.folder / "report.html").read_text()
    lines = data_set.read_text().splitlines(keepends=True)
    without_robot = [line for line in lines if not line.startswith(("robot", "ground"))]
    laws = data_set.with_name("laws.toml")
    laws.write_text("".join(without_robot) + BOUND.format("robot", 0.5))
    line = refused("evaluate", str(laws), *SIZE)
    assert "bounds = 'robot': must be one of today, two_gains, icr_radius" in line


@pytest.mark.slow
def test_a_missed_bound_ends_with_1_and_the_page_is_written(data_set, tmp_path):
    path = data_set.with_name("broken.toml")
    path.write_text(data_set.read_text().partition("[[")[0] + BOUND.format("today", 0.05))
    with pytest.raises(SystemExit) as stop:
        ran(tmp_path / "out", "evaluate", str(path))
    assert stop.value.code == 1
    assert (tmp_path / "out" / "report.html").exists()
