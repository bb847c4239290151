"""Data sets of real robots: their files, and the parts of the predictions that theory knows."""

import numpy as np
import pytest

from experiments.evaluate.reality import Findings, SteadyErrors, fold_labels, load_data_set, scatter, shipped
from trackslip.errors import TrackslipError
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.se2 import Mounting

GEOMETRY = RobotGeometry(0.3, 0.1)


def test_all_shipped_data_sets_can_be_read():
    assert set(shipped()) == {"maxxii", "husky", "warthog", "ice", "grass"}
    for name in shipped():
        data = load_data_set(name)
        assert data.log.exists()
        assert (data.log.parent / data.licence.split(", ")[1]).exists()
    assert load_data_set("ice").transfer == str(shipped()["warthog"])


def test_one_command_is_in_one_fold_and_folds_are_parts_in_order():
    keys = ["a", "a", "b", "b", "b", "c", "d", "a"]
    np.testing.assert_array_equal(fold_labels(keys, 2, ""), [0, 0, 0, 0, 0, 1, 1, 0])
    np.testing.assert_array_equal(fold_labels(keys, 4, ""), [0, 0, 1, 1, 1, 2, 3, 0])
    with pytest.raises(TrackslipError, match=r"log.csv: has 4 different commands, too few for folds = 5"):
        fold_labels(keys, 5, "log.csv")


def test_second_differences_are_as_large_as_errors_of_rows():
    left, right = (one.ravel() for one in np.meshgrid(np.linspace(-5, 5, 41), np.linspace(-4, 4, 9)))
    omega = np.stack([left, right], axis=-1)
    order = np.random.default_rng(0).permutation(len(omega))
    order = order[np.abs(omega[order]).max(axis=1) > 0]  # the row at rest leaves a gap
    twist = body_twist(omega, 0.0, GEOMETRY) + np.random.default_rng(1).normal(0, [0.0005, 0.002], (len(omega), 2))
    samples = SlipSamples.of(omega[order], twist[order], GEOMETRY, [f"row {k}" for k in range(len(order))])
    rest = np.arange(len(order)) > 0
    found, kept = scatter(samples, rest)
    assert len(found) == 9 * 39 - 3
    np.testing.assert_allclose(np.sqrt(np.mean(found**2, axis=0)), [0.0005, 0.002], rtol=0.15)
    assert 1 <= (~kept).sum() <= 3


def test_a_bound_is_of_the_best_law_and_may_be_a_ratio(tmp_path):
    (tmp_path / "log.csv").write_text("")
    bounds = '[[bounds]]\nrow = "data_sheet"\nquantity = "w"\nmost = 0.5\nover = "laws"\n'
    bounds += '[[bounds]]\nrow = "calibrated"\nquantity = "v"\nmost = 9.0\n'
    (tmp_path / "mine.toml").write_text(TOML + bounds)
    errors = {"data_sheet": 0.02, "icr": 0.08, "icr_sides": 0.05}
    rows = {row: {0.0: SteadyErrors(0.1, w, 0.1, w)} for row, w in errors.items()}
    found = Findings("mine", load_data_set(str(tmp_path / "mine.toml")), {"icr": 0, "icr_sides": 0}, "icr", rows, [])
    ratio, missing = found.checks
    assert ratio.measured == pytest.approx(0.4)
    assert ratio.holds
    assert not missing.holds


def test_a_data_set_may_say_where_the_sensor_is(tmp_path):
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "mine.toml").write_text(TOML + "sensor = [0.1, -0.2, 0.3]\n")
    base = load_data_set(str(tmp_path / "mine.toml")).base
    assert base.sensor == Mounting(0.1, -0.2, 0.3)
    assert base.ground.along == 0.12


TOML = 'title = "t"\nlog = "log.csv"\nsource = "s"\nlicence = "l"\nrobot = "husky"\nground = "ice"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TOML + "colour = 1", "colour is unknown; known are title, log"),
        (TOML.replace("log.csv", "gone.csv"), r"log = '.*gone.csv': must be a file beside the data set"),
        (TOML.replace('title = "t"', "title = 3"), "title = 3: must be a text"),
        (TOML.replace('licence = "l"\n', ""), "licence is missing"),
        (TOML.replace("husky", "nobody"), "robot = 'nobody': must be one of shipped"),
        (TOML.replace('"ice"', '"mud"'), "ground = 'mud': must be one of stone"),
        (TOML + "folds = 1", "folds = 1: must be a whole number from 2 to 10"),
        (TOML + 'free = "friction"', "free = 'friction': must be a list"),
        (TOML + '[[bounds]]\nrow = "x"\nquantity = "v"\nmost = 1', "row = 'x': must be one of today"),
        (TOML + '[[bounds]]\nrow = "laws"\nquantity = "x"\nmost = 1', "quantity = 'x': must be one of v, w"),
        (TOML + '[[bounds]]\nrow = "laws"\nquantity = "v"\nmost = 0', "most = 0.0: must be a finite number > 0"),
    ],
)
def test_a_bad_file_names_field_value_and_what_is_allowed(tmp_path, text, message):
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(TrackslipError, match=message) as caught:
        load_data_set(str(tmp_path / "mine.toml"))
    assert "mine.toml" in str(caught.value)
