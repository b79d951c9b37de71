"""Bode plot of a tendon in a sheath with python-control: friction makes another system of each direction of motion.

The rig `bowden-1m` is linearised where its load is about to be pulled in, and where it is about to be paid out
(`cable_envs.model(rig).linearise(sliding=...)`), and once without friction. The file prints the gain from the drive's
force to the position of the load at low frequency and the first resonance of each, and saves the plot.

    pip install 'cable-envs[casadi]'
    python examples/bode.py --out bode.png
"""

import argparse

import control
import matplotlib.pyplot as plt
import numpy as np

import cable_envs

OMEGA = np.logspace(0.0, 3.0, 600)


def systems(rig="bowden-1m", mode="tension", signal="load_position", at=0.005):
    """Systems of python-control from the command to a signal, by name."""
    free = cable_envs.load_rig(rig).replace({"friction_coefficient": 0.0})
    made = {}
    for name, one, way in (("pulled in", rig, 1), ("paid out", rig, -1), ("without friction", free, 1)):
        linear = cable_envs.model(one, mode).linearise(sliding=way, at=at)
        whole = control.ss(*linear, states=linear.states, inputs=linear.inputs, outputs=linear.outputs, name=name)
        made[name] = whole[signal, "command"]
        made[name].name = name
    return made


def resonance(system):
    """Frequency of the first peak of the gain, rad/s."""
    gain = np.abs(system(1j * OMEGA))
    return OMEGA[1:-1][(gain[1:-1] > gain[:-2]) & (gain[1:-1] > gain[2:])][0]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="bode.png", help="picture to write")
    chosen = parser.parse_args(arguments)
    made = systems()
    for name, system in made.items():
        print(f"{name:17} {1e3 * system.dcgain():.3f} mm/N, resonance at {resonance(system):.1f} rad/s")
    title = "Force of the drive to position of the load"
    control.bode_plot(list(made.values()), OMEGA, title=title, legend_loc="lower left")
    plt.gcf().savefig(chosen.out, dpi=120)


if __name__ == "__main__":
    main()
