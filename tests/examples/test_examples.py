import importlib.util
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"


def main_of(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main


def test_a_controller_on_the_environment(capsys):
    main_of("controller_on_env")()
    printed = capsys.readouterr().out
    assert "on the path: True" in printed
    assert float(printed.split()[3]) < 40.0


def test_random_policies_on_many_robots(capsys):
    main_of("vector_rollout")(robots=4, steps=60)
    assert "times real time" in capsys.readouterr().out


def test_training_with_stable_baselines(capsys):
    pytest.importorskip("stable_baselines3")
    main_of("train_sb3")(steps=512, robots=4)
    assert "mean reward" in capsys.readouterr().out


def test_every_example_is_tested():
    assert {path.stem for path in FOLDER.glob("*.py")} == {"controller_on_env", "vector_rollout", "train_sb3"}
