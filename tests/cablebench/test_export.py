"""Export: what is written reads back to the bit, repeats in the environment, and bad input is told what is wrong."""

import json
import os

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.description import parameters_of
from cable_envs.diagnosis.data.recording import load_recording
from cable_envs.diagnosis.systems import prepare
from cable_envs.plants import families, family
from cable_envs.sim.rigs import load_rig
from cablebench.cli import main
from cablebench.entrants.entrant import controller_entrant
from cablebench.export.recording import check_split, write_recording
from cablebench.export.trace import measured, random_entrant, record

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
SHORT = {"duration": 0.3, "sensor_noise": True}


@pytest.fixture
def make():
    """`gymnasium.make`, closed at the end."""
    made = []

    def _make(env_id, **options):
        made.append(gym.make(env_id, **{**SHORT, **options}))
        return made[-1]

    yield _make
    for env in made:
        env.close()


def run(capsys, *arguments):
    """(exit code, standard output, standard error) of a command."""
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    out = capsys.readouterr()
    return end.value.code or 0, out.out, out.err


def same(a, b):
    return a.dtype == b.dtype and np.array_equal(a, b)


# --- episodes


def test_a_trace_holds_the_episode_as_exchanged(make):
    env = make(HOLE)
    first, second = record(env, controller_entrant("pid"), (4, 5))
    assert (first.seed, second.seed) == (4, 5) and not np.array_equal(first.observations, second.observations)
    again = make(HOLE)
    observation, info = again.reset(seed=4)
    assert same(first.observations[0], observation) and first.infos["time"][0] == 0.0
    for k, action in enumerate(first.actions):
        observation, reward, terminated, truncated, info = again.step(action)
        assert same(first.observations[k + 1], observation) and first.episode.reward[k] == reward
        assert first.infos["output"][k + 1] == info["output"] == first.episode.output[k]
        assert (first.terminations[k], first.truncations[k]) == (terminated, truncated)
    assert truncated and first.actions.dtype == np.float32 and first.actions.shape == (30, 1)


def test_the_random_policy_repeats_by_seed(make):
    a, b, c = record(make(CIRCUIT), random_entrant(), (1, 2, 1))
    assert same(a.actions, c.actions) and not np.array_equal(a.actions, b.actions)
    assert np.abs(a.actions).max() <= 1.0 and a.actions.std() > 0.4  # uniform on [-1, 1]: 0.577


def test_sensors_show_what_the_controller_saw(make):
    """Delay and noise included: the channels of the level that ran are among those of the full level, to the bit."""
    env = make(HOLE, sensor_delay=2)
    (trace,) = record(env, controller_entrant("pid"), (0,))
    sensors = measured(make(HOLE, sensor_delay=2, observe="full"), trace)
    for k, channel in enumerate(env.unwrapped.channels):
        assert same(sensors[channel.name], trace.observations[:, k].astype(float) * channel.scale), channel.name
    noise = sensors["load_tension"][2:] - trace.infos["load_tension"][:-2]  # two steps late
    assert 0.05 < noise.std() < 0.2  # the task's 0.1 N from 29 values


def test_an_episode_that_does_not_repeat_is_refused(make):
    (trace,) = record(make(HOLE), controller_entrant("pid"), (0,))
    with pytest.raises(RuntimeError, match="seed 0 did not repeat"):
        measured(make(HOLE, observe="full", rig={"load_mass": 4.9}), trace)


def test_answers_that_are_not_finite_are_no_data(make):
    class Broken(type(random_entrant().make(None))):
        def act(self, observation, t):
            return np.array([np.nan if t > 0.1 else 0.0], dtype=np.float32)

    entrant = random_entrant()
    broken = type(entrant)("broken", "model-free", lambda setup: Broken(), entrant.needs, "")
    with pytest.raises(ConfigurationError, match="'broken' answered with a number that is not finite at"):
        record(make(CIRCUIT), broken, (0,))


# --- Minari


def test_minari_writes_below_a_relative_folder(capsys, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.chdir(tmp_path)
    flags = [f"--option={k}={json.dumps(v)}" for k, v in SHORT.items()]
    command = ("export", "CableHole-Position-Sine", "--format", "minari", "--out", "datasets", "--controller", "pid")
    code, _, _ = run(capsys, *command, "--episodes", 1, *flags)
    monkeypatch.setenv("MINARI_DATASETS_PATH", "datasets")
    assert code == 0 and len(minari.load_dataset("cable/CableHole-Position-Sine/pid-v0")) == 1


@pytest.mark.parametrize(
    ("env", "who", "options"),
    [
        ("CableHole-Position-Sine", ("--controller", "pid"), {"randomize": True}),
        ("PulleyCircuit-Torque-Step", ("--random",), {"rig": {"shaft_friction": 0.2}}),
    ],
)
def test_minari_reads_back_to_the_bit(capsys, tmp_path, make, env, who, options):
    minari = pytest.importorskip("minari")
    flags = [f"--option={k}={json.dumps(v)}" for k, v in {**SHORT, **options}.items()]
    command = ("export", env, "--format", "minari", "--out", tmp_path, "--dataset-id", "cable/test-v1", *who, *flags)
    before = os.environ.get("MINARI_DATASETS_PATH")
    code, out, err = run(capsys, *command, "--episodes", 2, "--seed", 7, "--author", "A. Nonymous", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["path"] == str(tmp_path / "cable" / "test-v1")
    assert os.environ.get("MINARI_DATASETS_PATH") == before

    from cablebench.export.minari import load

    dataset = load(tmp_path, "cable/test-v1")
    assert (len(dataset), dataset.total_steps, dataset.id) == (2, 60, "cable/test-v1")
    entrant = random_entrant() if who == ("--random",) else controller_entrant("pid")
    needs = {} if who == ("--random",) else {"observe": "output"}
    traces = record(make(f"cable_envs/{env}-v0", **options, **needs), entrant, (7, 8))
    recovered = dataset.recover_environment()
    assert recovered.observation_space == dataset.observation_space
    metadata = list(dataset.storage.get_episode_metadata([0, 1]))
    for trace, stored, about in zip(traces, dataset, metadata, strict=True):
        assert same(stored.observations, trace.observations) and same(stored.actions, trace.actions)
        assert same(stored.rewards, trace.episode.reward)
        assert same(stored.terminations, trace.terminations) and same(stored.truncations, trace.truncations)
        assert set(stored.infos) == set(trace.infos)
        assert all(same(stored.infos[name], values) for name, values in trace.infos.items())
        assert json.loads(about["rig"]) == trace.rig and about["seed"] == trace.seed
        # the recovered environment gives the episode again
        observation, _ = recovered.reset(seed=about["seed"])
        rows = [observation, *(recovered.step(action)[0] for action in stored.actions)]
        assert same(np.array(rows), stored.observations)
        assert recovered.unwrapped.true_rig == trace.rig
    recovered.close()
    about = dataset.storage.metadata
    channels = recovered.unwrapped.channels
    assert about["channels"] == [{"name": c.name, "unit": c.unit, "scale": c.scale} for c in channels]
    assert about["author"] == {"A. Nonymous"} and about["algorithm_name"] == entrant.title
    assert about["minari_version"] == minari.__version__
    # a second export under the same id changes nothing
    code, _, err = run(capsys, *command)
    assert code == 2 and "exists: choose another folder" in err and err.count("\n") == 1


def test_minari_failure_leaves_nothing(tmp_path, make, monkeypatch):
    pytest.importorskip("minari")
    from cablebench.export import minari as export

    env = make(HOLE)
    traces = record(env, controller_entrant("pid"), (0,))
    monkeypatch.setattr(export, "_about", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export.write_dataset(traces, env, controller_entrant("pid"), tmp_path, "cable/test-v0")
    assert not (tmp_path / "cable" / "test-v0").exists()


# --- recordings

CASES = {
    "hole, tension": (HOLE, {}, "position_reference", "drive_tension_command"),
    "hole, speed": (HOLE, {"action_mode": "speed"}, "position_reference", "drive_velocity_command"),
    "hole, anchored": ("cable_envs/CableHole-Tension-Sine-v0", {}, "tension_reference", "drive_tension_command"),
    "three holes": (HOLE.replace("v0", "v1"), {"rig": "gu-three-holes"}, "position_reference", "drive_tension_command"),
    "circuit": (CIRCUIT, {}, "angle_reference", "drive_angle_command"),
    "chain": (CIRCUIT, {"plant": "chain"}, "angle_reference", "drive_angle_command"),
    "circuit, torque": (
        "cable_envs/PulleyCircuit-Torque-Sine-v0", {"rig": {"pretension_top": 45.0}}, "torque_reference",
        "drive_torque_command",
    ),
}  # fmt: skip


@pytest.mark.parametrize("table", ["csv", "parquet"])
@pytest.mark.parametrize("name", CASES)
def test_a_recording_reads_back_to_the_bit_and_replays(tmp_path, make, name, table):
    if table == "parquet":
        pytest.importorskip("pyarrow")
    env_id, options, reference, command = CASES[name]
    env, full = make(env_id, **options), make(env_id, observe="full", **options)
    setup = env.unwrapped.setup
    traces = record(env, random_entrant(), (3, 4, 5))
    write_recording(traces, full, random_entrant(), tmp_path, table=table, heldout=1)
    recording = load_recording(tmp_path)

    assert [r.use for r in recording.records] == ["fit", "fit", "heldout"]
    assert recording.system == setup.rig.plant and dict(recording.rig.values) == dict(setup.rig.values)
    assert recording.rig.holes == setup.rig.holes
    told = family(recording.system)
    for quantities, names in ((recording.known, told.known), (recording.nominal, told.nominal)):
        assert set(quantities) == set(names)
        for key, quantity in quantities.items():
            if key != "hole_radius":
                assert quantity.value == setup.rig.values[key]
    rows = [s.name for s in setup.plant.signals]
    for trace, stored in zip(traces, recording.records, strict=True):
        sensors = measured(full, trace)
        assert same(stored.data["time"], trace.infos["time"]) and same(stored.data[reference], trace.infos["reference"])
        for channel in set(stored.data) - {"time", "wrap_angle", reference, command}:
            signal = channel.replace("tension_top", "tension_drive_top").replace(
                "tension_bottom", "tension_drive_bottom"
            )
            assert same(stored.data[channel], sensors[signal]), channel
            assert recording.channels[channel].noise_std == (setup.noise[rows.index(signal)] or None)
        # the recorded commands, taken as actions on the recording's rig, give the episode again
        again = make(env_id, **{**options, "rig": recording.rig})
        again.reset(seed=trace.seed)
        for k, u in enumerate(stored.data[command][:-1]):
            action = 2.0 * (u - setup.low) / (setup.high - setup.low) - 1.0
            info = again.step(np.array([action], dtype=np.float32))[4]
            assert info["output"] == trace.infos["output"][k + 1]


def test_recording_without_noise_claims_none(tmp_path, make):
    env, full = make(CIRCUIT, sensor_noise=False), make(CIRCUIT, sensor_noise=False, observe="full")
    write_recording(record(env, random_entrant(), (0,)), full, random_entrant(), tmp_path)
    recording = load_recording(tmp_path)
    assert all(channel.noise_std is None for channel in recording.channels.values())
    assert {"tension_top", "tension_bottom", "drive_torque", "output_torque"} <= set(recording.channels)


def test_an_unchanged_preset_is_named_a_changed_one_travels_along(tmp_path, make):
    for folder, changes in (("a", {}), ("b", {"rig": {"load_mass": 4.0}})):
        env, full = make(HOLE, **changes), make(HOLE, observe="full", **changes)
        write_recording(record(env, random_entrant(), (0,)), full, random_entrant(), tmp_path / folder)
    assert load_recording(tmp_path / "a").rig.name == "gu-inferred" and not (tmp_path / "a" / "rig").exists()
    changed = load_recording(tmp_path / "b")
    assert (changed.rig.values["load_mass"], changed.known["load_mass"].value) == (4.0, 4.0)
    assert "5 kg" not in changed.rig.sources.get("load_mass", "") and changed.rig.sources["inner_kp"].startswith(
        "Table 3"
    )


def test_names_of_channels_and_parameters_are_the_formats():
    recorded = [one for one in families().values() if one.commands]
    assert len(recorded) >= 2
    for one in recorded:
        used = {*one.commands.values(), *(output.reference for output in one.outputs.values()), *one.signals}
        assert used <= set(one.channels)
        assert {*one.known, *one.nominal} <= set(parameters_of(one.name).names)
        assert not set(one.known) & set(one.nominal)


@pytest.mark.parametrize(
    ("episodes", "asked", "held"), [(1, None, 0), (2, None, 1), (10, None, 2), (10, 0, 0), (4, 3, 3)]
)
def test_split(episodes, asked, held):
    assert check_split(episodes, asked) == held


def test_export_command_writes_a_recording_that_identify_reads(capsys, tmp_path):
    from cable_envs.identification.model import FORMS, ratios
    from cablebench.cli.physics.identify import record_samples

    out = tmp_path / "rig"
    ramp = "reference={kind: triangle, amplitude: 0.05, frequency: 0.05}"
    code, text, err = run(
        capsys, "export", H, "--controller", "pid", "--format", "recording", "--out", out, "--episodes", 3,
        "-o", "sensor_noise=true", "-o", "duration=8", "-o", ramp,
    )  # fmt: skip
    assert (code, err) == (0, "") and f"wrote {out / 'recording.yaml'}" in text
    recording = load_recording(out)
    assert [r.use for r in recording.records] == ["fit", "fit", "heldout"]
    assert len((out / "episode_0.csv").read_text().splitlines()) == 802  # header, reset, 800 steps
    samples = record_samples(recording, recording.records[0])
    rig = recording.rig.values
    names = ("extrusion_delta", "friction_coefficient", "extrusion_gain", "extrusion_exponent", "radius_ratio")
    true = ratios(FORMS["exact"], np.array([[rig[name]] for name in names]), samples.wrap, samples.speed)[0]
    assert len(samples) > 5
    # 20 samples of a block, 0.1 N on 50 N at both ends: 0.07 %; accelerating the load through a block adds to that
    np.testing.assert_allclose(samples.ratio, true, rtol=0.004)


def test_equal_episodes_are_remarked(capsys, tmp_path):
    command = (
        "export",
        "PulleyCircuit-Position-Step",
        "--controller",
        "pid",
        "--format",
        "recording",
        "-o",
        "duration=0.3",
    )
    code, _, err = run(capsys, *command, "--episodes", 2, "--out", tmp_path / "a")
    assert code == 0 and err.startswith("All episodes are the same")
    code, _, err = run(capsys, *command, "--episodes", 2, "--out", tmp_path / "b", "-o", "sensor_noise=true")
    assert (code, err) == (0, "")


H = "CableHole-Position-Sine"
BAD = {
    "format": (("--format", "minary", "--random"), "unknown format 'minary'; did you mean 'minari'?"),
    "nobody": (("--format", "recording"), "name --controller, --policy or --random"),
    "two": (("--format", "recording", "--random", "--controller", "pid"), "--random takes the place of"),
    "controller": (("--format", "recording", "--controller", "pdi"), "did you mean 'pid'?"),
    "level": (("--format", "recording", "--controller", "pid", "-o", "observe=drive"), "needs observe=output"),
    "other's flag": (("--format", "recording", "--random", "--author", "me"), "--author belongs to --format minari"),
    "other's split": (("--format", "minari", "--random", "--heldout", "1"), "--heldout belongs to --format recording"),
    "other's table": (("--format", "minari", "--random", "--table", "parquet"), "--table belongs to"),
    "table": (("--format", "recording", "--random", "--table", "xls"), "--table: unknown format 'xls'"),
    "rigs": (("--format", "recording", "--random", "-o", "randomize=true"), "a recording describes one rig"),
    "split": (("--format", "recording", "--random", "--episodes", "2", "--heldout", "2"), "2 of 2 episodes held out"),
    "id": (("--format", "minari", "--random", "--dataset-id", "pid"), "dataset id 'pid': expected NAMESPACE/NAME-vN"),
    "option": (("--format", "minari", "--random", "-o", "obsrve=full"), "did you mean 'observe'?"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_writes_nothing(capsys, tmp_path, name):
    arguments, expected = BAD[name]
    out = tmp_path / "out"
    code, text, err = run(capsys, "export", H, "--out", out, *arguments)
    assert (code, text) == (2, "") and err.startswith("cablebench: error: ") and err.count("\n") == 1
    assert expected in err and not out.exists()


def test_a_recording_is_never_overwritten(capsys, tmp_path):
    command = (
        "export",
        H,
        "--random",
        "--format",
        "recording",
        "--out",
        tmp_path,
        "--episodes",
        1,
        "-o",
        "duration=0.1",
    )
    assert run(capsys, *command)[0] == 0
    code, _, err = run(capsys, *command)
    assert code == 2 and "holds recording.yaml: choose another folder" in err


def test_a_folder_that_cannot_be_written_is_an_error(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    for form in ("recording", "minari"):
        arguments = ("--format", form, "--out", tmp_path / "file" / "x", "--episodes", 1, "-o", "duration=0.1")
        code, _, err = run(capsys, "export", H, "--random", *arguments)
        assert code == 2 and err.startswith("cablebench: error: cannot write to") and err.count("\n") == 1


@pytest.mark.parametrize("form", ["analytic", "chain"])
def test_a_circuits_recording_says_which_of_its_simulators_made_it(tmp_path, make, form):
    env, full = make(CIRCUIT, plant=form), make(CIRCUIT, plant=form, observe="full")
    write_recording(record(env, random_entrant(), (0,)), full, random_entrant(), tmp_path)
    rig = load_recording(tmp_path).rig
    assert rig.variant == form and rig.simulated_by().name == env.unwrapped.setup.plant.name
    assert make(CIRCUIT, rig=rig.content()).unwrapped.setup.plant.name == rig.simulated_by().name
    assert prepare(load_recording(tmp_path)).fit.plant.name == rig.simulated_by().name


def test_a_changed_rig_with_a_motor_travels_along_with_it(tmp_path, make):
    changes = {"rig": load_rig("zou-table2-motor").replace({"pretension_top": 45.0})}
    circuit = CIRCUIT.replace("v0", "v1")
    env, full = make(circuit, **changes), make(circuit, observe="full", **changes)
    write_recording(record(env, random_entrant(), (0,)), full, random_entrant(), tmp_path)
    rig = load_recording(tmp_path).rig
    assert rig.drive == "motor" and dict(rig.values) == dict(changes["rig"].values)
