import numpy as np
import pytest

from experiments.options.bench import BenchConfig
from experiments.speed.terrain import BARE, TERRAINS, TRACKS, TerrainRig
from sim.tracks import PRESETS
from trackslip.errors import InvalidValueError

SMALL = ("--terrain-sizes", "2", "--thread-counts", "1", "--seconds", "0.1", "--repeats", "1", "--terrain-robot", "box")


def test_what_is_written(trackslip, monkeypatch):
    monkeypatch.setattr("experiments.speed.terrain._UNDER_WAY", (0.1, 0.2))
    result = trackslip("bench", "--terrain", *SMALL)
    rows = result.summary["rows"]
    expected = [(preset, terrain, case) for preset in PRESETS for terrain in TERRAINS for case in (BARE, TRACKS)]
    assert [(row["preset"], row["terrain"], row["case"]) for row in rows] == expected
    for row in rows:
        assert (row["n"], row["threads"]) == (2, 1)
        assert row["real_time_factor"] == pytest.approx(row["steps_per_s"] * PRESETS[row["preset"]].timestep)
        assert row["case"] == TRACKS or row["ratio_to_bare"] == 1
    assert "Speed on terrain of the robot box" in result.printed
    assert "ten steps" in result.printed


def test_both_cases_make_the_same_steps(monkeypatch):
    monkeypatch.setattr("experiments.speed.terrain._UNDER_WAY", (0.5, 1.0))
    rig = TerrainRig("box", "fast", "flat", 2, 1)
    assert np.diff(rig.start[:, 1])[0] == pytest.approx(0.3 * 0.5, rel=0.02)  # x, after the time
    ends = []
    for case in (BARE, TRACKS):
        assert rig.rate(case, 0.1) > 0
        ends.append(rig.batch.state.copy())
    np.testing.assert_array_equal(*ends)
    assert not (ends[0] == rig.start).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"terrain": True, "env": True}, "terrain = True: must be left out with --env"),
        ({"terrain": True, "sizes": (3,)}, "sizes"),
        ({"terrain_robot": "box"}, "terrain_robot"),
        ({"terrain": True, "terrain_sizes": (0,)}, "terrain_sizes"),
    ],
)
def test_options_that_do_not_fit(options, message):
    with pytest.raises(InvalidValueError, match=message):
        BenchConfig(**options)


def test_an_unknown_robot_is_a_line(trackslip, capsys):
    with pytest.raises(SystemExit, match="2"):
        trackslip("bench", "--terrain", "--terrain-robot", "tank")
    assert "tank" in capsys.readouterr().err
