"""Data sets: their files, parts and bounds."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from command_runs import ran

from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.log import parts
from trackslip.errors import TrackslipError

LOGS = Path(__file__).parents[3] / "examples" / "logs"
TOML = 'title = "t"\nlog = "log.csv"\nsource = "s"\nlicence = "l"\nrobot = ["husky"]\nground = "ice"\n'
BOUND = '[[bounds]]\nrow = "{}"\nquantity = "heading_rms"\nmost = {}\n'


@pytest.mark.parametrize("name", ["husky", "warthog", "ice", "grass"])
def test_shipped_data_sets_can_be_read(name):
    data = load_data_set(LOGS / f"{name}.toml")
    assert data.log.exists()
    assert (data.log.parent / data.licence.split(", ")[1]).exists()


def test_one_command_is_in_one_part_and_parts_are_in_order():
    drives = [SimpleNamespace(run=str(k), command=np.full((3, 2), float(value))) for k, value in enumerate("11222341")]
    np.testing.assert_array_equal(parts(drives, 2, ""), [0, 0, 0, 0, 0, 1, 1, 0])
    np.testing.assert_array_equal(parts(drives, 4, ""), [0, 0, 1, 1, 1, 2, 3, 0])
    with pytest.raises(TrackslipError, match=r"log.csv: has 4 different commands, too few for folds = 5"):
        parts(drives, 5, "log.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TOML + "colour = 1", "colour is unknown; known are title, log"),
        (TOML.replace("log.csv", "gone.csv"), "log = .*gone.csv.*: must be a file beside the data set"),
        (TOML + "folds = 1", "folds = 1: must be"),
        (TOML + 'free = ["wax"]', "free = 'wax': must be one of half_gauge"),
        (TOML + BOUND.format("wax", 1.0), "bounds = 'wax': must be one of today, two_gains, robot, calibrated"),
        (TOML + BOUND.format("today", -1.0), "most = -1.0: must be"),
        (TOML + BOUND.replace("heading_rms", "v").format("today", 1.0), "quantity = 'v': must be one of position_"),
    ],
)
def test_a_bad_file_names_field_value_and_what_is_allowed(tmp_path, text, message):
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(TrackslipError, match=message) as caught:
        load_data_set(tmp_path / "mine.toml")
    assert "mine.toml" in str(caught.value)


@pytest.fixture(scope="module")
def data_set(tmp_path_factory):
    """A data set of the first commands of a Husky, whose bounds all hold."""
    folder = tmp_path_factory.mktemp("husky")
    table = pq.read_table(LOGS / "husky_windows.parquet")
    pq.write_table(table.filter(pc.less(table["command"], 4)), folder / "log.parquet")
    text = TOML.replace("log.csv", "log.parquet").replace('"ice"', '"asphalt"')
    text += 'law = ["icr_radius"]\nfree = ["friction_ratio"]\n'
    text += BOUND.format("icr_radius", 0.5) + BOUND.format("calibrated", 0.5)
    (folder / "mine.toml").write_text(text)
    return folder / "mine.toml"


def test_a_data_set_states_models_and_bounds(data_set, tmp_path):
    result = ran(tmp_path / "out", "evaluate", str(data_set))
    models = result.summary["models"]
    heading = {name: model["after_seconds"]["1"]["heading"]["rms"] for name, model in models.items()}
    assert list(heading) == ["today", "two_gains", "icr_radius", "robot", "calibrated"]
    assert heading["two_gains"] < 0.6 * heading["today"]
    assert heading["calibrated"] < 0.6 * heading["today"]
    assert [check["holds"] for check in result.summary["checks"]] == [True, True]
    assert "2 of 2 checks passed" in result.printed
    assert "Best after 1 s: " in (result.folder / "report.html").read_text()


@pytest.mark.slow
def test_a_missed_bound_ends_with_1_and_the_page_is_written(data_set, tmp_path):
    path = data_set.with_name("broken.toml")
    path.write_text(data_set.read_text().partition("free")[0] + BOUND.format("today", 0.05))
    with pytest.raises(SystemExit) as stop:
        ran(tmp_path / "out", "evaluate", str(path))
    assert stop.value.code == 1
    assert (tmp_path / "out" / "report.html").exists()


def test_what_a_data_set_states_cannot_be_given_besides(data_set, refused):
    line = refused("evaluate", str(data_set), "--folds", "3")
    assert "folds = 3: must be left out with a data set, which states it" in line
