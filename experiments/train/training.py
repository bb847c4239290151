"""Training with PPO: the model with its checkpoints and its network.

A checkpoint has everything that the rest of a training depends on: weights, optimiser, counters,
robots and random generators. A training that was stopped and resumed with the same options gives
the same policy, to the bit, as one that was never stopped.
"""

import random
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.manifest import content
from experiments.common.plain_json import plain
from experiments.common.progress import progress
from experiments.common.results import write_whole
from experiments.train.config import ENVIRONMENT, Config
from experiments.train.tasks import LearningTask
from sim.common.array_file import read_nested, write_nested
from sim.policy import Network
from trackslip.errors import InvalidValueError, LogError
from trackslip.replacement import STORE

POLICY: Final = "policy.npz"
ONNX: Final = "policy.onnx"
CHECKPOINT: Final = "checkpoint.npz"
UNFINISHED: Final = Path(STORE) / CHECKPOINT
"""The last checkpoint of an unfinished training, in OUT."""
FORMAT: Final = "trackslip checkpoint 1"
_PICKLED: Final = ".checkpoint.zip", "checkpoint.zip"  # the checkpoints of older versions
_MIN_RATE: Final = 0.05  # final over initial learning rate


def last_checkpoint(out: Path) -> Path:
    """Path of the last checkpoint from an unfinished training or, if there is none, of the final
    checkpoint.
    """
    unfinished = out / UNFINISHED
    return unfinished if unfinished.is_file() else out / CHECKPOINT


def read_checkpoint(out: Path) -> dict[str, Any]:
    """The last checkpoint in `out`; raises LogError if there is none that can be read."""
    file = last_checkpoint(out)
    pickles = [out / name for name in _PICKLED if (out / name).exists()]
    if pickles and not file.exists():
        raise LogError(
            f"{pickles[0]}: can't be resumed (written by an older trackslip as a pickle, which may "
            "run code; train again)"
        )
    what = f"a {CHECKPOINT} of `trackslip train`"
    stored = read_nested(file, what)
    if stored.get("format") != FORMAT:
        raise LogError(f"{file}: not {what}")
    return stored


def model_of(config: Config, task: LearningTask) -> Any:
    """A new PPO model."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)  # PyTorch's threads would take processors from the simulation
    first = config.learning_rate

    def learning_rate(left: float) -> float:
        """The learning rate when a share `left` of the steps remains, which falls linearly."""
        return first * (_MIN_RATE + (1 - _MIN_RATE) * left)

    network = {
        "net_arch": list(config.network),
        "activation_fn": torch.nn.Tanh,
        "log_std_init": task.deviation,
    }
    return PPO(
        "MlpPolicy",
        task.robots,
        learning_rate=learning_rate,
        n_steps=config.horizon,
        batch_size=config.batch,
        n_epochs=config.epochs,
        gamma=config.discount,
        seed=config.seed,
        device="cpu",
        policy_kwargs=network,
    )


def environment_of(config: Config) -> dict[str, Any]:
    """Everything that determines the robots of a training, in JSON's types: options, and digests of
    the files that they name.
    """
    options = {name: getattr(config, name) for name in ENVIRONMENT}
    named = [config.robot, config.laws, *config.references, *config.grounds, *config.courses]
    digests = {str(name): content(Path(name)) for name in named if name}
    files = {name: digest for name, digest in digests.items() if digest}
    return {**plain(options), "files": files}


def checkpoint(
    config: Config, task: LearningTask, model: Any, curve: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """Everything that the rest of a training depends on, between two updates; see
    `array_file.write_nested`.
    """
    parameters = model.get_parameters()
    optimiser = parameters["policy.optimizer"]["state"]
    return {
        "format": FORMAT,
        "network": config.network,
        "environment": environment_of(config),
        "steps": model.num_timesteps,
        "curve": curve,
        "policy": {name: values.numpy() for name, values in parameters["policy"].items()},
        "optimiser": {
            index: {name: values.numpy() for name, values in moments.items()}
            for index, moments in optimiser.items()
        },
        "random": _random_state(),
        "robots": task.env.get_state(),
    }


def resume(
    config: Config, task: LearningTask, model: Any
) -> tuple[list[dict[str, float]], list[str]]:
    """Continue `model` and the robots of `task` from the last checkpoint in `config.out`.

    Returns the learning curve so far, and the options in ENVIRONMENT that have changed, or "files"
    if a file has that they name. If any has, the robots begin anew, with new random numbers.

    Raises LogError for a checkpoint that can't be used, InvalidValueError for another network.
    """
    import torch

    file = last_checkpoint(config.out)
    stored = read_checkpoint(config.out)
    try:
        layers = tuple(stored["network"])
        if layers != config.network:
            raise InvalidValueError(
                "network", config.network, f"{layers} with --resume, as in {file}"
            )
        parameters = model.get_parameters()
        policy = {name: torch.from_numpy(values) for name, values in stored["policy"].items()}
        optimiser = {
            int(index): {name: torch.from_numpy(values) for name, values in moments.items()}
            for index, moments in stored["optimiser"].items()
        }
        groups = parameters["policy.optimizer"]["param_groups"]
        model.set_parameters(
            {
                "policy": policy,
                "policy.optimizer": {"state": optimiser, "param_groups": groups},
            }
        )
        model.num_timesteps = int(stored["steps"])
        curve = [{name: float(value) for name, value in point.items()} for point in stored["curve"]]
        environment = environment_of(config)
        changed = [
            name for name, value in environment.items() if stored["environment"].get(name) != value
        ]
        if not changed:
            task.robots.continue_from(stored["robots"])
            _set_random_state(stored["random"])
    except InvalidValueError:
        raise
    except Exception as error:  # a file may have anything in it
        reason = textwrap.shorten(f"{type(error).__name__}: {error}", 120)
        raise LogError(f"{file}: can't be resumed ({reason})") from error
    return curve, changed


def _random_state() -> dict[str, Any]:
    """The states of the three generators that Stable-Baselines3 uses and seeds."""
    import torch

    version, words, gauss = random.getstate()
    return {
        "torch": torch.get_rng_state().numpy(),
        "numpy": np.random.get_state(legacy=False),  # noqa: NPY002
        "python": {"version": version, "words": np.array(words), "gauss": gauss},
    }


def _set_random_state(state: Mapping[str, Any]) -> None:
    import torch

    python = state["python"]
    torch.set_rng_state(torch.from_numpy(state["torch"]))
    np.random.set_state(state["numpy"])  # noqa: NPY002
    random.setstate((python["version"], tuple(python["words"].tolist()), python["gauss"]))


def learn(
    model: Any, config: Config, task: LearningTask, curve: list[dict[str, float]], folder: Path
) -> None:
    """Train until `config.steps`; each update stores a checkpoint in `config.out`, the last update
    also in `folder`.

    The steps of all robots and their mean reward [-] at each update are appended to `curve`.
    """
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger

    def keep() -> None:
        stored = checkpoint(config, task, model, curve)
        write_whole(config.out / UNFINISHED, lambda draft: write_nested(draft, stored))

    model.set_logger(Logger(None, []))  # the default logger would leave a temporary folder
    before = model.num_timesteps
    rewards: list[float] = []  # means of all robots since the last update
    with progress("training", config.steps, "steps", before) as report:

        class Recorder(BaseCallback):  # type: ignore[misc, unused-ignore]
            def _on_rollout_start(self) -> None:
                if self.num_timesteps > before:  # an update is complete
                    keep()

            def _on_step(self) -> bool:
                # PPO's own rewards include the value expected after an episode that is cut off
                rewards.append(float(np.mean(self.locals["rewards"])))
                return True

            def _on_rollout_end(self) -> None:
                curve.append({"steps": self.num_timesteps, "reward": float(np.mean(rewards))})
                report(len(rewards) * config.robots)
                rewards.clear()

        left = max(config.steps - before, 0)
        model.learn(left, callback=Recorder(), reset_num_timesteps=False)
    keep()
    write_nested(folder / CHECKPOINT, checkpoint(config, task, model, curve))


def network_of(model: Any) -> Network:
    """A model's network from features to mean actions."""
    policy = model.policy
    layers = [
        layer
        for layer in [*policy.mlp_extractor.policy_net, policy.action_net]
        if hasattr(layer, "weight")
    ]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network(weights, biases)
