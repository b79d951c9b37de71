"""`NUMBA_ENABLE_CUDASIM=1 python -m benchmarks.gpu.precision`: how far batches on a device are from those of the CPU.

The kernels for CUDA run on numba's simulator, in double and in single precision, beside the CPU's. Actions wander about
what holds the mechanism. Errors are parts of a channel's scale. ``--page docs/gpu.md`` puts the table in its place.
"""

import argparse
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)
from benchmarks.gpu.measure import CASES
from benchmarks.gpu.tables import PRECISIONS, markdown, put
from cable_envs.core.compiling import device

STEPS = {"hole": 2000}
"""Control steps, where not `USUAL`: a whole episode."""
USUAL = 50
WANDER, BACK = 0.04, 0.05
"""Standard deviation of an action's change in a step, and the share of its distance that it goes back."""

MORE = {"circuit without counts of encoders": (CASES["circuit"][0], {"rig": {"encoder_counts": 0.0}})}
"""What shows where an error comes from."""

BEGIN, END = "<!-- begin: python -m benchmarks.gpu.precision -->", "<!-- end: precision -->"


def errors(env_id, options, steps):
    """Precision -> (largest error of each channel, largest error of a reward)."""
    made = [{}] + [{"device": "cuda", "precision": precision} for precision in PRECISIONS]
    envs = [gym.make_vec(f"cable_envs/{env_id}", 1, sensor_noise=True, **options, **more).unwrapped for more in made]
    for one in envs:
        one.reset(seed=1)
    hold, rng = np.array(envs[0].last_actions)[:, None], np.random.default_rng(2)
    action, off, late = hold.copy(), np.zeros((2, len(envs[0].channels))), np.zeros(2)
    for _ in range(steps):
        action = np.clip(action + WANDER * rng.standard_normal(hold.shape) + BACK * (hold - action), -1.0, 1.0)
        outcomes = [[np.array(part) for part in one.step(action.astype(np.float32))[:2]] for one in envs]
        for k, (seen, reward) in enumerate(outcomes[1:]):
            off[k] = np.maximum(off[k], np.abs(seen - outcomes[0][0])[0])
            late[k] = max(late[k], abs(reward - outcomes[0][1])[0])
    return {name: (off[k], late[k]) for k, name in enumerate(PRECISIONS)}, [c.name for c in envs[0].channels]


def rows():
    for case, (env_id, options) in {**CASES, **MORE}.items():
        steps = STEPS.get(case, USUAL)
        found, names = errors(env_id, options, steps)
        both, (off, reward) = found["float64"], found["float32"]
        at = int(np.argmax(off))
        yield (
            case, f"{steps:,}", f"{max(both[0].max(), both[1]):.2g}", f"{off[at]:.1e}, `{names[at]}`",
            f"{np.median(off):.1e}", f"{reward:.1e}",
        )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu.precision", description=__doc__)
    parser.add_argument("--page", type=Path, help="a page whose marked part is replaced by the table")
    arguments = parser.parse_args()
    if not device.simulated():
        sys.exit("NUMBA_ENABLE_CUDASIM=1 is missing")
    head = (
        "environment", "steps", "double: largest error of all", "single: largest error of an observation, and where",
        "median of the channels' largest errors", "largest error of a reward",
    )  # fmt: skip
    found = []
    for row in rows():
        found.append(row)
        print(*row, sep=" | ", flush=True)
    text = markdown(head, found)
    print(text)
    if arguments.page:
        put(arguments.page, BEGIN, END, text)


if __name__ == "__main__":
    main()
