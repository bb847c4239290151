import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import load_laws

FOLDER = Path(__file__).parents[2] / "examples"


@pytest.fixture
def run(capsys):
    """Call an example's main() and return what it printed."""

    def call(name, *arguments, **options):
        spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        module.main(*arguments, **options)
        return capsys.readouterr().out

    return call


def test_logs_are_small_and_their_licences_beside_them():
    files = [file for file in (FOLDER / "logs").iterdir() if file.name != "README.md"]
    assert sum(file.stat().st_size for file in files) < 2e6
    told = (FOLDER / "logs" / "README.md").read_text(encoding="utf-8")
    assert all(f"`{file.name}`" in told for file in files)
    assert sum(file.name.startswith("LICENSE") for file in files) == 2


def numbers(pattern, text):
    return [float(number) for number in re.findall(pattern, text)]


def test_drive_a_fleet(run, tmp_path):
    printed = run("drive_a_fleet", tmp_path / "fleet.parquet", duration=4.0)
    assert printed.count("<RunLog 'run") == 3
    radii = numbers(r"radius (\S+) m", printed)
    assert len(radii) == 3
    assert 0.9 < radii[0] < radii[1]


def test_animation(run, tmp_path):
    printed = run("animation", tmp_path / "animation.gif", frames=2)
    without, compensated = numbers(r"(\S+) mm from the end of the path", printed)
    assert without > 1000 > 20 > compensated
    assert (tmp_path / "animation.gif").read_bytes().startswith(b"GIF8")


def test_identify_from_python(run, tmp_path, monkeypatch):
    # as the next test does
    monkeypatch.setattr("experiments.common.page.drawn_plot", lambda plot, pdf=False: ())
    printed = run("identify_from_python", tmp_path)
    assert printed.startswith("Slip laws from 8 steady samples")
    ((low, high),) = re.findall(r"offset is between (\S+) and (\S+)", printed)
    assert 0 < float(low) < float(high)
    assert (tmp_path / "laws.json").is_file()
    assert (tmp_path / "report.html").is_file()


def test_own_slip_law(run, tmp_path):
    try:
        printed = run("own_slip_law", tmp_path)
        assert set(load_laws(tmp_path / "laws.json")) == {"linear"}
    finally:
        FAMILIES.pop("linear", None)
    with pytest.raises(LogError, match="only linear: import the module that adds it to FAMILIES"):
        load_laws(tmp_path / "laws.json")
    errors = dict(re.findall(r"^(\w+) misses the slip by (\S+) rms", printed, re.M))
    assert float(errors["linear"]) < float(errors["none"])
    assert "Linear(offset=" in printed
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for shown in ("linear in curvature", "<strong>k</strong>: growth of slip with curvature"):
        assert shown in page
    row = re.search(r"<tr[^>]*>(?:(?!</tr>).)*linear in curvature.*?</tr>", page, re.DOTALL)
    assert row is not None
    assert ">o<" in row[0], "not the D of constant ICRs, whose parameter has the same name"


def test_own_controller(run):
    errors = dict(re.findall(r"^(\w+) +(\S+) mm", run("own_controller"), re.M))
    assert set(errors) == {"Proportional", "LinearTimeVarying", "Samson", "PurePursuit"}
    assert float(errors["Proportional"]) < 20


@pytest.mark.slow
def test_closed_loop(run):
    none, identified, online = numbers(r"(\S+) mm rms", run("closed_loop"))
    assert max(identified, online) < none


def test_environment(run):
    printed = run("environment")
    assert "on the path: True" in printed
    assert numbers(r"error (\S+) mm", printed)[0] < 40
    assert numbers(r"actions (\S+) per", printed)


def test_training(run):
    pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    told, *lines = run("training", steps=8192, robots=8).splitlines()
    assert told.startswith("PPO learns in 8,192 control periods which twists 8 robots")
    assert lines[-1].startswith("after   8,192 periods: on the path for ")


@pytest.mark.slow
def test_read_a_sweep(run, tmp_path):
    pytest.importorskip("polars", reason="polars is not installed")
    printed = run("read_a_sweep", tmp_path)
    assert printed.count("stone") == printed.count("ice") == 3


def test_tracks_on_your_robot(run):
    printed = run("tracks_on_your_robot")
    assert "on ground 0.45 m high" in printed
    assert all(0 < slip < 0.3 for slip in numbers(r"slip of robot_\w+: (\S+)", printed))


def test_every_example_is_tested():
    tested = set(re.findall(r'run\(\s*"(\w+)"', Path(__file__).read_text()))
    assert {path.stem for path in FOLDER.glob("*.py")} == tested


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("updates", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_ppo_in_one_file(run, updates):
    pytest.importorskip("torch")
    rewards = numbers(
        r"mean reward (\S+) per", run("ppo_in_one_file", steps=1024 * updates, robots=16)
    )
    assert len(rewards) == updates
    # the first ones have robots near their start
    assert updates == 2 or rewards[-1] > rewards[1] + 0.1


def test_ppo_bootstraps_the_end_of_a_reference_and_no_failure():
    """A critic that returns the time of an observation sees the last one of each episode."""
    torch = pytest.importorskip("torch")
    spec = importlib.util.spec_from_file_location("ppo", FOLDER / "ppo_in_one_file.py")
    ppo = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ppo)

    def critic(observation):
        return observation[:, :1]

    seen = np.float32([[1.0], [0.0], [3.0]])
    final = np.array([None, np.float32([2.0]), None], dtype=object)
    info = {"final_obs": final, "_final_obs": np.array([False, True, False])}
    np.testing.assert_array_equal(ppo.critic_after(critic, seen, info), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(ppo.critic_after(critic, seen, {}), [1.0, 0.0, 3.0])

    # advantages don't cross an end, and sum up discounted errors elsewhere
    errors = torch.ones(3, 1)
    trace = ppo.DISCOUNT * ppo.TRACE
    ends = torch.tensor([[0.0], [1.0], [0.0]])
    expected = [1 + trace, 1.0, 1.0]
    np.testing.assert_allclose(ppo.generalized_advantages(errors, ends)[:, 0], expected, rtol=1e-6)


@pytest.fixture
def adapters():
    spec = importlib.util.spec_from_file_location("adapters", FOLDER / "adapters.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_rl_games_steps_robots(adapters):
    pytest.importorskip("rl_games.common.ivecenv")
    envs = adapters.rl_games_environment("robots", 3, reference="circle")
    assert envs.reset().shape == (3, *envs.get_env_info()["observation_space"].shape)
    _, reward, done, infos = envs.step(np.zeros((3, 2), np.float32))
    assert reward.shape == done.shape == infos["time_outs"].shape == (3,)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_tianshou_steps_some_of_the_robots(adapters):
    pytest.importorskip("tianshou.env")
    envs = adapters.tianshou_environment(3, reference="circle")
    envs.seed(3)
    observation, infos = envs.reset()
    assert observation.shape == (3, *envs.observation_space[0].shape)
    assert [info["env_id"] for info in infos] == [0, 1, 2]
    observation, *_, infos = envs.step(np.zeros((2, 2), np.float32), id=[0, 2])
    assert len(observation) == 2
    assert [info["env_id"] for info in infos] == [0, 2]
