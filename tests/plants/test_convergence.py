"""The integration is converged: far shorter steps change no episode by more than 1 %, whatever rig and controller.

Rigs are drawn about those of the tasks (`benchmarks.properties.rigs`). Every reference controller that applies moves
them, in every action mode. The differences are root mean squares of the worst signal: of positions relative to how much
they move, of tensions and torques relative to those at the drive, of a servo's torque relative to itself. There is no
smallest size. A rig that does not determine its motion says nothing: with every parameter 1e-4 larger or smaller, in
one of eight random directions, it moves more than 1 % differently.
"""

import pytest

from benchmarks.properties import loops
from benchmarks.properties.measures import MOST
from benchmarks.properties.rigs import Box
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.rigs import load_rig
from cable_envs.sim.tasks import load_task

PERIOD = 0.01
CASES = list(loops.cases())
QUICK = [
    ("CableHole-Position", "tension", "mrac-g22"), ("CableHole-Tension", "speed", "oracle"),
    ("TendonSheath-Position", "position", "feedforward-pid"), ("TendonSheath-Tension", "tension", "pid"),
    ("PulleyCircuit-Position", "position", "pid"), ("PulleyCircuit-Torque", "torque", "feedforward-pid"),
]  # fmt: skip
REVERSALS = """MRAC decides in which control period it turns its friction compensation round: tensions 0.06 % off let it
turn a period later on one rig of ten, 12 %; with twice as many steps 0.1 % at most"""
STEEP = """a load that sticks and slips within every control period, under friction that grows steeply with the speed:
its speeds behind a break-away are 2 % off, MRAC turns round a period later on one rig of ten, 1.6 %; with twice as
many steps below 0.01 %"""
KNOWN = {
    ("CableHole-Tension", "speed", "mrac-g22"): STEEP, ("TendonSheath-Tension", "tension", "mrac-g22"): REVERSALS,
}  # fmt: skip
"""What is not within 1 % yet on random rigs, and why."""
FINER, FINEST = 20, 100
"""How much shorter the steps are that an episode is compared with: on random rigs, and on those of the tasks."""


def _shipped(task: str):
    return load_rig(load_task(task).rigs.get("v1", load_task(task).rig)).replace(_smooth(task))


def _smooth(task: str) -> dict:
    """An encoder that shows the next step sooner jumps: without steps, what the integration does is seen alone."""
    rig = load_rig(load_task(task).rigs.get("v1", load_task(task).rig))
    return {"encoder_counts": 0.0} if rig.drive == "motor" else {}


def _known(case: tuple) -> tuple:
    """A case that is not within 1 % yet fails, and must be taken out of `KNOWN` when it no longer does."""
    return (pytest.mark.xfail(reason=KNOWN[case], strict=True),) if case in KNOWN else ()


def _marks(case: tuple) -> tuple:
    return () if case in QUICK else (pytest.mark.slow,)


@pytest.mark.parametrize(
    ("task", "mode", "controller"),
    [pytest.param(*case, marks=_marks(case), id="-".join(case)) for case in CASES],
)
def test_hundred_times_shorter_steps_change_no_episode_of_a_task_by_one_percent(task, mode, controller):
    error, sure = loops.loop_error(task, mode, controller, _shipped(task), PERIOD, FINEST)
    assert error <= MOST or not sure, error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "mode", "controller"),
    [pytest.param(*case, marks=_known(case), id="-".join(case)) for case in CASES],
)
def test_nor_those_of_random_rigs(task, mode, controller):
    late, found = [], 0
    for rig in loops.rigs(task, Box("usual"), 10, seed=11):
        try:
            error, sure = loops.loop_error(task, mode, controller, rig, PERIOD, FINER)
        except ConfigurationError:
            continue
        found += 1
        if sure and error > MOST:
            late.append(error)
    assert found and not late, (late, found)
