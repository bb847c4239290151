"""Training with PPO: a model with checkpoints, its network and its learning curve."""

import itertools
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREY
from experiments.common.progress import progress
from experiments.common.style import styled
from experiments.train.config import Config
from experiments.train.tasks import LearningTask
from sim.network import Network
from trackslip.errors import InvalidValueError, LogError

POLICY, CHECKPOINT = "policy.npz", "checkpoint.zip"
UNFINISHED = f".{CHECKPOINT}"
"""The last checkpoint of an unfinished training, in OUT."""
_MIN_RATE = 0.05  # final over initial learning rate
_CHECKPOINT_EVERY = 20  # updates
_SMOOTH = 7  # points of the curve in a running mean


def last_checkpoint(out: Path) -> Path:
    """The last checkpoint of an unfinished training, or else of a finished one."""
    return out / UNFINISHED if (out / UNFINISHED).is_file() else out / CHECKPOINT


def model_of(config: Config, task: LearningTask) -> Any:
    """A new PPO model, or the one of the last checkpoint."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)  # its threads would take processors from the simulation
    checkpoint, first = last_checkpoint(config.out), config.learning_rate
    settings: dict[str, Any] = {
        "learning_rate": lambda left: first * (_MIN_RATE + (1 - _MIN_RATE) * left),  # by the share of training left
        "n_steps": config.horizon,
        "batch_size": config.batch,
        "n_epochs": config.epochs,
        "gamma": config.discount,
        "seed": config.seed,
        "device": "cpu",
    }
    if not config.resume:
        (config.out / UNFINISHED).unlink(missing_ok=True)
        network = {"net_arch": list(config.network), "activation_fn": torch.nn.Tanh, "log_std_init": task.deviation}
        return PPO("MlpPolicy", task.robots, policy_kwargs=network, **settings)
    if not checkpoint.is_file():
        raise LogError(f"{checkpoint}: no such file; training starts from scratch without --resume")
    try:
        rate = {"learning_rate": settings.pop("learning_rate")}
        model = PPO.load(checkpoint, task.robots, custom_objects=rate, **settings)
    except Exception as error:  # whatever is wrong with the file
        reason = textwrap.shorten(f"{type(error).__name__}: {error}", 120)  # of other spaces, it lists all bounds
        raise LogError(f"{checkpoint}: can't be resumed ({reason})") from error
    layers = tuple(model.policy_kwargs["net_arch"])
    if layers != config.network:
        raise InvalidValueError("network", config.network, f"{layers} with --resume, as in {checkpoint}")
    return model


def learn(model: Any, config: Config, folder: Path) -> list[dict[str, float]]:
    """Train until `config.steps`, with checkpoints in `config.out`, and the last one in the `folder` of results.

    Returns for each update, those before the checkpoint included, the steps of all robots so far, and since the one
    before their mean reward [-] and the share of the episodes that crossed their courses, if there are courses.
    """
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))  # its own would leave a folder among the temporary files
    model.curve = curve = getattr(model, "curve", [])  # which checkpoints contain, as all that a model has
    rewards: list[float] = []  # since the last update, mean of all robots
    crossed: list[bool] = []  # episodes that have ended since then
    with progress("training", config.steps, "steps", model.num_timesteps) as report:

        class Recorder(BaseCallback):  # type: ignore[misc, unused-ignore]
            updates = 0

            def _on_step(self) -> bool:
                # PPO's own rewards also contain the expected ones after an episode that is cut off
                rewards.append(float(np.mean(self.locals["rewards"])))
                ended = itertools.compress(self.locals["infos"], self.locals["dones"])
                crossed.extend(info["outcome"] == "reached" for info in ended if "outcome" in info)
                return True

            def _on_rollout_end(self) -> None:
                point = {"steps": self.num_timesteps, "reward": float(np.mean(rewards))}
                curve.append(point | ({"crossed": float(np.mean(crossed))} if crossed else {}))
                report(len(rewards) * config.robots)
                rewards.clear()
                crossed.clear()
                self.updates += 1
                if self.updates % _CHECKPOINT_EVERY == 1:  # the first one early
                    self.model.save(folder / CHECKPOINT)
                    os.replace(folder / CHECKPOINT, config.out / UNFINISHED)  # complete or not at all

        model.learn(max(config.steps - model.num_timesteps, 0), callback=Recorder(), reset_num_timesteps=False)
    model.save(folder / CHECKPOINT)
    return curve


def network_of(model: Any) -> Network:
    """The network of a model, from features to mean actions."""
    policy = model.policy
    layers = [layer for layer in [*policy.mlp_extractor.policy_net, policy.action_net] if hasattr(layer, "weight")]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    return Network(weights, tuple(layer.bias.detach().numpy().astype(float) for layer in layers))


@styled
def learning_curve(curve: Sequence[dict[str, float]]) -> Figure:
    """Reward over the training's steps and, where courses are crossed, their share; lines are running means."""
    titles = {"reward": ("reward per step", 1.0), "crossed": ("crossed in training [%]", 100.0)}
    names = [name for name in titles if any(name in point for point in curve)]
    figure = Figure(figsize=(4.5 * len(names), 3.0), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        title, factor = titles[name]
        points = np.array([(point["steps"] / 1000, factor * point[name]) for point in curve if name in point])
        axes.plot(*points.T, ".", color=GREY, ms=3)
        if len(points) >= _SMOOTH:
            axes.plot(*(np.convolve(line, np.ones(_SMOOTH) / _SMOOTH, "valid") for line in points.T), color=BLUE)
        axes.set(title=title, xlabel="steps of all robots [thousand]")
    return figure
