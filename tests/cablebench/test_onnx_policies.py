"""Policies as ONNX: they act as their networks do, run no code, get a row on a board, and their row replays."""

import json

import gymnasium as gym
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cablebench.cli import main
from cablebench.cli.shared.policies import policy_entrant
from cablebench.entrants.onnx_policies import Sight, load_onnx
from cablebench.run.evaluation import run_episode
from tests.cablebench.test_submit import TINY

onnx = pytest.importorskip("onnx", reason="policies in ONNX need it: pip install 'cable-envs[onnx]'")
pytest.importorskip("onnxruntime", reason="policies in ONNX need it: pip install 'cable-envs[onnx]'")

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
FLOAT = onnx.TensorProto.FLOAT
WEIGHTS = np.random.default_rng(0).normal(0.0, 0.3, (40, 1)).astype(np.float32)


def network(path, width=10, out=1, nodes=None, weights=None, opset=(("", 17),), kind=FLOAT, batch="n"):
    """tanh(obs W), or what ``nodes`` say."""
    h = onnx.helper
    held = onnx.numpy_helper.from_array(WEIGHTS[:width, :1].repeat(out, 1), "w") if weights is None else weights
    nodes = nodes or [h.make_node("MatMul", ["obs", "w"], ["z"]), h.make_node("Tanh", ["z"], ["action"])]
    graph = h.make_graph(
        nodes, "policy", [h.make_tensor_value_info("obs", kind, [batch, width] if batch else [width])],
        [h.make_tensor_value_info("action", kind, None)], [held],
    )  # fmt: skip
    model = h.make_model(graph, opset_imports=[h.make_opsetid(*o) for o in opset])
    model.ir_version = 9
    path.write_bytes(model.SerializeToString())
    return path


def described(path, **more):
    text = {"schema": "cable-policy-file/1", "name": "net", "policy": path.name, "env": "CableHole-Position-Sine",
            "charged": "{environment_steps: 1000}", **more}  # fmt: skip
    file = path.with_suffix(".yaml")
    file.write_text("".join(f"{key}: {value}\n" for key, value in text.items() if value is not None))
    return file


class Direct:
    """The same arithmetic in NumPy, on the last ``history`` observations."""

    def __init__(self, see=lambda obs: obs, history=1, first=True):
        self.see, self.history, self.first = see, history, first

    def start(self, env):
        self.frames = None

    def act(self, observation, t):
        frame = self.see(observation).astype(np.float32)
        before = frame if self.first else np.zeros_like(frame)
        self.frames = [*(self.frames or [before] * self.history), frame][-self.history :]
        return np.tanh(np.concatenate(self.frames) @ WEIGHTS[: 10 * self.history]).astype(np.float32)


def rewards(actor):
    return run_episode(gym.make(HOLE, duration=0.15, sensor_noise=True), actor, seed=1).reward


@pytest.mark.parametrize(("more", "direct"), [
    ({}, Direct()),
    ({"history": 3}, Direct(history=3)),
    ({"history": 3, "padding": "zero"}, Direct(history=3, first=False)),
    ({"normalization": f"{{mean: {[0.1] * 10}, std: {[0.5] * 10}, clip: 0.8}}"},
     Direct(lambda obs: np.clip((obs - 0.1) / 0.5, -0.8, 0.8))),
])  # fmt: skip
def test_it_acts_as_the_network_does(tmp_path, more, direct):
    file = described(network(tmp_path / "net.onnx", 10 * more.get("history", 1)), **more)
    entrant = policy_entrant(str(file))
    assert (entrant.name, entrant.information, entrant.charged["environment_steps"]) == ("net", "model-free", 1000)
    assert entrant.needs(HOLE, setup_of(HOLE, {})) == {} and entrant.needs(CIRCUIT, setup_of(CIRCUIT, {})) is None
    theirs = rewards(entrant.make(setup_of(HOLE, {})))
    assert np.allclose(theirs, rewards(direct), atol=1e-4)  # additions in another order, fed back 15 times
    assert np.array_equal(theirs, rewards(entrant.make(setup_of(HOLE, {})))) and len(np.unique(theirs)) > 10


def test_a_batch_gets_what_each_would(tmp_path):
    policy = load_onnx(network(tmp_path / "net.onnx", 20), Sight(history=2))
    frames = np.random.default_rng(1).normal(size=(3, 4, 10)).astype(np.float32)
    state, states = None, [None] * 4
    for k, rows in enumerate(frames):
        starts = np.array([k == 2, False, False, False])
        together, state = policy.predict(rows, state, starts)
        for lane in range(4):
            alone, states[lane] = policy.predict(rows[lane], states[lane], starts[lane : lane + 1])
            assert alone == pytest.approx(together[lane], abs=1e-6)


def test_without_an_environment_it_enters_where_the_channels_fit(tmp_path):
    entrant = policy_entrant(str(network(tmp_path / "net.onnx", 10)))
    entered = [e for e in (HOLE, CIRCUIT) if entrant.needs(e, setup_of(e, {})) is not None]
    assert entrant.name == "net" and entered == [e for e in (HOLE, CIRCUIT) if len(setup_of(e, {}).channels) == 10]


def wrong_files(folder):
    h = onnx.helper
    node, outside = h.make_node, onnx.numpy_helper.from_array(WEIGHTS[:10], "w")
    outside.ClearField("raw_data")
    outside.data_location = onnx.TensorProto.EXTERNAL
    outside.external_data.add(key="location", value="../../etc/passwd")
    looped = h.make_graph([node("Identity", ["c"], ["d"])], "body", [], [])
    branch = h.make_graph([node("RandomNormal", [], ["r"], shape=[1, 1])], "b", [],
                          [h.make_tensor_value_info("r", FLOAT, [1, 1])])  # fmt: skip
    cases = {
        "custom": ({"nodes": [node("Run", ["obs", "w"], ["action"], domain="my.library")],
                    "opset": (("", 17), ("my.library", 1))}, "operator 'my.library:Run'; only those of the ONNX"),
        "context": ({"nodes": [node("EPContext", ["obs", "w"], ["action"], domain="com.microsoft")],
                     "opset": (("", 17), ("com.microsoft", 1))}, "'com.microsoft:EPContext'"),
        "outside": ({"weights": outside}, "'w' is kept outside the file"),
        "loop": ({"nodes": [node("Loop", ["", "", "obs"], ["action"], body=looped)]}, "a loop cannot be interrupted"),
        "random": ({"nodes": [node("If", ["obs"], ["action"], then_branch=branch, else_branch=branch)]},
                   "'RandomNormal' is not run: a row must replay"),
        "unknown": ({"nodes": [node("Tahn", ["obs"], ["action"])]}, "onnxruntime cannot load it"),
        "flat": ({"batch": None}, r"expected one input, tensor\(float\) \[n, channels\], found tensor\(float\) \[10\]"),
        "double": ({"kind": onnx.TensorProto.DOUBLE,
                    "weights": onnx.numpy_helper.from_array(WEIGHTS[:10].astype(float), "w")}, "found tensor.double"),
        "two": ({"out": 2}, r"expected actions float32 \[1, 1\] as first output, found float32 \[1, 2\]"),
    }  # fmt: skip
    return {name: (network(folder / f"{name}.onnx", **how), expected) for name, (how, expected) in cases.items()}


def test_what_is_no_policy_is_refused_in_one_line(tmp_path):
    (tmp_path / "text.onnx").write_text("no network at all")
    for path, expected in [*wrong_files(tmp_path).values(), (tmp_path / "text.onnx", "is no ONNX file")]:
        with pytest.raises(ConfigurationError, match=expected) as caught:
            load_onnx(path)
        assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("width", "more", "expected"), [
    (7, {}, "takes observations of 7 channels; cable_envs/CableHole-Position-Sine-v0 has 10"),
    (10, {"history": 3}, "history 3 does not divide the 10 numbers"),
    (10, {"history": 0}, "history = 0; expected a whole number from 1"),
    (10, {"padding": "frist"}, "did you mean 'first'"),
    (10, {"normalization": "{mean: [0.0], std: [1.0]}"}, "normalization of 1 channels; expected 10"),
    (10, {"normalization": "{mean: [0.0], std: [0.0]}"}, "std must be as long as mean, and above 0"),
    (10, {"normalization": "{mean: [0.0]}"}, "normalization.std must be a list of numbers"),
    (10, {"algo": "ppo"}, "'algo' belongs to a .zip of stable-baselines3"),
    (10, {"charged": None}, "charged.environment_steps is missing"),
    (10, {"options": "{observe: drive}"}, "set options.observe"),
])  # fmt: skip
def test_what_does_not_fit_is_named(tmp_path, width, more, expected):
    file = described(network(tmp_path / "net.onnx", width), **more)
    with pytest.raises(ConfigurationError, match=expected) as caught:
        policy_entrant(str(file))
    assert "\n" not in str(caught.value)


def cli(capsys, *words):
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    out = capsys.readouterr()
    return end.value.code or 0, out.out, out.err


def test_it_is_submitted_without_trust_and_its_row_replays(tmp_path, capsys):
    (tmp_path / "tiny.yaml").write_text(TINY)
    place = ("--protocol", tmp_path / "tiny.yaml", "--results", tmp_path / "results")
    file = described(network(tmp_path / "net.onnx"))
    code, _, err = cli(capsys, "submit", file, *place)
    assert code == 0 and "place 1 of 1 (model-free)" in err, err
    code, out, err = cli(capsys, "replay", "--entrant", "net", "--env", "CableHole-Position-Sine", *place, "--json")
    assert code == 0 and json.loads(out)["same"], err
    code, _, err = cli(capsys, "submit", tmp_path / "net.onnx", *place, "--name", "bare", "--check-only")
    assert code == 0 and "bare, model-free" in err, err


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # torch's, of its smaller exporter
def test_a_network_that_torch_exports_is_taken(tmp_path):
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
    net = torch.nn.Sequential(torch.nn.Linear(10, 8), torch.nn.ReLU(), torch.nn.Linear(8, 1), torch.nn.Tanh())
    path = tmp_path / "torch.onnx"
    torch.onnx.export(net, (torch.zeros(1, 10),), str(path), dynamo=False, input_names=["obs"],
                      dynamic_axes={"obs": {0: "n"}})  # fmt: skip
    seen = np.random.default_rng(2).normal(size=10).astype(np.float32)
    action, _ = load_onnx(path).predict(seen)
    assert action == pytest.approx(net(torch.from_numpy(seen)).detach().numpy(), abs=1e-6)
