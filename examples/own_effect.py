"""An effect of one's own: physics that the package does not have, in one file, in the compiled simulator.

This file defines a magnetic detent: a force that pulls the load towards the nearest of evenly spaced places, as cogging
of a linear motor or a notched rail does. Any environment takes it by ``effect_file``; the diagnosis looks for it with
`cablebench diagnose RECORDING --effect-file examples/own_effect.py`. Run as a program it prints the root mean square of
the tracking error (RMSE) of the tuned PID controller and of adaptive control (MRAC) without the effect and with it.

    python examples/own_effect.py --force 5
"""

import argparse
from math import pi, sin
from pathlib import Path

import gymnasium as gym

from cable_envs.effects import Effect, EffectParameter

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"
CONTROLLERS = ("pid-tuned", "mrac-g22-tuned")


def _detent(position, force, pitch):
    """Force against positive motion, N, at a position in m; ``pitch``: distance of the places, m."""
    return force * sin(2.0 * pi * position / pitch)


EFFECT = Effect(
    name="magnetic_detent",
    seam="load",
    equation="F = -force sin(2 pi y / pitch)",
    source="Gieras, Piech, Tomczuk, Linear Synchronous Motors (2011): cogging force, first harmonic",
    parameters=(
        EffectParameter("force", "N", 0.0, 0.0, 1e3, "largest force of the detent", typical=2.0),
        EffectParameter("pitch", "m", 0.004, 1e-5, 1.0, "distance of two places at rest", typical=0.004),
    ),
    validity="any travel",
    experiment="slow constant speed over several pitches: the force repeats with the position, not with the time",
    confusable=("position_ripple",),
    hooks={"load": _detent},
)


def run(controller: str, force: float, seconds: float = 20.0, pitch: float = 0.004) -> float:
    """RMSE in m of one episode with sensor noise; no force: the effect is not there at all."""
    from cablebench.entrants.named import named_entrant
    from cablebench.protocol.metrics import measure
    from cablebench.run.evaluation import run_episode

    options = {"sensor_noise": True, "duration": seconds}
    if force:
        options |= {"effect_file": Path(__file__), "effects": {EFFECT.name: {"force": force, "pitch": pitch}}}
    env = gym.make(ENV_ID, **options)
    rmse = measure(run_episode(env, named_entrant(controller).make(env.unwrapped.setup), seed=0))["rmse"]
    env.close()
    return rmse


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    import cable_envs  # noqa: F401 (registers the environments)

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--force", type=float, default=5.0, help="of the detent, N")
    parser.add_argument("--seconds", type=float, default=20.0)
    chosen = parser.parse_args(arguments)
    for controller in CONTROLLERS:
        without, with_it = (run(controller, force, chosen.seconds) for force in (0.0, chosen.force))
        print(f"{controller:15} RMSE {1e3 * without:.3f} mm without, {1e3 * with_it:.3f} mm with {chosen.force:g} N")


if __name__ == "__main__":
    main()
