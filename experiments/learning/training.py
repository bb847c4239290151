"""Training with PPO: an environment to learn in, a model with checkpoints, and what becomes of the result."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from experiments.report.terminal import progress
from trackslip.errors import InvalidValueError, LogError, TrackslipError
from trackslip.logs.runlog import RunLog

if TYPE_CHECKING:
    from experiments.commands.train import Config

POLICY, CHECKPOINT = "policy.npz", "checkpoint.zip"
_MIN_RATE = 0.05  # final over initial learning rate
_CHECKPOINT_EVERY = 20  # updates


class Training(Protocol):
    """An environment to learn in, and what becomes of the result."""

    initial_deviation: float
    """Standard deviation of the actions at the beginning, as a natural logarithm."""

    def robots(self) -> Any:
        """The vector environment, with the interface of Stable-Baselines3."""

    def ended(self, infos: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Further values of a point of the learning curve, from the last infos of episodes that have ended."""

    def save(self, model: Any, file: Path) -> None:
        """Write the policy of a model."""

    def finish(self, policy: Path) -> dict[str, Any]:
        """Try the policy that was written; returns entries of summary.json."""

    def show(self, found: dict[str, Any]) -> None:
        """Print what `finish` returned."""


def driven(config: Config, policy: Path, reference: str) -> list[RunLog]:
    """Run the policy along a path, from its beginning, on the first of the grounds; as far as it gets if it fails."""
    from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops
    from experiments.driving.lookup import compensation
    from experiments.driving.world import World
    from experiments.options.world import GroundOptions, Simulation
    from trackslip.errors import RunFailedError
    from trackslip.trajectory.named import load_reference

    ground = GroundOptions(config.grounds[0])
    world = World.of(Simulation(ground=ground, seed=config.seed, threads=config.threads, rrd=True))
    path, name = load_reference(reference), f"ppo:{policy}"
    one = ClosedLoopRun(f"policy {reference}", "track", config.seed, name, config.compensation, path.pose(0.0))
    try:
        law = partial(compensation, robot=world.robot.geometry, laws=None)
        logs = drive_closed_loops([one], world, path, "plate", law)
    except RunFailedError as error:
        logs = error.logs
    more = {"controller": f"ppo:{config.out}", "reference": reference}
    return [replace(log, metadata=log.metadata | more) for log in logs]


def training_of(config: Config) -> Training:
    """What is learnt, and where."""
    if config.env == "path_tracking":
        from experiments.learning.path_tracking import PathTrackingTraining

        return PathTrackingTraining(config)
    from experiments.learning.traverse import TraverseTraining

    return TraverseTraining(config)


def model_of(config: Config, training: Training) -> Any:
    """A new PPO model, or the one of the last checkpoint."""
    try:
        import torch
        from stable_baselines3 import PPO
    except ImportError as error:
        raise TrackslipError('train needs Stable-Baselines3: pip install "trackslip[rl]"') from error

    torch.set_num_threads(1)  # its threads would take processors from the simulation
    robots, checkpoint = training.robots(), config.out / CHECKPOINT
    rate = _falling(config.learning_rate)
    settings = {
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
            raise LogError(f"{checkpoint}: can't be resumed ({type(error).__name__}: {error})") from error
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
            "log_std_init": training.initial_deviation,
        },
        **settings,
    )


def _falling(rate: float) -> Callable[[float], float]:
    """The learning rate as a function of the remaining share of the training."""
    return lambda left: rate * (_MIN_RATE + (1 - _MIN_RATE) * left)


def learn(model: Any, config: Config, training: Training, drafts: Path) -> list[dict[str, float]]:
    """Train until `config.steps`, with checkpoints, which are drafted in the folder `drafts` on the same disk.

    Returns for each update the steps of all robots so far, their mean reward since the one before [-], and what
    `training` says of the episodes that have ended since.
    """
    from stable_baselines3.common.callbacks import BaseCallback

    curve: list[dict[str, float]] = []
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
                curve.append(mean | training.ended(ended))
                report(len(rewards) * config.robots)
                rewards.clear()
                ended.clear()
                self.updates += 1
                if self.updates % _CHECKPOINT_EVERY == 0:
                    _save(self.model, config.out, drafts)

        model.learn(max(config.steps - model.num_timesteps, 0), callback=Recorder(), reset_num_timesteps=False)
    _save(model, config.out, drafts)
    return curve


def _save(model: Any, folder: Path, drafts: Path) -> None:
    """Save the checkpoint, complete or not at all."""
    model.save(drafts / CHECKPOINT)
    os.replace(drafts / CHECKPOINT, folder / CHECKPOINT)
