"""The native batch: lanes equal single environments to the bit; Gymnasium's semantics of the autoreset modes."""

import os
import signal
import threading
import time

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from cable_envs.core.errors import ConfigurationError
from cable_envs.vector import CableVectorEnv
from tests.envs.test_envs import CASES, CIRCUIT, HOLE

LANES = 5  # not a multiple of any vector width


def native(env_id, n=LANES, mode=AutoresetMode.NEXT_STEP, **options):
    options = {"duration": 0.15, "threads": 1, **options}
    return gym.make_vec(env_id, num_envs=n, vectorization_mode="vector_entry_point", autoreset_mode=mode, **options)


def actions_of(steps, n=LANES, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, n, 1)).astype(np.float32)


@pytest.mark.parametrize(("env_id", "options"), CASES)
def test_lane_equals_single_environment_bit_for_bit(env_id, options):
    batch = native(env_id, mode=AutoresetMode.DISABLED, **options)
    singles = [gym.make(env_id, duration=0.15, **options) for _ in range(LANES)]
    actions = iter(actions_of(45))
    for episode in range(3):  # later episodes draw from generators that have moved on
        seed = 3 if episode == 0 else None
        observations, infos = batch.reset(seed=seed)
        for lane, env in enumerate(singles):
            o, info = env.reset(seed=None if seed is None else seed + lane)
            assert np.array_equal(o, observations[lane]) and info == {k: infos[k][lane] for k in info}
        for _ in range(15):
            action = next(actions)
            observations, rewards, terminated, truncated, infos = batch.step(action)
            for lane, env in enumerate(singles):
                o, r, t, l, info = env.step(action[lane])
                assert np.array_equal(o, observations[lane])
                assert (r, t, l) == (rewards[lane], terminated[lane], truncated[lane])
                assert info == {k: infos[k][lane] for k in info}
        assert truncated.all()


@pytest.mark.parametrize("env_id", [HOLE, CIRCUIT])
@pytest.mark.parametrize("n", [1, 33, 300])
def test_batch_size_and_threads_change_no_bit(env_id, n):
    actions = actions_of(4, n)
    serial, threads = native(env_id, n, sensor_noise=True), native(env_id, n, sensor_noise=True, threads=3)
    alone = native(env_id, 1, sensor_noise=True)
    serial.reset(seed=9), threads.reset(seed=9), alone.reset(seed=9 + n - 1)
    for action in actions:
        a, b, c = serial.step(action), threads.step(action), alone.step(action[-1:])
        assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
        assert np.array_equal(a[0][-1], c[0][0]) and a[1][-1] == c[1][0]


def same(a, b):
    """Infos equal: the same keys, masks, and values where the mask is true."""
    assert set(a) == set(b)
    for key, value in a.items():
        if isinstance(value, dict):
            same(value, b[key])
        elif key.startswith("_"):
            assert np.array_equal(value, b[key]), key
        elif key == "final_obs":
            for lane in np.flatnonzero(a["_final_obs"]):
                assert np.array_equal(value[lane], b[key][lane])
        else:
            mask = a[f"_{key}"]
            assert np.array_equal(np.asarray(value)[mask], np.asarray(b[key])[mask]), key


@pytest.mark.parametrize("env_id", [HOLE, CIRCUIT])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_autoreset_equals_gymnasiums_sync_vector_env(env_id, mode):
    """Lanes end at different times: half of the rigs tears (hole) or has random noise; every step must agree."""
    weak = {"tension_limit": 50.0, "breaking_tension": 60.0, "tension_command_limit": 100.0}
    options = {"sensor_noise": True, "sensor_delay": 1, "action_delay": 1, "randomize": True, "duration": 0.12}
    options |= {"rig": weak} if env_id == HOLE else {}
    batch = native(env_id, mode=mode, **options)
    sync = SyncVectorEnv([lambda: gym.make(env_id, **options)] * LANES, autoreset_mode=mode)
    left, right = batch.reset(seed=21), sync.reset(seed=21)
    assert np.array_equal(left[0], right[0])
    same(right[1], left[1])
    ends = set()
    for step, action in enumerate(actions_of(60)):
        left, right = batch.step(action), sync.step(action)
        for a, b in zip(left[:4], right[:4], strict=True):
            assert np.array_equal(a, b) and a.dtype == b.dtype, step
        same(right[4], left[4])
        ends |= {(step, lane) for lane in np.flatnonzero(left[2] | left[3])}
    assert len(ends) > LANES
    if env_id == HOLE:
        assert len({step for step, _ in ends}) > 5  # torn cables end episodes at all sorts of times


def test_disabled_mode_waits_for_reset_mask():
    weak = {"tension_limit": 55.0, "breaking_tension": 60.0}
    batch = native(HOLE, mode=AutoresetMode.DISABLED, duration=0.1, rig=weak)
    batch.reset(seed=0)
    actions = np.full((LANES, 1), 49.05 / 60.0 - 1.0, np.float32)
    actions[1::2] = 1.0  # these tear
    finished = np.zeros(LANES, bool)
    while not finished.any():
        observations, _, terminated, _, infos = batch.step(actions)
        finished = terminated.copy()
    assert finished.tolist() == [False, True, False, True, False]
    with pytest.raises(gym.error.ResetNeeded, match=r"environments \[1, 3\]"):
        batch.step(actions)
    time = infos["time"].copy()
    again, infos = batch.reset(options={"reset_mask": finished})
    assert np.array_equal(again[~finished], observations[~finished])
    assert np.array_equal(infos["_time"], finished) and np.all(infos["time"][finished] == 0.0)
    *_, infos = batch.step(actions)
    assert np.array_equal(infos["time"] > 0.015, ~finished) and np.all(infos["time"][~finished] > time[~finished])


def test_reset_mask_with_seeds_reseeds_only_its_lanes():
    batch = native(HOLE, sensor_noise=True)
    first, _ = batch.reset(seed=[1, 2, 3, 4, 5])
    mask = np.array([False, True, False, False, True])
    again, _ = batch.reset(seed=[7, 2, 7, 7, 5], options={"reset_mask": mask})
    assert np.array_equal(first, again) and batch.unwrapped.np_random_seed == (1, 2, 3, 4, 5)


def test_same_step_mode_begins_an_ended_episode_once():
    """Neither a restored state nor a masked reset of other lanes begins it again, which would draw another one."""
    options = {"sensor_noise": True, "randomize": True, "duration": 0.1}
    batch, other = (native(HOLE, mode=AutoresetMode.SAME_STEP, **options) for _ in range(2))
    batch.reset(seed=3)
    actions = np.full((LANES, 1), 49.05 / 60.0 - 1.0, np.float32)
    early = np.arange(LANES) == 1
    for step in range(9):
        batch.step(actions)
        if step == 4:
            batch.reset(options={"reset_mask": early})
    *_, truncated, _ = batch.step(actions)
    assert np.array_equal(truncated, ~early)
    other.restore(batch.state())
    one, two = batch.step(actions), other.step(actions)
    assert np.array_equal(one[0], two[0]) and np.all(one[4]["time"][~early] == two[4]["time"][~early])
    assert np.all(np.abs(two[4]["time"][~early] - 0.01) < 1e-9)
    for _ in range(3):
        batch.step(actions)
    *_, truncated, _ = batch.step(actions)
    assert np.array_equal(truncated, early)
    batch.reset(options={"reset_mask": np.arange(LANES) == 2})  # the kernel has lane 1 at the start of an episode
    *_, infos = batch.step(actions)
    assert abs(infos["time"][1] - 0.01) < 1e-9


@pytest.mark.parametrize("mask", [[True] * LANES, np.ones(LANES), np.zeros(LANES, bool), np.ones(LANES + 1, bool)])
def test_bad_reset_masks_are_refused(mask):
    batch = native(HOLE)
    batch.reset(seed=0)
    with pytest.raises(ValueError, match="reset_mask"):
        batch.reset(options={"reset_mask": mask})


def test_results_are_the_callers_own():
    batch = native(HOLE, duration=1.0)
    observations, infos = batch.reset(seed=0)
    kept, info = observations.copy(), {k: v.copy() for k, v in infos.items()}
    later = batch.step(np.ones((LANES, 1), np.float32))
    batch.step(np.ones((LANES, 1), np.float32))
    assert np.array_equal(kept, observations) and all(np.array_equal(info[k], infos[k]) for k in info)
    assert np.all(later[4]["time"] == 0.01)


def test_infos_on_demand_are_those_of_the_step():
    every, few = (native(HOLE, mode=AutoresetMode.SAME_STEP, duration=0.05, step_infos=s) for s in (True, False))
    every.reset(seed=0), few.reset(seed=0)
    for action in actions_of(7):
        *a, infos = every.step(action)
        *b, rest = few.step(action)
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        assert set(rest) == ({"final_obs", "_final_obs", "final_info", "_final_info"} if b[3].any() else set())
        same({k: v for k, v in infos.items() if "final" not in k}, few.unwrapped.infos())


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_spaces_and_metadata(mode):
    batch = native(CIRCUIT, mode=mode)
    assert batch.metadata["autoreset_mode"] == mode and batch.num_envs == LANES
    assert batch.observation_space.shape == (LANES, *batch.single_observation_space.shape)
    observations, _ = batch.reset(seed=0)
    assert observations in batch.observation_space
    assert batch.action_space.sample().shape == (LANES, 1)


def test_gymnasium_wrappers_run_on_the_batch():
    batch = gym.wrappers.vector.RecordEpisodeStatistics(native(HOLE, mode=AutoresetMode.SAME_STEP))
    batch.reset(seed=0)
    total = np.zeros(LANES)
    for action in actions_of(15):
        _, rewards, _, truncated, infos = batch.step(action)
        total += rewards
    assert truncated.all() and infos["episode"]["l"].tolist() == [15] * LANES
    assert infos["episode"]["r"] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(LANES), r"shape \(5, 1\)"),
        (np.zeros((LANES, 2)), r"shape \(5, 1\)"),
        (np.array([[0.0], [np.nan], [0.0], [0.0], [np.inf]]), r"environments \[1, 4\]"),
    ],
)
def test_bad_actions_name_the_environments(actions, message):
    batch = native(HOLE)
    batch.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        batch.step(actions)


def test_step_before_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        native(HOLE).step(np.zeros((LANES, 1)))


@pytest.mark.parametrize("n", [0, -1, 2.5, True])
def test_numbers_of_environments_and_threads_are_checked(n):
    with pytest.raises(ValueError, match="num_envs"):
        CableVectorEnv("CableHole-Position", "Sine", n)
    with pytest.raises(ValueError, match="threads"):
        CableVectorEnv("CableHole-Position", "Sine", 4, threads=n)


def test_closing_ends_the_threads():
    batch = CableVectorEnv("CableHole-Position", "Sine", 100, threads=2)
    batch.reset(seed=0)
    before = threading.active_count()
    batch.step(np.zeros((100, 1)))
    assert threading.active_count() == before + 1
    batch.close()
    assert threading.active_count() == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded")
def test_a_forked_process_starts_its_own_threads():
    batch = CableVectorEnv("CableHole-Position", "Sine", 100, threads=2)
    batch.reset(seed=0)
    batch.step(np.zeros((100, 1)))
    child = os.fork()
    if child == 0:
        batch.step(np.zeros((100, 1)))
        os._exit(0)
    for _ in range(200):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.05)
    else:
        os.kill(child, signal.SIGKILL)
    batch.close()
    assert done == child and status == 0


def test_bad_options_are_refused_as_by_the_single_environment():
    with pytest.raises(ConfigurationError, match="did you mean 'substeps'"):
        native(HOLE, substep=10)
    with pytest.raises(ConfigurationError, match="did you mean 'load_mass'"):
        native(HOLE, rig={"load_mas": 1.0})
    with pytest.raises(ValueError, match="seeds"):
        native(HOLE).reset(seed=[1, 2])
    with pytest.raises(ValueError, match="same_step"):
        native(HOLE, mode="same_step")


def test_a_state_of_another_shape_is_refused():
    small, large = (CableVectorEnv("CableHole-Position", "Sine", n) for n in (2, 40))
    for batch in (small, large):
        batch.reset(seed=0)
    with pytest.raises(ConfigurationError, match="is of 2 environments, and 40 are to be restored"):
        large.restore(small.state())
