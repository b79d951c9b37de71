"""Where nothing is missing, the generators of the proof and the simulators under test are the same mechanism."""

import numpy as np
import pytest

from cable_envs.plants.circuit import chain as pulley_chain
from cable_envs.plants.drive import plant as linear_drive
from cable_envs.plants.hole import plant as cable_hole
from cable_envs.proof.cases import DESIGNS
from cable_envs.proof.excitation import reference
from cable_envs.proof.rigs import CLOCK, SIMULATE, random_rig
from cable_envs.sim.replay import replay

PLANTS = {"linear_drive": linear_drive.PLANT, "cable_hole": cable_hole.PLANT, "pulley_circuit": pulley_chain.PLANT}
DRIVEN = {
    "linear_drive": ("force", "force", ("position",)),
    "cable_hole": ("drive_position", "follow", ("drive_tension", "load_position")),
    "pulley_circuit": ("drive_angle", "follow", ("drive_torque", "output_angle", "output_torque")),
}


@pytest.mark.slow
@pytest.mark.parametrize("system", PLANTS)
@pytest.mark.parametrize("seed", range(3))
def test_without_effects_both_agree_within_the_noise(system, seed):
    """The same drive motion (or force) through both: what differs is below a fifth of the noise of each channel, which
    adds less than 2 % to its RMS even before the refit takes its part."""
    rng = np.random.default_rng([seed, 7])
    rig = random_rig(system, rng, ())
    motion = rig.centre + reference(str(rng.permutation(DESIGNS)[0]), rng, 20.0, rig.amplitude, CLOCK)
    ours = SIMULATE[system](rig.values, motion)
    plant, (driven, mode, channels) = PLANTS[system], DRIVEN[system]
    known = {t.name: t.value for t in rig.told}
    start = motion[0] * (7 / 5 if system == "pulley_circuit" else 1.0)
    # a held force acts from its tick on; a position is that at the end of a step
    command = ours[driven][:-1] if mode == "force" else ours[driven][1:]
    hold = "step" if mode == "force" else "ramp"
    theirs = replay(
        plant, plant.table.pack(known)[:, None], command, CLOCK, drive=mode, hold=hold, signals=channels, start=start,
        substeps=4,
    )  # fmt: skip
    for k, name in enumerate(channels):
        apart = ours[name][1:] - theirs[:, k, 0]
        if (
            mode == "force"
        ):  # nothing holds the position: the slow drift of a double integral is no difference of the law
            apart = apart - np.polyval(np.polyfit(ours["time"][1:], apart, 3), ours["time"][1:])
            assert apart.std() < 2.0 * rig.noise[name], name
        else:
            assert apart[500:].std() < 0.2 * rig.noise[name], name
