"""`trackslip train`: train a policy with PPO from Stable-Baselines3 on the vector environment."""

from dataclasses import replace

from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.simulate.motors import without_motors
from experiments.train.config import TRAVERSE, Config
from experiments.train.crossing import crossing_rates, crossing_table
from experiments.train.page import page, smoke_test
from experiments.train.tasks import learning_task
from experiments.train.training import (
    ONNX,
    POLICY,
    UNFINISHED,
    learn,
    model_of,
    network_of,
    resume,
)
from sim.policy import write_onnx
from trackslip.errors import OutputError
from trackslip.replacement import CHECKPOINT_FILE


def run(config: Config) -> None:
    """Train a policy, store it with its learning curve, and print the reward before and after
    training.
    """
    anew = config.overwrite and not config.resume
    is_unfinished = (config.out / UNFINISHED).is_file()
    if is_unfinished and not config.resume and not anew:
        raise OutputError(
            f"out = {str(config.out)!r}: contains an unfinished training; --resume continues it, "
            "--overwrite starts again"
        )
    curve: list[dict[str, float]] = []
    changed: list[str] = []
    taking_up = replace(config, overwrite=config.overwrite or config.resume)
    with Run(taking_up, resumed=CHECKPOINT_FILE) as run:
        with run.busy("loading PyTorch"):
            task = learning_task(config)
            model = model_of(config, task)
        if anew:
            (config.out / UNFINISHED).unlink(missing_ok=True)
        if config.resume:
            curve, changed = resume(config, task, model)
        try:
            learn(model, config, task, curve, run.folder)
        except KeyboardInterrupt:
            what = "no update is complete, nothing is stored"
            if config.resume or (config.out / UNFINISHED).is_file():
                what = "--resume continues from the last update"
            raise KeyboardInterrupt(f"interrupted; {what}") from None
        policy = task.policy(network_of(model))
        policy.save(run.folder / POLICY)
        write_onnx(run.folder / ONNX, policy, task.env.observed, task.env.commanded)
        rates = []
        if config.env == TRAVERSE:
            rates = crossing_rates(
                policy, config.difficulty, config.trials, config.seed, config.threads
            )
        steps = model.num_timesteps
        manifest = run.manifest(seed=config.seed)
        run.write({"steps": steps, "curve": curve, "rates": rates}, manifest=manifest)
        notes = without_motors(task.robot, task.drive)
        if changed:
            notes.insert(
                0,
                f"{', '.join(changed)} changed since the checkpoint: all robots began new "
                "episodes, with new random numbers",
            )
        page(config, steps, curve, rates, notes, manifest).write(run.folder, config.pdf)
    for point in (curve[0], curve[-1]):
        print(f"{point['steps']:>10,} steps: mean reward per step {point['reward']:.3f}")
    if rates:
        crossing_table(f"Unseen courses, {config.trials} in each row", rates).print()
    for note in notes:
        print(f"Note: {note}.")
    if line := smoke_test(steps):
        print(f"Warning: {line}.")
    print(f"{config.out / ONNX}, {REPORT_FILE}: {steps:,} steps in {run.wall:.0f} s")
