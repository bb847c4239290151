"""`trackslip train`: train a policy with PPO from Stable-Baselines3 on the vector environment."""

from experiments.common.run import Run
from experiments.train.config import PATH_TRACKING, Config
from experiments.train.crossing import crossing_table, gain_text, learning_curve
from experiments.train.tasks import PathTrackingTask, Traversing
from experiments.train.training import CHECKPOINT, POLICY, learn, model_of, network_of


def run(config: Config) -> None:
    """Train, store the policy, draw its curve, and print the reward before and after."""
    with Run(config) as run:
        task = PathTrackingTask(config) if config.env == PATH_TRACKING else Traversing(config)
        with run.busy("loading PyTorch"):
            model = model_of(config, task)
        before, policy = model.num_timesteps, run.folder / POLICY
        try:
            curve = learn(model, config, task, run.folder)
        except KeyboardInterrupt:
            if not (config.out / CHECKPOINT).is_file():
                raise KeyboardInterrupt("interrupted before the first checkpoint; nothing is stored") from None
            raise KeyboardInterrupt("interrupted; --resume continues from the last checkpoint") from None
        task.policy(network_of(model)).save(policy)
        found = task.tried(policy)
        rate = (model.num_timesteps - before) / run.wall
        run.write({"steps": model.num_timesteps, "steps_per_s": rate, "curve": curve, **found}, seed=config.seed)
        learning_curve(curve, found.get("rates", ())).savefig(run.folder / "curve.png", dpi=160)
    most = ", at most 1" if config.env == PATH_TRACKING else ""
    for point in curve[:1] + curve[-1:]:
        print(f"{point['steps']:>10,} steps: mean reward per step {point['reward']:.3f}{most}")
    if found:
        crossing_table(f"Unseen courses, {config.trials} in each row", found["rates"]).print()
        for gain in found["gains"]:
            print(gain_text(gain))
    print(f"{config.out / POLICY}: {model.num_timesteps:,} steps in {run.wall:.0f} s")
