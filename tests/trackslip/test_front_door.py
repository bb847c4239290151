import subprocess
import sys

import numpy as np
import pytest
from slip_data import GEOMETRY

import sim
import trackslip
from trackslip.kinematics import advance

LAW = trackslip.ConstantIcr(0.045, GEOMETRY.half_gauge, 0.0067)


def modules_after(statement):
    code = f"import sys\nbefore = set(sys.modules)\n{statement}\nprint(*sorted(set(sys.modules) - before))"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def steady_run(radius, speed):
    twist = np.array([speed, speed / radius])
    time = np.arange(0, 12.0, 0.05)
    noise = np.random.default_rng([round(1000 * radius), round(1000 * speed)]).normal(0, 0.002, (time.size, 3))
    pose = advance([0.0, 0.0, 0.0], twist, time) + noise
    omega = np.tile(LAW.sprocket_speeds(twist, GEOMETRY), (time.size, 1))
    return trackslip.RunLog(f"R{radius:g}_v{speed:g}", time, omega, pose)


@pytest.mark.parametrize(("package", "some"), [(trackslip, "identify"), (sim, "Fleet")])
def test_every_public_name_is_there(package, some):
    assert some in package.__all__
    assert set(package.__all__) <= {*dir(package), "__version__"}
    assert all(getattr(package, name) is not None for name in package.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = package.nonsense


def test_importing_the_package_imports_next_to_nothing():
    found = modules_after("import trackslip")
    assert {name for name in found if name.startswith("trackslip")} == {"trackslip"}
    assert not found & {"numpy", "scipy", "typing", "dataclasses", "pathlib"}


def test_runs_in_memory_and_in_a_folder_give_the_same_laws_whose_intervals_cover_the_true_one(tmp_path):
    from trackslip.logs.logfile import RUNS, write_parquet

    runs = [steady_run(radius, speed) for radius in (0.6, 1.0, 2.0) for speed in (0.1, 0.2)]
    found = trackslip.identify(runs, GEOMETRY)
    write_parquet(runs, tmp_path / RUNS)
    assert found.best == "icr_radius"
    assert trackslip.identify(tmp_path, GEOMETRY).laws == found.laws
    for name, (low, high) in found.intervals["icr_radius"].items():
        assert low < getattr(LAW, name) < high
    assert set(found.intervals) == set(found.laws)
