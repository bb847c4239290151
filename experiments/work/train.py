"""`trackslip train`: train a policy with PPO from Stable-Baselines3 on the vector environment."""

import itertools
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.learning.training import Training
from experiments.options.train import PATH_TRACKING, TrainConfig
from experiments.recording import record_all
from experiments.report.terminal import progress
from experiments.storage.manifest import make_manifest
from experiments.storage.results import results_folder, write_results
from trackslip.errors import InvalidValueError, LogError, TrackslipError
from trackslip.logs.runlog import RunLog

POLICY, CHECKPOINT, CURVE = "policy.npz", "checkpoint.zip", "curve.png"
_DPI = 160  # of the figure of the curve
_MIN_RATE = 0.05  # final over initial learning rate
_CHECKPOINT_EVERY = 20  # updates


def run(config: TrainConfig) -> None:
    """Train, store the policy, draw its curve, and print the reward before and after."""
    from experiments.report.figures.learning import learning_curve  # late: it needs matplotlib

    began = time.perf_counter()
    with results_folder(config.out) as folder:
        training = _training(config)
        model = _model(config, training)
        before = model.num_timesteps
        try:
            curve = _learn(model, config, training, folder)
        except KeyboardInterrupt:
            if not (config.out / CHECKPOINT).is_file():
                raise
            raise KeyboardInterrupt("interrupted; --resume continues from the last checkpoint") from None
        training.save(model, folder / POLICY)
        found = training.finish(folder / POLICY)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "steps_per_s": (model.num_timesteps - before) / wall}
        summary = {"steps": model.num_timesteps, "curve": curve, **found, "timing": timing}
        write_results(folder, summary, make_manifest("train", config, wall, seed=config.seed))
        learning_curve(curve, found.get("rates", ())).savefig(folder / CURVE, dpi=_DPI)
        if config.rrd:
            record_all(folder, [log for name in config.references for log in _driven(config, folder / POLICY, name)])
    of = " of 1" if config.env == PATH_TRACKING else ""
    for point in curve[:1] + curve[-1:]:
        print(f"{point['steps']:>10,} steps: {point['reward']:.3f}{of} per step")
    training.show(found)
    print(f"{config.out / POLICY}: {model.num_timesteps:,} steps in {wall:.0f} s")


def _driven(config: TrainConfig, policy: Path, reference: str) -> list[RunLog]:
    """Run the policy along a path, from its beginning, on the first of the grounds; as far as it gets if it fails."""
    from experiments.driving.world import World
    from experiments.options.track import TrackConfig
    from experiments.options.world import GroundOptions
    from experiments.work.track import drive, make_reference
    from trackslip.errors import RunFailedError

    course = TrackConfig(
        controller=f"ppo:{policy}",
        compensation=config.compensation,
        reference=reference,
        ground=GroundOptions(config.grounds[0]),
        seed=config.seed,
        threads=config.threads,
        rrd=True,
    )
    world = World.of(course)
    try:
        logs = drive(course, world, make_reference(course, world.robot))
    except RunFailedError as error:
        logs = error.logs
    named = {"controller": f"ppo:{config.out}"}
    return [replace(log, run=f"policy {reference}", metadata=log.metadata | named) for log in logs[:1]]


def _training(config: TrainConfig) -> Training:
    """What is learnt, and where."""
    if config.env == PATH_TRACKING:
        from experiments.learning.path_tracking import PathTrackingTraining

        return PathTrackingTraining(config)
    from experiments.learning.traverse import TraverseTraining

    return TraverseTraining(config)


def _model(config: TrainConfig, training: Training) -> Any:
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


def _learn(model: Any, config: TrainConfig, training: Training, drafts: Path) -> list[dict[str, float]]:
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
