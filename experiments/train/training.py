"""Training with PPO: a model with checkpoints, and its network."""

from __future__ import annotations

import itertools
import os
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.common.progress import progress
from experiments.train.config import Config
from sim.network import Network
from trackslip.errors import InvalidValueError, LogError, TrackslipError

if TYPE_CHECKING:
    from experiments.train.tasks import LearningTask


POLICY, CHECKPOINT = "policy.npz", "checkpoint.zip"
_MIN_RATE = 0.05  # final over initial learning rate
_CHECKPOINT_EVERY = 20  # updates


def model_of(config: Config, task: LearningTask) -> Any:
    """A new PPO model, or the one of the last checkpoint."""
    try:
        import torch
        from stable_baselines3 import PPO
    except ImportError as error:
        raise TrackslipError('train needs Stable-Baselines3: pip install "trackslip[rl]"') from error

    torch.set_num_threads(1)  # its threads would take processors from the simulation
    robots, checkpoint = task.robots(), config.out / CHECKPOINT
    first = config.learning_rate

    def rate(left: float) -> float:
        """The learning rate where so large a share of the training is left."""
        return first * (_MIN_RATE + (1 - _MIN_RATE) * left)

    settings: dict[str, Any] = {
        "n_steps": config.horizon,
        "batch_size": config.batch,
        "n_epochs": config.epochs,
        "gamma": config.discount,
        "seed": config.seed,
    }
    if config.resume:
        if not checkpoint.is_file():
            raise LogError(f"{checkpoint}: no such file; training starts from scratch without --resume")
        try:
            model = PPO.load(checkpoint, robots, "cpu", {"learning_rate": rate}, **settings)
        except Exception as error:  # whatever is wrong with the file
            reason = textwrap.shorten(f"{type(error).__name__}: {error}", 120)  # of other spaces, it lists all bounds
            raise LogError(f"{checkpoint}: can't be resumed ({reason})") from error
        layers = tuple(model.policy_kwargs["net_arch"])
        if layers != config.network:
            raise InvalidValueError("network", config.network, f"{layers} with --resume, as in {checkpoint}")
        return model
    return PPO(
        "MlpPolicy",
        robots,
        learning_rate=rate,
        device="cpu",
        policy_kwargs={
            "net_arch": list(config.network),
            "activation_fn": torch.nn.Tanh,
            "log_std_init": task.initial_deviation,
        },
        **settings,
    )


def learn(model: Any, config: Config, task: LearningTask, drafts: Path) -> list[dict[str, float]]:
    """Train until `config.steps`, with checkpoints, which are drafted in the folder `drafts` on the same disk.

    Returns for each update, those before the checkpoint included, the steps of all robots so far, their mean reward
    since the one before [-], and what `task` says of the episodes that have ended since.
    """
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import Logger

    model.set_logger(Logger(None, []))  # its own would leave a folder among the temporary files
    model.curve = curve = getattr(model, "curve", [])  # which checkpoints contain, as all that a model has
    rewards: list[float] = []  # since the last update, mean of all robots
    ended: list[dict[str, Any]] = []  # last infos of episodes since then
    with progress("training", config.steps, "steps", model.num_timesteps) as report:

        class Recorder(BaseCallback):  # type: ignore[misc, unused-ignore]
            updates = 0

            def _on_step(self) -> bool:
                # PPO's own rewards also contain the expected ones after an episode that is cut off
                rewards.append(float(np.mean(self.locals["rewards"])))
                ended.extend(itertools.compress(self.locals["infos"], self.locals["dones"]))
                return True

            def _on_rollout_end(self) -> None:
                mean = {"steps": self.num_timesteps, "reward": float(np.mean(rewards))}
                curve.append(mean | task.ended(ended))
                report(len(rewards) * config.robots)
                rewards.clear()
                ended.clear()
                self.updates += 1
                if self.updates % _CHECKPOINT_EVERY == 1:  # the first one early
                    _save(self.model, config.out, drafts)

        model.learn(max(config.steps - model.num_timesteps, 0), callback=Recorder(), reset_num_timesteps=False)
    _save(model, config.out, drafts)
    return curve


def _save(model: Any, folder: Path, drafts: Path) -> None:
    """Save the checkpoint, complete or not at all."""
    model.save(drafts / CHECKPOINT)
    os.replace(drafts / CHECKPOINT, folder / CHECKPOINT)


def network_of(model: Any) -> Network:
    """The network of a model, from features to mean actions."""
    policy = model.policy
    layers = [layer for layer in [*policy.mlp_extractor.policy_net, policy.action_net] if hasattr(layer, "weight")]
    weights = tuple(layer.weight.detach().numpy().T.astype(float) for layer in layers)
    biases = tuple(layer.bias.detach().numpy().astype(float) for layer in layers)
    return Network(weights, biases)
