"""Training with PPO: the model with its checkpoints, its network and its learning curve."""

import io
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREY
from experiments.common.progress import progress
from experiments.common.style import panel
from experiments.train.config import Config
from experiments.train.tasks import LearningTask
from sim.policy import Network
from trackslip.errors import InvalidValueError, LogError

POLICY, ONNX, CHECKPOINT = "policy.npz", "policy.onnx", "checkpoint.zip"
UNFINISHED = f".{CHECKPOINT}"
"""The last checkpoint of an unfinished training, in OUT."""
_MIN_RATE = 0.05  # final over initial learning rate
_SMOOTH = 7  # number of points in a running mean of the curve


def last_checkpoint(out: Path) -> Path:
    """Path of the last checkpoint from an unfinished training or, if there is none, of the final
    checkpoint.
    """
    return out / UNFINISHED if (out / UNFINISHED).is_file() else out / CHECKPOINT


def model_of(config: Config, task: LearningTask) -> Any:
    """A new PPO model or, with --resume, the model in the last checkpoint."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)  # PyTorch's threads would take processors from the simulation
    checkpoint, first = last_checkpoint(config.out), config.learning_rate
    settings: dict[str, Any] = {
        # left: remaining share of steps
        "learning_rate": lambda left: first * (_MIN_RATE + (1 - _MIN_RATE) * left),
        "n_steps": config.horizon,
        "batch_size": config.batch,
        "n_epochs": config.epochs,
        "gamma": config.discount,
        "seed": config.seed,
        "device": "cpu",
    }
    if not config.resume:
        (config.out / UNFINISHED).unlink(missing_ok=True)
        network = {
            "net_arch": list(config.network),
            "activation_fn": torch.nn.Tanh,
            "log_std_init": task.deviation,
        }
        return PPO("MlpPolicy", task.robots, policy_kwargs=network, **settings)
    try:
        rate = {"learning_rate": settings.pop("learning_rate")}
        model = PPO.load(
            io.BytesIO(checkpoint.read_bytes()), task.robots, custom_objects=rate, **settings
        )
    except Exception as error:  # a broken file may raise anything
        # errors about spaces list all bounds
        reason = textwrap.shorten(f"{type(error).__name__}: {error}", 120)
        raise LogError(f"{checkpoint}: can't be resumed ({reason})") from error
    layers = tuple(model.policy_kwargs["net_arch"])
    if layers != config.network:
        raise InvalidValueError(
            "network", config.network, f"{layers} with --resume, as in {checkpoint}"
        )
    return model


def learn(model: Any, config: Config, folder: Path) -> list[dict[str, float]]:
    """Train until `config.steps`; each update stores a checkpoint in `config.out`, the last update
    also in `folder`.

    Returns the steps of all robots and their mean reward [-] at each update, including updates
    before a resumption.
    """
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))  # the default logger would leave a temporary folder
    model.curve = curve = getattr(model, "curve", [])  # checkpoints store all attributes of a model
    rewards: list[float] = []  # means of all robots since the last update
    with progress("training", config.steps, "steps", model.num_timesteps) as report:

        class Recorder(BaseCallback):  # type: ignore[misc, unused-ignore]
            def _on_step(self) -> bool:
                # PPO's own rewards include the value expected after an episode that is cut off
                rewards.append(float(np.mean(self.locals["rewards"])))
                return True

            def _on_rollout_end(self) -> None:
                curve.append({"steps": self.num_timesteps, "reward": float(np.mean(rewards))})
                report(len(rewards) * config.robots)
                rewards.clear()
                self.model.save(folder / CHECKPOINT)
                os.replace(folder / CHECKPOINT, config.out / UNFINISHED)  # complete or not at all

        model.learn(
            max(config.steps - model.num_timesteps, 0),
            callback=Recorder(),
            reset_num_timesteps=False,
        )
    model.save(folder / CHECKPOINT)
    return curve


def network_of(model: Any) -> Network:
    """A model's network from features to mean actions."""
    policy = model.policy
    layers = [
        layer
        for layer in [*policy.mlp_extractor.policy_net, policy.action_net]
        if hasattr(layer, "weight")
    ]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    return Network(weights, tuple(layer.bias.detach().numpy().astype(float) for layer in layers))


def learning_curve(curve: Sequence[dict[str, float]]) -> Figure:
    """A figure of the reward against training steps, with a running mean as a line."""
    figure, axes = panel(
        "reward per step", "steps of all robots [thousand]", "mean of all robots [-]"
    )
    points = np.array([(point["steps"] / 1000, point["reward"]) for point in curve])
    axes.plot(*points.T, ".", color=GREY, ms=3)
    if len(points) >= _SMOOTH:
        axes.plot(
            *(np.convolve(line, np.ones(_SMOOTH) / _SMOOTH, "valid") for line in points.T),
            color=BLUE,
        )
    return figure
