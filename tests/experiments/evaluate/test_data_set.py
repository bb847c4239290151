"""Data sets: their files, parts and bounds, and steady rows of a real robot."""

from pathlib import Path

import numpy as np
import pytest
from command_runs import ran

from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.log import parts
from trackslip.errors import TrackslipError

LOGS = Path(__file__).parents[3] / "examples" / "logs"
TOML = 'title = "t"\nlog = "log.csv"\nsource = "s"\nlicence = "l"\nrobot = ["husky"]\nground = "ice"\n'
BOUND = '[[bounds]]\nrow = "{}"\nquantity = "heading_rms"\nmost = {}\n'


@pytest.mark.parametrize("name", ["maxxii", "husky", "warthog", "ice", "grass"])
def test_shipped_data_sets_can_be_read(name):
    data = load_data_set(LOGS / f"{name}.toml")
    assert data.log.exists()
    assert (data.log.parent / data.licence.split(", ")[1]).exists()


def test_one_command_is_in_one_part_and_parts_are_in_order():
    keys = ["a", "a", "b", "b", "b", "c", "d", "a"]
    np.testing.assert_array_equal(parts(keys, 2, ""), [0, 0, 0, 0, 0, 1, 1, 0])
    np.testing.assert_array_equal(parts(keys, 4, ""), [0, 0, 1, 1, 1, 2, 3, 0])
    with pytest.raises(TrackslipError, match=r"log.csv: has 4 different commands, too few for folds = 5"):
        parts(keys, 5, "log.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TOML + "colour = 1", "colour is unknown; known are title, log"),
        (TOML.replace("log.csv", "gone.csv"), "log = .*gone.csv.*: must be a file beside the data set"),
        (TOML + "folds = 1", "folds = 1: must be"),
        (TOML + "sensor = [1.0]", "sensor = .*: must be x, y and yaw"),
        (TOML + 'free = ["wax"]', "free = 'wax': must be one of half_gauge"),
        (TOML + BOUND.format("wax", 1.0), "bounds = 'wax': must be one of calibrated, laws, robot, today"),
        (TOML + BOUND.format("laws", -1.0), "most = -1.0: must be"),
        (
            TOML + BOUND.replace("heading_rms", "v").format("laws", 1.0),
            "quantity = 'v': must be one of position_median",
        ),
    ],
)
def test_a_bad_file_names_field_value_and_what_is_allowed(tmp_path, text, message):
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(TrackslipError, match=message) as caught:
        load_data_set(tmp_path / "mine.toml")
    assert "mine.toml" in str(caught.value)


@pytest.fixture(scope="module")
def steady(tmp_path_factory):
    """A data set of every 8th row of a MAXXII, whose bounds all hold."""
    folder = tmp_path_factory.mktemp("steady")
    header, *rows = (LOGS / "maxxii.csv").read_text().splitlines(keepends=True)
    (folder / "log.csv").write_text("".join([header, *rows[::8]]))
    text = TOML.replace("husky", "maxxii").replace('"ice"', '"concrete"') + 'free = ["contact_length"]\n'
    text += BOUND.format("laws", 0.06) + BOUND.format("calibrated", 0.8) + 'over = "today"\n'
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"


def test_steady_rows_are_predicted_by_laws_and_by_the_robot_with_the_same_bits(steady, tmp_path):
    result = ran(tmp_path / "out", "evaluate", str(steady), "--threads", "1")
    heading = {name: one["after_seconds"]["1"]["heading"]["rms"] for name, one in result.summary["models"].items()}
    assert list(heading) == ["today", "two_gains", "icr", "turn_loss_sides", "icr_sides", "robot", "calibrated"]
    assert heading["two_gains"] < 0.6 * heading["today"]
    assert heading["robot"] < 0.6 * heading["today"]
    assert heading["calibrated"] < heading["robot"]
    assert [check["holds"] for check in result.summary["checks"]] == [True, True]
    assert "2 of 2 checks passed" in result.printed
    assert "of steady driving" in (result.folder / "report.html").read_text()
    again = ran(tmp_path / "again", "evaluate", str(steady), "--threads", "2")
    assert again.summary["models"] == result.summary["models"]


@pytest.mark.usefixtures("without_figures")
def test_a_missed_bound_ends_with_1_and_the_page_is_written(steady, tmp_path):
    path = steady.with_name("broken.toml")
    path.write_text(steady.read_text().partition("free")[0] + BOUND.format("today", 0.05))
    with pytest.raises(SystemExit) as stop:
        ran(tmp_path / "out", "evaluate", str(path))
    assert stop.value.code == 1
    assert (tmp_path / "out" / "report.html").exists()


def test_what_a_data_set_states_cannot_be_given_besides(steady, refused):
    line = refused("evaluate", str(steady), "--folds", "3")
    assert "folds = 3: must be left out with a data set, which states it" in line
