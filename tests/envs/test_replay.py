"""Batched replay: the same as stepping each mechanism by itself; paths followed exactly; sensors; bad input."""

import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.inputs import INPUTS
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay
from cable_envs.sim.together import Asked, replay_together
from tests.support.inputs import COMMAND, COMMAND_RATE, MODE

CIRCUIT, CHAIN = plant_for("pulley_circuit"), plant_for("pulley_circuit", "chain")
HOLE, DRIVE = plant_for("cable_hole"), plant_for("linear_drive")
T = (np.arange(40) + 1) * 0.01


def _columns(plant, *changes):
    return np.array([plant.table.pack(change) for change in changes]).T


def test_equals_stepping_each_column_alone():
    """70 columns with other effects each, in blocks, against single columns stepped by `advance`; to the bit."""
    gaps = np.linspace(0.0, 0.05, 70)
    drifts = {"friction_drift.change": 0.5, "friction_drift.time": 0.3}  # which changes coefficients within a step
    values = _columns(CIRCUIT, *({"backlash.gap": g, "output_damping": 1e-3 * (1 + g), **drifts} for g in gaps))
    command = 0.4 * np.sin(8 * T)
    out = replay(CIRCUIT, values, command, 0.01, drive="position", hold="step", signals=["output_angle"], substeps=4)
    assert out.shape == (40, 1, 70)
    both = replay(
        CIRCUIT, values, command, 0.01, drive="position", hold="step", signals=["output_angle"], substeps=4, threads=2
    )  # fmt: skip
    assert np.array_equal(out, both)
    for k in (0, 33, 69):
        p = CIRCUIT.prepare(values[:, k : k + 1])
        CIRCUIT.raise_to(p, 0.0025)  # as replays in coarse steps do
        x, u = CIRCUIT.rest(p, np.zeros(1)), np.zeros((len(INPUTS), 1))
        for t, (now, before) in enumerate(zip(command, [command[0], *command], strict=False)):
            u[COMMAND], u[COMMAND_RATE], u[MODE] = now, (now - before) / 0.01, 0.0
            CIRCUIT.advance(x, p, u, 0, 1, 4, 0.0025)
            assert x[CIRCUIT.row("output_angle"), 0] == out[t, 0, k]


def test_an_effect_of_one_column_is_left_out_of_no_other_block_and_changes_no_neighbour():
    """What no column of a block has is left out for all of them: alone and among others it is the same, to the bit."""
    changes = (
        {}, {"viscoelastic_creep.share": 0.5}, {"slow_creep.share": 0.5}, {"stiffness_hardening.coefficient": 0.02},
        {"backlash.gap": 0.02}, {"position_ripple.amplitude": 0.01}, {"output_damping": 1e-3},
    )  # fmt: skip
    given = {"drive": "follow", "signals": ["output_angle", "drive_torque"]}
    path = 0.5 * np.sin(6 * T)
    together = replay(CHAIN, _columns(CHAIN, *changes), path, 0.01, **given)
    for k, change in enumerate(changes):
        assert np.array_equal(replay(CHAIN, _columns(CHAIN, change), path, 0.01, **given)[:, :, 0], together[:, :, k])
        assert k == 0 or not np.array_equal(together[:, :, k], together[:, :, 0])


@pytest.mark.parametrize(
    ("plant", "signal", "path"),
    [(HOLE, "drive_position", 0.01 * np.sin(3 * T)), (CIRCUIT, "drive_angle", 0.5 * np.sin(6 * T)),
     (CHAIN, "drive_angle", 0.5 * np.sin(6 * T)), (DRIVE, "motor_position", 0.1 * np.sin(6 * T))],
    ids=["hole", "circuit", "chain", "drive"],
)  # fmt: skip
def test_a_recorded_path_is_followed_exactly(plant, signal, path):
    out = replay(plant, _columns(plant, {}), path, 0.01, drive="follow", signals=[signal])
    assert np.array_equal(out[:, 0, 0], path)


def test_the_force_for_a_path_is_that_of_the_mechanics():
    w = 2 * np.pi
    path = 0.05 * np.sin(w * T)
    values = _columns(DRIVE, {"coulomb": 3.0, "viscous": 20.0})
    out = replay(DRIVE, values, path, 0.01, drive="follow", rate=0.05 * w * np.cos(w * T), signals=["force"])
    expected = -11.0 * w * w * path + 20.0 * 0.05 * w * np.cos(w * T) + 3.0 * np.sign(np.cos(w * T))
    # a cubic's acceleration at its end is off by its fourth derivative, w^4 h^2 / 12 of the amplitude: 0.7 N here
    assert out[2:24, 0, 0] == pytest.approx(expected[2:24], abs=0.8)


def test_imposed_tension_is_the_tension():
    pull = 55.0 + 20.0 * np.sin(20 * T)
    out = replay(HOLE, _columns(HOLE, {}), pull, 0.01, drive="imposed", hold="step", signals=["drive_tension"])
    assert out[:, 0, 0] == pytest.approx(pull, abs=1e-12)


def test_a_record_can_be_taken_up_in_pieces():
    """Multiple shooting: the state after the first half, handed on, gives the second half."""
    path = 0.4 * np.sin(8 * T)
    values = _columns(CIRCUIT, {"backlash.gap": 0.02}, {})
    arguments = {"drive": "torque", "hold": "step", "signals": ["output_angle"], "sensors": False}
    whole = replay(CIRCUIT, values, 0.1 * path, 0.01, **arguments)
    state = CIRCUIT.rest(CIRCUIT.prepare(values), np.zeros(2))
    first = replay(CIRCUIT, values, 0.1 * path[:20], 0.01, state=state, **arguments)
    second = replay(
        CIRCUIT, values, 0.1 * path[20:], 0.01, state=state, rate=np.diff(0.1 * path[19:]) / 0.01, **arguments
    )
    assert np.array_equal(np.concatenate([first, second])[:20], whole[:20])
    assert second == pytest.approx(whole[20:], abs=1e-9)


def test_sensor_effects_are_those_of_the_columns():
    path = 0.1 * np.sin(6 * T)
    bent = {"sensor_delay.position": 0.025, "sensor_bias.position": 0.01, "sensor_scale.position": 2.0}
    out = replay(DRIVE, _columns(DRIVE, {}, bent), path, 0.01, drive="follow", signals=["position", "velocity"])
    times = np.concatenate([[0.0], T])
    expected = np.interp(T - 0.025, times, 2.0 * np.concatenate([[0.0], path]) + 0.01)
    assert out[:, 0, 0] == pytest.approx(path, abs=1e-12) and out[:, 0, 1] == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(out[:, 1, 0], out[:, 1, 1])


MISTAKES = [
    ({"drive": "folow"}, "did you mean 'follow'"), ({"signals": ["positon"]}, "did you mean 'position'"),
    ({"hold": "linear"}, "unknown hold"), ({"command": np.ones((40, 3))}, r"expected \[T\] or \[T, 1\]"),
    ({"command": np.r_[np.ones(7), np.nan]}, "step 7 is not finite"), ({"period": 0.0}, "seconds above 0"),
    ({"disturbance": np.ones(3)}, "disturbance has 3 steps, command has 40"),
    ({"values": np.ones(3)}, "values: expected"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), MISTAKES, ids=[m for _, m in MISTAKES])
def test_mistakes_are_named(change, message):
    given = {
        "values": _columns(DRIVE, {}), "command": 0.1 * T, "period": 0.01, "drive": "follow", "signals": ["position"],
        **change,
    }  # fmt: skip
    with pytest.raises(ConfigurationError, match=message):
        replay(DRIVE, **given)


def test_records_that_go_together_are_as_each_by_itself():
    """Three records of other lengths, with one to 30 columns each, in one call and one by one; to the bit."""
    lags = np.linspace(0.0, 0.02, 30)
    values = _columns(CHAIN, *({"backlash.gap": lag, "output_damping": 1e-3 * (1 + lag)} for lag in lags))
    paths = [0.5 * np.sin(6 * 0.01 * np.arange(steps)) for steps in (40, 25, 31)]
    for counts in ((1, 1, 1), (3, 2, 5), (30, 9, 1)):
        asked = [Asked(values[:, :n], path, start=path[0]) for n, path in zip(counts, paths, strict=True)]
        given = {"drive": "follow", "signals": ["output_angle", "drive_torque"], "substeps": 4}
        together = replay_together(CHAIN, asked, 0.01, **given)
        for one, out in zip(asked, together, strict=True):
            alone = replay(CHAIN, one.values, one.command, 0.01, start=one.start, **given)
            assert np.array_equal(alone, out)


def test_records_go_on_together_from_states_that_stay_as_they_are():
    """Commands of each column's own, a force on the load, and states to go on from; to the bit."""
    values = _columns(DRIVE, *({"viscous": 10.0 + k} for k in range(5)))
    state = DRIVE.rest(DRIVE.prepare(values), np.zeros(5))
    state[DRIVE.row("velocity")] = 0.1
    before = state.copy()
    asked = [
        Asked(values, np.outer(np.sin(9 * T[:steps]), np.arange(5)), disturbance=T[:steps], state=state)
        for steps in (40, 22)
    ]
    given = {"drive": "force", "hold": "step", "signals": ["position"]}
    for one, out in zip(asked, replay_together(DRIVE, asked, 0.01, **given), strict=True):
        assert np.array_equal(state, before)
        alone = replay(
            DRIVE, values, one.command, 0.01, disturbance=one.disturbance, state=state.copy(), sensors=False, **given
        )
        assert np.array_equal(alone, out)
