"""`trackslip train`: train a policy with PPO from Stable-Baselines3 on the vector environment."""

from experiments.options.train import TrainConfig as Config

EXAMPLES = (
    ("two million steps", "trackslip train"),
    ("resume from the last checkpoint", "trackslip train --steps 4000000 --resume"),
    ("to cross courses", "trackslip train --env traverse --out out/traverse"),
    ("a quick try", "trackslip train --steps 100000 --robots 16 --batch 512 --out out/try"),
)


def run(config: Config) -> None:
    """Train, store the policy, draw its curve, and print the reward before and after."""
    from experiments.work.train import run as work

    work(config)
