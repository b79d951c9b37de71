"""A MuJoCo model as one's own simulator, from a log of the real rig to a corrected model and a better controller.

A pendulum hangs on a pivot, and a tendon over a pulley pulls it up. The user's simulator is a MuJoCo model of it. The
"real" rig is another program: its own integrator in small steps, other masses, a bearing that sticks, a winch that
follows its command late, an encoder with counts and noise, and a logger with a clock of its own. Its log is diagnosed
with the MuJoCo model. What is named is written back into the model file, as `frictionloss` of the joint and as the
filter of the actuator. Both models then predict runs that no fit saw, and a controller is tuned on each and tried on
the real rig.

    python examples/closed_circle/circle.py
    python examples/closed_circle/circle.py --rigs 5
"""

import argparse
from pathlib import Path

import numpy as np
from controller import tried, tuned
from pendulum import BELIEVED, Batch, model, simulator, written_back
from reality import Reality, commands, log
from scipy import stats

from cable_envs.diagnosis import diagnose


def models(found):
    """Name -> text of a MuJoCo model: as it was believed, refitted without new physics, and corrected."""
    refitted = {name: found.absorbed[name]["after_refit"] for name in BELIEVED}
    return {"believed": model(BELIEVED), "refitted": model(refitted), "corrected": written_back(found)[0]}


def predicted(text, rig, runs=8, seconds=6.0):
    """RMS error [runs] of a model's angle, rad, on runs of the real rig that are in no recording."""
    rng, real = np.random.default_rng([28, rig]), Reality(rig, runs, noise_seed=100)
    tension = np.stack([commands(rng, seconds) for _ in range(runs)])
    shown = np.stack([real.step(tension[:, k]) for k in range(tension.shape[1])], axis=1)
    return np.sqrt(np.mean((Batch(text, runs).step(tension)[0] - shown) ** 2, axis=1))


def factor(before, after):
    """How many times as large, with a 95 % interval: pairs of runs, logarithms, Student's t."""
    logs = np.log(np.asarray(before) / np.asarray(after))
    half = stats.t.ppf(0.975, len(logs) - 1) * stats.sem(logs)
    return tuple(float(v) for v in np.exp([logs.mean(), logs.mean() - half, logs.mean() + half]))


def circle(rig, effects=None, tell=print):
    """Log, diagnosis, corrected model, prediction and controller of one real rig; ``effects``: all, or those to ask."""
    found, real = diagnose(log(rig), simulator=simulator(), effects=effects), Reality(rig, 1, 0)
    tell(f"rig {rig}: {found.verdict}; concealed: friction {real.friction:.4f} N m, lag {1e3 * real.lag:.1f} ms")
    for effect in found.effects:
        for name, e in effect.parameters.items():
            tell(f"  {effect.name}, {name}: {e.value:.4f} {e.unit} (95 %: {e.low:.4f} to {e.high:.4f})")
    texts, left = models(found), written_back(found)[1]
    tell(f"  no place in the model: {', '.join(left) or 'nothing'}")
    errors = {}
    for name, text in texts.items():
        gains = tuned(text)
        errors[name] = predicted(text, rig), tried(text, gains, rig)
        rms = [1e3 * float(np.sqrt(np.mean(e**2))) for e in errors[name]]
        tell(f"  {name:9s} predicts unseen runs to {rms[0]:5.1f} mrad; its controller follows to {rms[1]:5.1f} mrad")
    return texts["corrected"], errors


def told(errors_of_rigs):
    """By what factors the other models' errors are larger: over the runs of one rig, or over several rigs."""
    for k, what in enumerate(("prediction", "controller")):
        for other in ("believed", "refitted"):
            pairs = np.array([[errors[name][k] for name in (other, "corrected")] for errors in errors_of_rigs])
            if len(pairs) > 1:  # runs of one rig are alike: each rig counts once
                pairs = np.exp(np.log(pairs).mean(axis=2, keepdims=True))
            mean, low, high = factor(pairs[:, 0].ravel(), pairs[:, 1].ravel())
            print(f"{what}, {other} model: {mean:.1f} times the corrected one's error (95 %: {low:.1f} to {high:.1f})")


def main():
    """The circle, for one rig or several."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=1, help="how many real rigs")
    parser.add_argument("--effects", nargs="*", help="look for these effects only")
    parser.add_argument("--out", default="pendulum_corrected.xml", help="where the corrected model of the last goes")
    asked = parser.parse_args()
    done = [circle(rig, asked.effects) for rig in range(asked.rigs)]
    Path(asked.out).write_text(done[-1][0], encoding="utf-8")
    told([errors for _, errors in done])


if __name__ == "__main__":
    main()
