"""Pages of the programming interface, from docstrings: what a user of the package imports."""

from collections.abc import Mapping

from docs.site.markdown import page, table

PAGES: Mapping[str, tuple[str, str, tuple[str, ...]]] = {
    "environments": (
        "Environments",
        "Single environments, native batches, and what defines them.",
        ("cable_envs.envs.CableEnv", "cable_envs.vector.CableVectorEnv", "cable_envs.device",
         "cable_envs.sim.setup.Setup", "cable_envs.sim.setup.make_setup", "cable_envs.sim.tasks",
         "cable_envs.sim.references"),
    ),
    "rigs": (
        "Rigs and replay",
        "The parameters of a test rig, and recorded inputs through many mechanisms at once.",
        ("cable_envs.sim.rigs", "cable_envs.sim.replay.replay", "cable_envs.sim.replay.replays_on",
         "cable_envs.core.params", "cable_envs.core.errors"),
    ),
    "plants": (
        "Plants and effects",
        "What a plant declares of itself, and physics that a simulator may lack.",
        ("cable_envs.plants", "cable_envs.plants.family", "cable_envs.plants.base", "cable_envs.plants.declarations",
         "cable_envs.effects.base", "cable_envs.plants.own_effects"),
    ),
    "continuous": (
        "Plants without Gymnasium",
        "Equations of motion: f(x, u), rest, linear systems, simulation, CasADi functions.",
        ("cable_envs.continuous.models", "cable_envs.continuous.linear.Linear", "cable_envs.continuous.motion.Motion",
         "cable_envs.continuous.symbolic.Smooth", "cable_envs.plants.continuous"),
    ),
    "controllers": (
        "Controllers and agents",
        "Reference controllers: SI in, a command out. Agents of stable-baselines3.",
        ("cable_envs.baselines", "cable_envs.baselines.base", "cable_envs.agents.vec_env"),
    ),
    "diagnosis": (
        "Diagnosis",
        "Recordings, and what a simulator leaves out of them.",
        ("cable_envs.diagnosis.data.recording", "cable_envs.diagnosis.engine", "cable_envs.diagnosis.readers.base",
         "cable_envs.diagnosis.simulators", "cable_envs.diagnosis.simulators.base"),
    ),
    "benchmark": (
        "Benchmark",
        "Episodes, metrics and boards.",
        ("cablebench.run.evaluation", "cablebench.protocol.metrics", "cablebench.entrants.entrant",
         "cablebench.board.tables"),
    ),
}  # fmt: skip


def pages() -> dict[str, str | bytes]:
    """A list, and a page for each group."""
    rows = [(f"[{title}]({name}.md)", summary) for name, (title, summary, _) in PAGES.items()]
    made: dict[str, str | bytes] = {"api/index.md": page("# Programming interface", table(("page", "has"), rows))}
    for name, (title, summary, names) in PAGES.items():
        made[f"api/{name}.md"] = page(f"# {title}", summary, *(f"::: {one}" for one in names))
    return made
