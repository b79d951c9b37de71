"""Policies of any library as ONNX: ``(observations [n, channels]) -> actions [n, 1]``, float32, run by onnxruntime.

A stranger's file runs no code: onnxruntime executes the operators of the ONNX standard only, and what could lead beyond
them is refused before the file is given to it: operators of other domains (custom libraries, contexts of accelerators),
weights kept outside the file, loops (which nothing could interrupt) and random numbers (a row must replay to the last
digit).
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.core.errors import ConfigurationError

SUFFIX = ".onnx"
LARGEST = 64 * 2**20
"""Bytes of a file."""

DOMAINS = ("", "ai.onnx", "ai.onnx.ml")
"""Whose operators may be used: those of the standard."""

REFUSED = {
    "Loop": "a loop cannot be interrupted", "Scan": "a loop cannot be interrupted",
    **dict.fromkeys(
        ("RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli"),
        "a row must replay to the last digit; export the deterministic action",
    ),
}  # fmt: skip
"""Operators of the standard that are not run, with the reason."""

PADDINGS = ("first", "zero")
"""What stands for the observations before an episode's first one: that one again, or zeros."""


@dataclass(frozen=True)
class Sight:
    """What lies between the environment's observation and the network.

    Attributes
    ----------
    history : int
        Observations that the network sees side by side, the newest last.
    padding : str
        One of `PADDINGS`.
    mean, std : tuple of float
        Of each channel: the network sees ``(obs - mean) / std``. Empty: the observation as it is.
    clip : float, optional
        Largest magnitude of a normalised number.
    """

    history: int = 1
    padding: str = "first"
    mean: tuple[float, ...] = ()
    std: tuple[float, ...] = ()
    clip: float | None = None

    def frame(self, rows: np.ndarray) -> np.ndarray:
        """Observations [n, channels] as the network sees each of them."""
        if not self.mean:
            return rows
        scaled = (rows - np.array(self.mean)) / np.array(self.std)
        if self.clip is not None:
            scaled = np.clip(scaled, -self.clip, self.clip)
        return scaled.astype(np.float32)

    def settings(self) -> dict[str, Any]:
        """What differs from the observation as it is, in JSON types."""
        given = {"mean": list(self.mean), "std": list(self.std), "clip": self.clip} if self.mean else {}
        return {**given, **({"history": self.history, "padding": self.padding} if self.history > 1 else {})}


@dataclass(frozen=True)
class OnnxPolicy:
    """A loaded network with ``predict`` as stable-baselines3's; its memory is the last observations."""

    path: Path
    digest: str
    session: Any
    width: int
    """numbers it takes for each environment"""
    sight: Sight = field(default_factory=Sight)

    @property
    def channels(self) -> int:
        """Channels of the observations it was made for."""
        return self.width // self.sight.history

    def predict(
        self, observation: np.ndarray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """The action for an observation, and what to give to the next call.

        Parameters
        ----------
        observation : ndarray, shape (channels,) or (n, channels)
            As the environment gives it.
        state : ndarray of float32, optional
            As returned by the last call. None: all environments begin an episode.
        episode_start : ndarray of bool, shape (n,), optional
            Where an episode begins.
        deterministic : bool
            There is nothing else.

        Returns
        -------
        action : ndarray of float32, shape (1,) or (n, 1)
            As the network gives it.
        state : ndarray of float32, shape (n, width)
            The last observations as the network saw them.
        """
        rows = np.asarray(observation, np.float32).reshape(-1, np.shape(observation)[-1])
        if rows.shape[1] != self.channels:
            raise ConfigurationError(f"{self.path}: {self._expects()}, found {rows.shape[1]}")
        frame = self.sight.frame(rows)
        starts = np.ones(len(rows), bool) if state is None else np.zeros(len(rows), bool)
        if state is not None and episode_start is not None:
            starts |= np.asarray(episode_start, bool)
        seen = np.zeros((len(rows), self.width), np.float32) if state is None else np.roll(state, -self.channels, 1)
        seen[starts] = np.tile(frame[starts], self.sight.history) if self.sight.padding == "first" else 0.0
        seen[:, -self.channels :] = frame
        action = run(self.path, self.session, seen)
        return (action if np.ndim(observation) == 2 else action[0]), seen

    def _expects(self) -> str:
        side = "" if self.sight.history == 1 else f" ({self.width} over a history of {self.sight.history})"
        return f"the network takes observations of {self.channels} channels{side}"

    def require_channels(self, count: int, where: str) -> None:
        """Raise ConfigurationError where an environment has another number of channels than the network takes."""
        if count != self.channels:
            raise ConfigurationError(
                f"{self.path}: {self._expects()}; {where} has {count}: set options.observe, options.action_mode or "
                "history"
            )


def load_onnx(path: str | Path, sight: Sight | None = None) -> OnnxPolicy:
    """A policy from an ONNX file. Nothing in the file is executed but operators of the standard.

    Parameters
    ----------
    path : str or Path
        The file.
    sight : Sight, optional
        What lies between the observation and the network.

    Returns
    -------
    OnnxPolicy
        With ``predict`` as stable-baselines3's.

    Raises
    ------
    ConfigurationError
        For what is no ONNX file, for what is refused (see the module), and where input or output have another shape or
        type than expected: the line names both.
    """
    path, sight = Path(path), sight or Sight()
    content = path.read_bytes()
    if len(content) > LARGEST:
        raise ConfigurationError(f"{path}: {len(content) / 2**20:.0f} MiB; a policy has at most {LARGEST // 2**20} MiB")
    runtime = _checked(path, content)
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # a network this small is slower on several
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ConfigurationError(f"{path}: onnxruntime cannot load it: {_line(error)}") from None
    policy = OnnxPolicy(path, hashlib.sha256(content).hexdigest()[:12], session, _width(path, session, sight), sight)
    run(path, session, np.zeros((1, policy.width), np.float32))
    return policy


def run(path: Path, session: Any, seen: np.ndarray) -> np.ndarray:
    """The first output for what a network sees, [n, 1]; ConfigurationError where it has another shape or type."""
    try:
        (action,) = session.run([session.get_outputs()[0].name], {session.get_inputs()[0].name: seen})
    except Exception as error:
        raise ConfigurationError(f"{path}: onnxruntime cannot run it: {_line(error)}") from None
    expected = (len(seen), 1)
    if not isinstance(action, np.ndarray) or action.shape != expected or action.dtype != np.float32:
        found = f"{action.dtype} {list(action.shape)}" if isinstance(action, np.ndarray) else type(action).__name__
        raise ConfigurationError(f"{path}: expected actions float32 {list(expected)} as first output, found {found}")
    return action


def _width(path: Path, session: Any, sight: Sight) -> int:
    """Numbers that the network takes for each environment."""
    inputs = session.get_inputs()
    shape: list[Any] = list(inputs[0].shape) if len(inputs) == 1 else []
    whole = len(shape) == 2 and isinstance(shape[1], int) and (isinstance(shape[0], str | None) or shape[0] == 1)
    if not whole or inputs[0].type != "tensor(float)":
        found = ", ".join(f"{i.type} {i.shape}" for i in inputs) or "none"
        raise ConfigurationError(f"{path}: expected one input, tensor(float) [n, channels], found {found}")
    width = int(shape[1])
    if width % sight.history:
        raise ConfigurationError(f"{path}: history {sight.history} does not divide the {width} numbers that it takes")
    if sight.mean and len(sight.mean) != width // sight.history:
        raise ConfigurationError(
            f"{path}: normalization of {len(sight.mean)} channels; expected {width // sight.history}, as the network "
            "takes"
        )
    return width


def _checked(path: Path, content: bytes) -> Any:
    """The module onnxruntime, where the file holds nothing that is refused."""
    try:
        import onnx
        import onnxruntime
    except ImportError as error:
        raise ConfigurationError("policies in ONNX need onnxruntime: pip install 'cable-envs[onnx]'") from error
    try:
        model = onnx.load_model_from_string(content)
        trained = [graph for info in model.training_info for graph in (info.initialization, info.algorithm)]
        graphs = [model.graph, *model.functions, *trained]
        own = {(f.domain, f.name) for f in model.functions if not f.domain.startswith("com.microsoft")}
        for node in (node for graph in graphs for node in _nodes(graph)):
            _check_node(path, node, own)
        tensors = [t for graph in graphs for t in _tensors(graph)]
    except ConfigurationError:
        raise
    except Exception as error:
        raise ConfigurationError(f"{path} is no ONNX file: {_line(error)}") from None
    for tensor in tensors:
        if tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data:
            raise ConfigurationError(
                f"{path}: '{tensor.name}' is kept outside the file; export it with all weights inside"
            )
    return onnxruntime


def _check_node(path: Path, node: Any, own: set[tuple[str, str]]) -> None:
    """Refuse an operator that is neither of the standard nor a function ``own`` of the file."""
    if node.domain not in DOMAINS and (node.domain, node.op_type) not in own:
        raise ConfigurationError(
            f"{path}: operator '{node.domain}:{node.op_type}'; only those of the ONNX standard are run"
        )
    if node.op_type in REFUSED:
        raise ConfigurationError(f"{path}: operator '{node.op_type}' is not run: {REFUSED[node.op_type]}")


def _nodes(graph: Any) -> Iterator[Any]:
    """Every node of a graph or function, those of branches included."""
    for node in graph.node:
        yield node
        for attribute in node.attribute:
            for inner in (attribute.g, *attribute.graphs):
                yield from _nodes(inner)


def _tensors(graph: Any) -> Iterator[Any]:
    """Every tensor that a graph or function holds."""
    yield from getattr(graph, "initializer", ())
    for sparse in getattr(graph, "sparse_initializer", ()):
        yield from (sparse.values, sparse.indices)
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for sparse in (attribute.sparse_tensor, *attribute.sparse_tensors):
                yield from (sparse.values, sparse.indices)
            for inner in (attribute.g, *attribute.graphs):
                yield from _tensors(inner)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
