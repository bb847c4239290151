import pytest

from experiments.cli import parse
from experiments.common.sweep import fleets
from experiments.grid.plan import plan
from experiments.grid.runs import GridRuns
from trackslip.logs.logfile import read_runs
from trackslip.paper import SPEEDS

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "4")
SHORT = ("--radii", "1.0", "--speeds", "0.1", "--duration", "4")


def test_same_seed_same_files_another_seed_others(trackslip, tmp_path):
    def grid(seed, threads):
        out = str(tmp_path / f"{seed} {threads}")
        return trackslip("grid", *SMALL, "--seed", seed, "--threads", threads, "--out", out)

    def stored(result):
        return (result.folder / "runs.parquet").read_bytes()

    one = grid("5", "1")
    assert stored(grid("5", "2")) == stored(one)
    assert stored(grid("6", "1")) != stored(one)
    files = {path.stem for path in one.folder.iterdir()}
    assert files == {"manifest", "runs", "summary", "table", "report"}
    assert one.manifest["seed"] == 5
    (radii,) = (each["radius"] for each in one.summary["grids"])
    assert radii["commanded"] == [0.6, 1.5]
    assert radii["published"] == [None, 2.05]
    names = [log.run for log in read_runs(one.folder / "runs.parquet")]
    assert names == [f"radius={r} speed={v}" for r in (0.6, 1.5) for v in (0.1, 0.2)]


# the world


def ground_of(result):
    (log,) = read_runs(result.folder / "runs.parquet")
    assert log.metadata["ground"] == result.manifest["ground"]
    return log.metadata["ground"]


def test_a_ground_by_name_or_from_a_file_with_changes(trackslip, tmp_path):
    ground = ground_of(trackslip("grid", *SHORT, "--ground", "gravel", "--ground.across", "0.5"))
    assert ground["along"] == 0.35
    assert ground["across"] == 0.5
    assert ground["slope"] == 0.0
    path = tmp_path / "wet.toml"
    path.write_text(
        "base = 'wet'\n[[patches]]\nx = [-inf, inf]\ny = [0.0, 1.0]\nalong = 0.2\nacross = 0.2\n"
    )
    ground = ground_of(trackslip("grid", *SHORT, "--ground", str(path), "--ground.slope", "0.05"))
    (patch,) = ground["patches"]
    assert ground["along"] == 0.6
    assert ground["slope"] == 0.05
    assert patch["along"] == 0.2
    assert patch["x"] == [None, None]  # infinite


def planned(*arguments):
    return plan(parse(["grid", *arguments]))


def test_a_run_is_the_same_however_it_is_asked_for():
    (one,) = planned(
        "--radii",
        "1",
        "--speeds",
        "0.1",
        "--ground",
        "ice",
        "--ground.slope",
        "0.02",
        "--seed",
        "7",
    )
    (same,) = planned(
        "--radii",
        "1",
        "--speeds",
        "0.1",
        "--grounds",
        "ice",
        "--vary",
        "slope=0.02",
        "--seeds",
        "7",
    )
    assert (one.id, one.cell.key) == (same.id, same.cell.key)
    assert one.name == "radius=1.0 speed=0.1"
    assert same.name == "radius=1.0 speed=0.1 ground=ice seed=7 slope=0.02"
    usual = {
        "--radii": "1",
        "--speeds": "0.1",
        "--ground": "ice",
        "--ground.slope": "0.02",
        "--seed": "7",
    }
    others = {
        "--seed": "8",
        "--radii": "1.1",
        "--scanner.noise": "0.006",
        "--drive.lag": "0.06",
        "--motion": "arc",
    }
    others |= {"--obstacles": "posts", "--radius-error": "0.01", "--duration": "20"}
    ids = {one.id}
    for change in others.items():
        (other,) = planned(*(word for pair in (usual | dict([change])).items() for word in pair))
        ids.add(other.id)
    assert len(ids) == 1 + len(others)


def _shared(setting):
    return (setting.specification.parameters, setting.config.scanner, setting.config.random_phase)


def test_any_option_varies_and_only_equal_models_share_a_fleet(tmp_path):
    (tmp_path / "sweep.toml").write_text(
        'radius = [1.0, 2.0]\nspeed = 0.1\nground = ["stone", "gravel"]\n[robot]\nhalf_gauge = '
        "[0.15, 0.168]\n"
        "[scanner]\nnoise = [0.005, 0.01]\n"
    )
    runs = planned("--sweep", str(tmp_path / "sweep.toml"), "--vary", "random_phase=False,True")
    assert len(runs) == 32
    assert len(fleets(runs, 2, GridRuns.sizes)) == 8
    for fleet in fleets(runs, 2, GridRuns.sizes):
        assert len({_shared(run.setting) for run in fleet}) == 1
    narrow = [run for run in runs if run.axes["robot.half_gauge"] == 0.15]
    assert {run.world(1).robot.geometry.half_gauge for run in narrow} == {0.15}
    assert len(narrow) == 16


@pytest.mark.parametrize(
    ("duration", "ratios", "workers", "count", "largest"),
    [
        *((30, 40, *rest) for rest in ((1, 8, 125), (3, 12, 84), (64, 16, 63))),
        *((duration, 1, 2, count, 25) for duration, count in ((79, 1), (160, 2), (3600, 5))),
    ],
)
def test_fleets_fit_into_memory_and_occupy_every_worker(duration, ratios, workers, count, largest):
    ratio = f"friction_ratio={','.join(str(0.8 + 0.01 * k) for k in range(ratios))}"
    runs = planned("--duration", str(duration), "--vary", ratio)
    parts = fleets(runs, workers, GridRuns.sizes)
    assert sorted(run.id for part in parts for run in part) == sorted(run.id for run in runs)
    assert len(parts) == count
    assert max(map(len, parts)) <= largest


def test_options_win_over_a_sweep_file(tmp_path):
    (tmp_path / "sweep.toml").write_text("radius = [1, 2]\nseed = [0, 1]\n[ground]\nslope = 0.1")
    runs = planned(
        "--sweep",
        str(tmp_path / "sweep.toml"),
        "--seeds",
        "7",
        "--vary",
        "radius=0.5",
        "motion=arc",
    )
    fixed = {"seed": 7, "motion": "arc", "slope": 0.1, "radius": 0.5}
    assert [run.axes for run in runs] == [fixed | {"speed": speed} for speed in SPEEDS]
