"""`trackslip tune`: find the gains of controllers, for each slip compensation on equal terms."""

from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated

import tyro

from experiments.common.choices import COMPENSATIONS, CONTROLLER_NAMES, TRAINING_PATHS
from experiments.common.options import Distinct, Whole
from experiments.simulate.options import ClosedLoopOptions
from trackslip.errors import require_positive

EXAMPLES = (
    ("Eq. 31, with and without slip compensation", "trackslip tune linear"),
    ("your own controller", "trackslip tune my_controller:MyController --out out/mine"),
)
_MAX_EVALUATIONS = 10_000


@dataclass(frozen=True)
class Config(ClosedLoopOptions):
    """Find gains that minimise the position error on training paths and drawn plants, below a limit on roughness.

    Every controller and compensation gets the same number of evaluations. Each evaluation drives four paths, which the
    suite fair of benchmark does not have, with --seeds plants each. An interrupted search resumes when it is run again
    with the same options.
    """

    controllers: tyro.conf.Positional[
        Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar="[CONTROLLER ...]")]
    ] = CONTROLLER_NAMES[1:]
    """Names, or MODULE:CLASS for your own, whose constructor's positive numbers are the gains."""
    compensations: Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar=f"{COMPENSATIONS} ...")] = (
        "none",
        "icr_radius",
        "online",
    )
    """Compensations to tune for."""
    evaluations: Annotated[int, Whole(12, _MAX_EVALUATIONS)] = 60
    """Candidates for each controller and compensation, in generations of 12."""
    roughness: float = 2.0
    """Limit on the root mean square rate of change of the set points, averaged over the training runs [rad/s^2]."""
    seeds: Annotated[tuple[int, ...], Distinct(), Whole()] = (100,)
    """Seeds of training plants, random starts and the scanner's noise."""
    seed: Annotated[int, Whole()] = 0
    """Root seed of the search."""
    threads: Annotated[int, Whole(0, 1024)] = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/tune")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("roughness", self.roughness)


def run(config: Config) -> None:
    """Search, store and print."""
    from experiments.benchmark.cases import BenchmarkCase, identified
    from experiments.benchmark.drive import ClosedLoops
    from experiments.benchmark.gains import GAINS_FILE
    from experiments.benchmark.tuning import gains_table, tune
    from experiments.common.lookup import tunable
    from experiments.common.plain_json import write_json
    from experiments.common.run import Run
    from experiments.studies.trials import Trial, forget_trials, run_trials

    loops = ClosedLoops(config, "drawn")
    pairs = list(product(config.controllers, config.compensations))
    driven = product(pairs, TRAINING_PATHS, config.seeds)
    cases = [BenchmarkCase(*pair, path, "stone", "random", seed) for pair, path, seed in driven]
    loops.check(cases)
    for name in config.controllers:
        tunable(name)
    depends_on = [case.id for case in identified(cases, loops)]
    with Run(config, partial(forget_trials, config.out)) as run:
        trials = [Trial(" ".join(pair), given=pair) for pair in pairs]
        outcomes = run_trials(run, partial(tune, config=config), trials, "tune {case}", depends_on)
        rows = [outcomes[trial.case][0].numbers for trial in trials]
        about = run.manifest(**loops.world.about)
        found_by = {name: about[name] for name in ("arguments", "git", "versions")}
        found_by |= {"paths": TRAINING_PATHS, "seeds": config.seeds, "roughness": config.roughness}
        write_json(run.folder / GAINS_FILE, {"found_by": found_by, "gains": rows})
        run.write({"gains": rows}, manifest=about)
    gains_table(rows).print()
    print(f"{config.out / GAINS_FILE}: {run.wall:.1f} s; trackslip benchmark --gains {config.out}")
