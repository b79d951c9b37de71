"""What ``cablebench`` offers: every command with its group, an example that works, and its former names."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cablebench.cli.bench import demo, envs, evaluate, export, leaderboard, new, replay, run, seal, submit
from cablebench.cli.learn import publish, train, tune
from cablebench.cli.physics import (
    blind_test,
    diagnose,
    export_rig,
    identify,
    import_,
    inspect_,
    next_experiment,
    real_data,
    reproduce,
)
from cablebench.cli.suite import anchors, concealed, datasets, try_

SIMULATE, LEARN, BENCHMARK, DIAGNOSE, REPRODUCE = "Simulate", "Learn", "Benchmark", "Diagnose", "Reproduce"


@dataclass(frozen=True)
class Command:
    """One command of the program."""

    panel: str
    """Group in ``cablebench --help``."""
    name: str
    function: Callable[..., Any]
    """What typer makes the command of."""
    example: str
    """A whole command line, shown at the end of its help."""
    former: tuple[str, ...] = ()
    """Names that it had before: they work, and the help does not list them."""


COMMANDS = (
    Command(SIMULATE, "envs", envs.envs, "cablebench envs CableHole-Position-Sine"),
    Command(SIMULATE, "run", run.run, "cablebench run CableHole-Position-Sine --controller pid --render hole.gif"),
    Command(
        SIMULATE, "export", export.export,
        "cablebench export CableHole-Position-Sine --format recording --controller pid --episodes 2 --out rig",
    ),
    Command(SIMULATE, "new", new.new, "cablebench new controller my-pid"),
    Command(
        LEARN, "tune", tune.tune,
        "cablebench tune --controller pid --env CableHole-Position-Sine --trials 40 --out pid-tuned.yaml",
    ),
    Command(
        LEARN, "train", train.train, "cablebench train --algo ppo --env CableHole-Position-Sine --out runs/my-agent"
    ),
    Command(LEARN, "publish", publish.publish, "cablebench publish runs/my-agent --out policies"),
    Command(BENCHMARK, "try", try_.try_, "cablebench try pid-tuned --task CableHole-Position-Sine"),
    Command(
        BENCHMARK, "evaluate", evaluate.evaluate,
        "cablebench evaluate --protocol quick --controller pid --results results/mine",
    ),
    Command(BENCHMARK, "submit", submit.submit, "cablebench submit my_pid.py --board quick"),
    Command(BENCHMARK, "leaderboard", leaderboard.leaderboard, "cablebench leaderboard --board quick --out board"),
    Command(
        BENCHMARK, "replay", replay.replay,
        "cablebench replay --board quick --entrant mrac-g22 --env CableHole-Position-Sine",
    ),
    Command(BENCHMARK, "anchors", anchors.anchors, "cablebench anchors --protocol suite-v1"),
    Command(
        BENCHMARK, "concealed", concealed.concealed,
        "cablebench concealed --mechanism hole --rigs 3 --row nominal-controller --out hidden",
    ),
    Command(
        LEARN, "datasets", datasets.datasets,
        "cablebench datasets --env CableHole-Sine-Medium --behaviour reference --episodes 1 --out datasets",
    ),
    Command(BENCHMARK, "seal", seal.seal, "cablebench seal --protocol quick --out exam"),
    Command(BENCHMARK, "demo", demo.demo, "cablebench demo --out results/demo"),
    Command(DIAGNOSE, "import", import_.import_, "cablebench import table logs --mapping jaw.yaml --out jaw"),
    Command(DIAGNOSE, "inspect", inspect_.inspect, "cablebench inspect jaw", former=("first-look",)),
    Command(DIAGNOSE, "diagnose", diagnose.diagnose, "cablebench diagnose jaw --out jaw-found"),
    Command(
        DIAGNOSE, "next-experiment", next_experiment.next_experiment,
        "cablebench next-experiment jaw --answer jaw-found --out jaw-next",
    ),
    Command(
        DIAGNOSE, "export-rig", export_rig.export_rig,
        "cablebench export-rig jaw-found/augmented.yaml --format fmu --out jaw.fmu",
    ),
    Command(DIAGNOSE, "identify", identify.identify, "cablebench identify rig --method lsq"),
    Command(
        REPRODUCE, "reproduce", reproduce.reproduce, "cablebench reproduce gu-table2 zou-table3 --out results/papers"
    ),
    Command(
        REPRODUCE, "real-data", real_data.real_data,
        "cablebench real-data --shared ../shared/recordings --only band-brake --out results/real",
        former=("recordings",),
    ),
    Command(
        REPRODUCE, "blind-test", blind_test.blind_test, "cablebench blind-test --quick --out results/blind-test",
        former=("proof",),
    ),
)  # fmt: skip
"""Every command, in the order of the help."""
