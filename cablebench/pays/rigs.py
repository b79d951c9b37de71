"""The hidden rigs of `cablebench retrain-study`: what each has beyond its preset, its records, its controllers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class HiddenRig:
    """One rig and what is asked of it.

    env           | environment id of the task
    preset        | the rig that everybody believes in
    effects       | what the hidden one has besides
    plant         | simulator that plays the hidden rig; the others are always "analytic"
    observe       | what controller and agent measure
    controller    | the paper's; the agent learns a correction of it
    duration      | s of an episode
    motions       | of the recordings (`cablebench.export.concealed`), the last held out: other than the task's
    unit, per_si  | in which errors are shown
    about, chosen | sentences of the page: what the rig is, and why these effects
    """

    env: str
    preset: str
    effects: Mapping[str, Mapping[str, float]]
    plant: str
    observe: str
    controller: str
    motions: tuple[Mapping[str, Any], ...]
    unit: str
    per_si: float
    about: str
    chosen: str
    agent: str = "residual-ppo"
    duration: float = 25.0


RIGS: Mapping[str, HiddenRig] = {
    "circuit": HiddenRig(
        env="cable_envs/PulleyCircuit-Position-Sine-v0",
        preset="zou-table2",
        effects={"actuator_lag": {"time": 0.05}, "backlash": {"gap": 0.1}},
        plant="chain",
        observe="drive",
        controller="feedforward-pid",
        motions=(
            {"design": "multisine", "amplitude": 1.0, "centre": 0.0},
            {"design": "triangle", "amplitude": 1.0, "centre": 0.0},
            {"design": "staircase", "amplitude": 1.0, "centre": 0.0},
        ),
        unit="mrad of the output angle",
        per_si=1e3,
        about="It is simulated by the chain of spans and contacts. Controllers and agents are tuned and trained on the "
        "analytic circuit, and measure the drive only.",
        chosen="The drive follows its command with a lag of 0.05 s. Its coupling has a gap of 0.1 rad, so that the "
        "output stays behind after every reversal. Two other choices were tried. With 0.02 N m of dry friction at the "
        "output instead of the gap, both effects were named too, the friction with load-dependent friction as its "
        "alternative. With all three at once the diagnosis, which names two effects at most, answered `unknown`.",
    ),
    "hole": HiddenRig(
        env="cable_envs/CableHole-Position-Sine-v0",
        preset="gu-inferred",
        effects={"position_dependent_load": {"stiffness": 400.0}, "actuator_lag": {"time": 0.1}},
        plant="analytic",
        observe="output",
        controller="mrac-g22",
        motions=(
            {"design": "multisine", "amplitude": 0.012, "centre": 0.0},
            {"design": "triangle", "amplitude": 0.012, "centre": 0.0},
            {"design": "staircase", "amplitude": 0.012, "centre": 0.0},
        ),
        unit="um of the load's position",
        per_si=1e6,
        about="There is no second formulation of the hole that can be controlled. Controllers and agents are therefore "
        "tested on the simulators' own hole with the concealed effects and sensor noise. They measure the load.",
        chosen="The load is pulled back by a spring of 400 N/m (tissue, wiring, a return spring), which gives 4 N of "
        "49 N at the end of the motion. The drive follows its command with a lag of 0.1 s. Two other choices were "
        "answered `unknown`. With 4 N of dry friction in the load's guide instead of the lag, guide and hole both hold "
        "the load at a stop, and can share it in many ways. At the true parameters the load's tension in generator and "
        "simulator then differs by 0.6 to 1.5 N below 1 mm/s and by 0.2 to 0.3 N above, with 0.1 N of noise. With a "
        "gap of 0.5 mm instead of the lag, both effects were found within 0.3 %. Up to 1.5 times the noise was left, "
        "all of it below 1 mm/s.",
    ),
}  # fmt: skip
