import contextlib
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.train.config import Config
from experiments.train.tasks import learning_task
from experiments.train.training import CHECKPOINT, UNFINISHED
from sim.common.array_file import read_arrays
from sim.ground.ground import NAMED_GROUNDS
from sim.path_tracking.config import EnvConfig
from sim.policy import TWIST_NOW, Policy, TrackingPolicy
from sim.traverse.policy import OPTIONS
from trackslip.laws.base import NoSlip

pytest.importorskip("torch._dynamo")  # its compiler crashes once OpenGL is in use
pytest.importorskip("stable_baselines3")
TINY = {"robots": 4, "horizon": 32, "batch": 64, "epochs": 1, "network": 8, "references": "slalom"}
LEARNS = {
    "robots": 32,
    "horizon": 16,
    "batch": 128,
    "epochs": 6,
    "network": 32,
    "references": "slalom",
}


def sized(sizes, **changed):
    return tuple(
        word for name, value in (sizes | changed).items() for word in (f"--{name}", str(value))
    )


def test_a_policy_is_trained_and_takes_part_in_the_benchmark(trackslip, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    trained = trackslip("train", *sized(TINY), "--steps", "256")
    assert not [*tmp_path.glob("SB3-*")]
    assert [point["steps"] for point in trained.summary["curve"]] == [128, 256]
    assert TrackingPolicy.load(trained.folder).authority == (0.12, 0.6)
    options = (
        "--references",
        "slalom",
        "--starts",
        "zero",
        "--seeds",
        "0",
        "--localization",
        "truth",
        "--jobs",
        "1",
    )
    controllers = ("--controllers", "feedforward", f"ppo:{trained.folder}")
    table = trackslip("benchmark", *options, *controllers, "--compensations", "icr_radius")
    assert table.summary["failures"] == []
    assert [row["controller"] for row in table.summary["rows"]] == [
        "feedforward",
        f"ppo:{trained.folder}",
    ]


@pytest.mark.slow
def test_a_training_learns_and_resumes_with_other_settings(trackslip, capsys):
    """The checkpoint fixes the network; every other option may change.

    At first the mean reward is 0, as changes of random actions cost; with any of four seeds,
    training ends above 0.29.
    """
    trained = trackslip("train", *sized(LEARNS), "--learning-rate", "3e-3", "--steps", "61440")
    reward = np.array([point["reward"] for point in trained.summary["curve"]])
    assert (trained.summary["steps"], len(reward)) == (61440, 120)
    assert reward.max() < 1
    assert abs(reward[:5].mean()) < 0.1
    assert reward[-15:].mean() > 0.29
    resumed = ("--steps", "62464", "--resume", "--out", str(trained.folder))
    longer = trackslip("train", *sized(LEARNS, horizon=32), *resumed)
    assert longer.summary["curve"][:-1] == trained.summary["curve"]
    assert longer.summary["curve"][-1]["steps"] == 62464  # 32 robots, 32 steps each
    assert "Warning" not in longer.printed
    # nothing is left
    assert trackslip("train", *sized(LEARNS), *resumed).summary["curve"] == longer.summary["curve"]
    with pytest.raises(SystemExit):
        main(["train", *sized(LEARNS, network=16), *resumed])
    assert "network = (16,): must be (32,) with --resume" in capsys.readouterr().err


KINDS = {
    "fixed law": (*sized(TINY), "--steps", "640"),
    "online": (*sized(TINY), "--steps", "640", "--compensation", "online"),
    "courses": (
        *("--env", "traverse", "--robots", "2", "--horizon", "6", "--batch", "12"),
        *("--epochs", "1", "--network", "8", "--steps", "48", "--trials", "1"),
        *("--difficulty", "0.2", "0.2"),
    ),
}


def interrupted(monkeypatch, arguments, updates=2):
    """Interrupt a command `train` in the rollout after some updates."""

    class Interrupt(list):
        def __call__(self, steps):
            self.append(steps)
            if len(self) > updates:
                raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        shown = contextlib.nullcontext(Interrupt())
        patched.setattr("experiments.train.training.progress", lambda *_: shown)
        with pytest.raises(SystemExit) as stop:
            main(["train", *arguments])
    assert stop.value.code == 130


@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_a_resumed_training_gives_the_policy_of_a_whole_one(
    trackslip, tmp_path, monkeypatch, options
):
    """To the bit, with all that a later training would depend on."""
    undisturbed = trackslip("train", *options)
    out = ("--out", str(tmp_path / "out"))
    interrupted(monkeypatch, (*options, *out))
    interrupted(monkeypatch, (*options, *out, "--resume"), updates=1)
    resumed = trackslip("train", *options, "--resume", *out)
    assert resumed.summary["curve"] == undisturbed.summary["curve"]
    assert resumed.summary["rates"] == undisturbed.summary["rates"]
    for name in ("policy.npz", CHECKPOINT):
        about, arrays = read_arrays(undisturbed.folder / name, name)
        again, others = read_arrays(resumed.folder / name, name)
        assert again == about
        assert others.keys() == arrays.keys()
        for array in arrays:
            np.testing.assert_array_equal(others[array], arrays[array], err_msg=array)


def test_the_help_says_in_which_unit_corrections_are_limited(capsys):
    """As `sim.policy.corrected` applies them; test_policy.py checks how large they are."""
    with pytest.raises(SystemExit):
        main(["train", "--help-all"])
    speed, rate = EnvConfig().twist_scale
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert f"as shares of the actions' units, {speed:g} m/s and {rate:g} rad/s [-]" in printed


def test_corrections_are_shares_of_the_actions_units():
    authority = np.array([0.1, 0.4])
    options = {"robots": 1, "horizon": 8, "batch": 8, "compensation": "none"}
    task = learning_task(Config(**options, authority=tuple(authority)))
    reference = task.robots.reset()[0, TWIST_NOW]
    task.robots.step(np.array([[1.0, -1.0]]))
    fleet = task.env.task.fleet
    driven = NoSlip().twist(fleet.drive.set_point, fleet.robot.geometry)[0]
    expected = np.array(EnvConfig().twist_scale) * (reference + authority * [1.0, -1.0])
    np.testing.assert_allclose(driven, expected, atol=1e-6)


def test_plants_on_soft_soil_vary_in_more_than_friction():
    task = learning_task(Config(robots=4, horizon=8, batch=32, grounds=("dry_sand",)))
    task.robots.reset()
    grounds = {ground.soil for ground in task.env.task.fleet.ground}
    assert grounds == {NAMED_GROUNDS["dry_sand"].soil}
    radius = task.env.task.fleet.drive.radius
    assert len(np.unique(radius)) > 1


def test_the_ground_in_a_robots_file_is_trained_on(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("half_gauge = 0.2\n[ground]\nalong = 0.41\nacross = 0.41\n")
    sizes = {"robots": 4, "horizon": 8, "batch": 32, "compensation": "none"}
    task = learning_task(Config(**sizes, robot=str(file), grounds=("robot",)))
    task.robots.reset()
    assert {ground.along for ground in task.env.task.fleet.ground} == {0.41}


def test_own_rewards_are_named_on_the_command_line_only(trackslip, tmp_path, monkeypatch):
    """The reward of every step is larger by the term, and no file keeps the name of its code."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_terms.py").write_text("def one(task):\n    return 0 * task.reward + 1\n")
    plain = trackslip("train", *sized(TINY), "--steps", "128")
    own = trackslip("train", *sized(TINY), "--steps", "128", "--own-rewards", "own_terms:one", "2")
    rewards = [found.summary["curve"][0]["reward"] for found in (plain, own)]
    assert rewards[1] == pytest.approx(rewards[0] + 2, abs=1e-6)
    assert "own_terms" not in repr(read_arrays(own.folder / "policy.npz", "a policy")[0])


class Payload:
    """An object that makes a file when it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("unpickled"),)


PICKLES = {
    "checkpoint.zip": lambda path: path.write_bytes(pickle.dumps(Payload())),
    "checkpoint.npz": lambda path: path.write_bytes(pickle.dumps(Payload())),
    ".runs/checkpoint.npz": lambda path: np.savez(
        path, about=np.array([Payload()], dtype=object), allow_pickle=True
    ),
}


@pytest.mark.parametrize("name", PICKLES)
def test_no_pickle_is_read_from_a_folder(refused, tmp_path, name):
    file = tmp_path / "out" / name
    file.parent.mkdir(parents=True)
    PICKLES[name](file)
    if file.parent.name == "out":  # of a training that has ended
        manifest = {"command": "train", "versions": {"trackslip": "0.3.0"}}
        manifest["files"] = {name: file.stat().st_size}
        (tmp_path / "out" / "manifest.json").write_text(json.dumps(manifest))
    line = refused("train", *sized(TINY), "--resume", "--out", "out")
    assert line.startswith(f"out/{name}: ")
    assert not (tmp_path / "unpickled").exists()


def test_robots_begin_anew_if_their_options_have_changed(trackslip, tmp_path, monkeypatch):
    out = ("--out", str(tmp_path / "out"))
    interrupted(monkeypatch, (*sized(TINY), "--steps", "512", *out))
    other = ("--steps", "512", "--resume", "--grounds", "clay", "--seed", "3", *out)
    resumed = trackslip("train", *sized(TINY), *other)
    assert "Warning: grounds, seed changed since the checkpoint" in resumed.printed
    assert resumed.summary["steps"] == 512


def test_an_interrupted_training_has_its_first_checkpoint(trackslip, tmp_path, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    begin = ["train", *sized(TINY), "--steps", "512", "--out", str(tmp_path / "out")]
    with monkeypatch.context() as patched:
        updates = iter((lambda steps: None, interrupt))
        shown = contextlib.nullcontext(lambda steps: next(updates)(steps))
        patched.setattr("experiments.train.training.progress", lambda *_: shown)
        with pytest.raises(SystemExit):
            main(begin)
    assert "--resume continues" in capsys.readouterr().err
    files = [file for file in (tmp_path / "out").rglob("*") if file.is_file()]
    assert files == [tmp_path / "out" / UNFINISHED]
    with pytest.raises(SystemExit):
        main(begin)
    assert "--resume continues it, --overwrite starts again" in capsys.readouterr().err
    assert (
        trackslip(*begin[:-2], "--resume", "--out", str(tmp_path / "out")).summary["steps"] == 512
    )
    assert not (tmp_path / "out" / UNFINISHED).exists()


def test_a_policy_learns_to_cross_courses_and_is_tried_on_others(trackslip):
    sizes = (
        "--robots",
        "2",
        "--horizon",
        "8",
        "--batch",
        "16",
        "--epochs",
        "1",
        "--network",
        "8",
        "--steps",
        "16",
    )
    found = trackslip(
        "train", "--env", "traverse", *sizes, "--trials", "1", "--difficulty", "0", "0"
    )
    rates = found.summary["rates"]
    assert [(row["controller"], row["courses"]) for row in rates] == [
        ("scripted", 1),
        ("policy", 1),
    ]
    assert (found.folder / "report.html").is_file()
    policy = Policy.load(found.folder)
    assert policy.options == {**OPTIONS, "robot": "rescue", "course": ["random"]}
    assert policy.action(np.zeros((3, 63))).shape == (3, 4)
