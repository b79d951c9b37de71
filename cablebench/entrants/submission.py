"""Anyone's controller as one file: a .py file with ``reset()`` and ``act(t, y, ref)``, SI in and out.

```python
name = "my-pid"                     # as on the board
information = "model-free"          # what it uses: model-free | nominal | identified | planner | oracle
observe = "output"                  # drive | output | full; optional, the task's own without it; a mapping where the
                                    # plants differ: {"cable_hole": "output", "pulley_circuit": "drive"}
tasks = ["CableHole-Position-Sine"] # optional: environment ids it enters; all without it
charged = {"tuning_trials": 40}     # optional: what finding its gains cost

def reset(about):                   # before every episode; reset() without argument is as good
    ...                             # about: plant, action_mode, task, dt, low, high (the command's range) and, unless
                                    # model-free, rig: nominal parameters by name (true ones for an oracle)

def act(t, y, ref):                 # once a control period: t in s, y measurements by name, ref = (r, r_dot, r_ddot)
    return 0.0                      # the command
```

A policy on observations has ``act_observation(obs)`` instead of ``act``, and may leave ``reset`` out: ``obs`` is the
environment's own observation, a list of numbers (scaled, in the order of `cablebench envs`), the answer the action in
[-1, 1]. It may declare ``action_mode`` beside ``observe``:

```python
name, information, observe = "my-policy", "model-free", "output"

def act_observation(obs):
    return 0.1 * obs[3]
```

Instead of the two functions a class may have them as methods; its constructor's keyword arguments are gains, which a
controller file can set. Every environment gets a module (and object) of its own, so nothing is left over from another
task. A class derived from `cable_envs.baselines.Controller` is taken as it is. **Loading such a file executes it**:
only load what you trust.
"""

import hashlib
import inspect
import math
import reprlib
import sys
import types
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.params import is_number
from cable_envs.sim.tasks import LEVELS
from cablebench.entrants.entrant import BUDGETS, INFORMATION
from cablebench.protocol.protocol import Task

LONGEST_TEXT = 500
"""Characters of an error of somebody's that are passed on."""

OBSERVES = "act_observation"
"""Name of the function of a policy on observations, which takes the place of ``act``."""

_DECLARED = ("name", "information", "observe", "action_mode", "tasks", "charged")


def kind_of(path: Path, content: bytes) -> Any:
    """A `FileController` of a .py file, or the file's class derived from `baselines.Controller`. Executes the content.

    ``path`` is what errors call the file.
    """
    module = execute(path, content)
    digest = source_hash(content)
    own = [v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__]
    base = sys.modules.get("cable_envs.baselines.base")  # a file that derives from it has imported it
    derived = [c for c in own if base is not None and issubclass(c, base.Controller)]
    if len(derived) == 1:
        for key in ("name", "information"):
            if not hasattr(derived[0], key):
                raise ConfigurationError(f"{path}: class {derived[0].__name__} declares no '{key}'")
        setattr(derived[0], "source_hash", digest)  # noqa: B010 - of this file's class, none that all have
        return derived[0]
    return FileController(path, content, digest, module)


def read_source(path: Path) -> bytes:
    """The file's content; ConfigurationError where it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from None


def source_hash(content: bytes) -> str:
    """The first twelve hex digits of the SHA-256."""
    return hashlib.sha256(content).hexdigest()[:12]


def execute(path: Path, content: bytes) -> types.ModuleType:
    """A fresh module with what the file defines; ConfigurationError where it raises."""
    module = types.ModuleType(f"submission_{source_hash(content)}")
    module.__file__ = str(path)
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        raise ConfigurationError(f"{path} cannot be loaded: {told(error)}") from None
    return module


def told(error: BaseException) -> str:
    """An error of somebody's code in one line, with the line number where there is one."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    line = getattr(error, "lineno", None) or (trace.tb_lineno if trace is not None else None)
    text = " ".join(str(error)[:LONGEST_TEXT].split())
    return f"{type(error).__name__}: {text}" + (f" (line {line})" if line and "line " not in text else "")


class FileController:
    """A checked .py file; calling it like a class of `baselines` gives a controller for one environment."""

    def __init__(self, path: Path, content: bytes, digest: str, module: types.ModuleType):
        self.path, self._content, self.source_hash = path, content, digest
        offered = _offer(path, module)
        self.observes = callable(getattr(offered, OBSERVES, None))
        """whether it is a policy on observations: ``act_observation(obs)``"""
        declared = {k: getattr(offered, k, getattr(module, k, None)) for k in _DECLARED}
        self.name = self._text(declared["name"] or path.stem, "name")
        self.information = self._text(declared["information"], "information", "'model-free'")
        require_known(f"information class in {path}", [self.information], INFORMATION)
        self.envs = self._tasks(declared["tasks"])
        self.charged = self._charges(declared["charged"])
        observe = declared["observe"]
        named = dict(observe) if isinstance(observe, Mapping) else {}
        other = None if isinstance(observe, Mapping) else observe
        require_known(f"observe level in {path}", filter(None, [*named.values(), other]), LEVELS)
        self.levels: Mapping[str, str | None] = defaultdict(lambda: other, named)
        """observation level by plant; None: the task's own"""
        mode = declared["action_mode"]
        self.action_mode = None if mode is None else self._text(mode, "action_mode", "'tension'")
        if self.action_mode is not None:
            require_known(f"action mode in {path}", [self.action_mode], action_modes())
        """None: the task's own"""

    def within(
        self, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float, low: float, high: float,
        **gains: float,
    ) -> "Played":  # fmt: skip
        """A controller, from a fresh run of the file, for an environment with that range of commands."""
        return self._made({"plant": plant, "action_mode": action_mode, "task": task, "dt": dt, "low": low, "high": high,
                           "rig": dict(rig)}, gains)  # fmt: skip

    def _made(self, about: dict[str, Any], gains: Mapping[str, float] | None = None) -> "Played":
        if self.information == "model-free":
            del about["rig"]
        offered = _offer(self.path, execute(self.path, self._content))
        if isinstance(offered, type):
            try:
                inspect.signature(offered).bind(**(gains or {}))
                offered = offered(**(gains or {}))
            except Exception as error:
                raise ConfigurationError(f"{self.path}: {offered.__name__} cannot be made: {told(error)}") from None
        elif gains:
            raise ConfigurationError(f"{self.path}: gains need a class, whose constructor takes them; it has functions")
        return Played(self.path, offered, about, true_rig=self.information == "oracle")

    def _text(self, value: Any, key: str, example: str = "'my-controller'") -> str:
        if not isinstance(value, str) or not value.strip():
            raise ConfigurationError(f"{self.path}: declare {key} = {example} at the top of the file, found {value!r}")
        return value.strip()

    def _tasks(self, value: Any) -> tuple[str, ...]:
        from cable_envs import ENV_IDS, SUITE_IDS

        if value is None:
            return ()
        if isinstance(value, str) or not isinstance(value, (list, tuple, set)):
            raise ConfigurationError(f"{self.path}: tasks must be a list of environment ids, found {value!r}")
        known = ENV_IDS + SUITE_IDS
        short = {Task(env).short: env for env in known}
        require_known(f"environment under 'tasks' in {self.path}", map(str, value), [*short, *known])
        return tuple(short.get(str(env), str(env)) for env in value)

    def _charges(self, value: Any) -> dict[str, float]:
        if not isinstance(value or {}, Mapping):
            raise ConfigurationError(f"{self.path}: charged must map {', '.join(BUDGETS)} to numbers, found {value!r}")
        require_known(f"budget in {self.path}", value or {}, BUDGETS)
        for key, amount in (value or {}).items():
            if not is_number(amount) or amount < 0:
                raise ConfigurationError(f"{self.path}: charged['{key}'] = {amount!r}; expected a number of at least 0")
        return dict(value or {})


def _offer(path: Path, module: types.ModuleType) -> Any:
    """The module itself where it has reset() and act() or act_observation(), else its one class that has them."""
    has = {k: callable(getattr(module, k, None)) for k in ("reset", "act")}
    if all(has.values()) or callable(getattr(module, OBSERVES, None)):
        offered: Any = module
    else:
        own = [v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__]
        found = [c for c in own if _acts(c)]
        if len(found) > 1:
            raise ConfigurationError(f"{path}: several controllers: {', '.join(c.__name__ for c in found)}; keep one")
        if not found:
            missing = " and ".join(f"{k}({'t, y, ref' if k == 'act' else ''})" for k, there in has.items() if not there)
            raise ConfigurationError(f"{path} has no {missing}, neither as functions nor as a class with both methods")
        offered = found[0]
    if callable(getattr(offered, OBSERVES, None)):
        if callable(getattr(offered, "act", None)):
            raise ConfigurationError(f"{path} has both act(t, y, ref) and {OBSERVES}(obs); keep one")
        _signature(path, offered, OBSERVES, ("obs",))
    else:
        _signature(path, offered, "act", ("t", "y", "ref"))
    if hasattr(offered, "reset"):
        _signature(path, offered, "reset", ())
    return offered


def _acts(kind: type) -> bool:
    """Whether a class is a controller."""
    has = {k: callable(getattr(kind, k, None)) for k in ("reset", "act", OBSERVES)}
    return has[OBSERVES] or (has["reset"] and has["act"])


def _signature(path: Path, offered: Any, name: str, wanted: tuple[str, ...]) -> None:
    """act must take three arguments by place; reset none, or one."""
    function = getattr(offered, name)
    method = isinstance(offered, type) and not isinstance(inspect.getattr_static(offered, name), staticmethod)
    counts = (len(wanted),) if wanted else (0, 1)
    if not any(_accepts(function, n + method) for n in counts):
        raise ConfigurationError(
            f"{path}: {name}{inspect.signature(function)} does not take the arguments of {name}({', '.join(wanted)})"
        )


def _accepts(function: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    return True


class Played:
    """The file at work in one environment, with the interface of `baselines.Controller`; its mistakes are named."""

    def __init__(self, path: Path, offered: Any, about: dict[str, Any], true_rig: bool):
        self.path, self._offered, self._about, self._true_rig = path, offered, about, true_rig
        reset = getattr(offered, "reset", _nothing)  # a policy on observations may have none
        wants_about = _accepts(reset, 1)
        self._reset = partial(self._call, "reset", reset, *([self._about] if wants_about else []))

    def set_rig(self, rig: Mapping[str, Any]) -> None:
        """The true parameters; an oracle finds them in ``about["rig"]``, nobody else."""
        if self._true_rig:
            self._about["rig"] = dict(rig)

    def reset(self) -> None:
        """Begin an episode."""
        self._reset()

    def act(self, t: float, y: Mapping[str, float], ref: tuple[float, float, float]) -> float:
        """The command in SI; NaN (which ends the episode as failed) is passed on, anything but a number refused."""
        u = self._call("act", self._offered.act, t, y, ref)
        return self._number(u, f"act() answered {reprlib.repr(u)} ({type(u).__name__}) at t = {t:g} s")

    def act_observation(self, t: float, obs: list[float]) -> float:
        """The action in [-1, 1]; ``t`` is for the messages only."""
        a = self._call(OBSERVES, partial(_without_time, self._offered.act_observation), t, obs)
        value = _single(a)
        return self._number(value, f"{OBSERVES}() answered {reprlib.repr(a)} ({type(a).__name__}) at t = {t:g} s")

    def _number(self, value: Any, answered: str) -> float:
        try:
            return float(value)
        except (TypeError, ValueError):
            raise ConfigurationError(f"{self.path}: {answered}; expected one number") from None

    def _call(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except Exception as error:
            at = f" at t = {arguments[0]:g} s" if name != "reset" and math.isfinite(arguments[0]) else ""
            known = self._known(error, arguments[1] if name == "act" else self._about)
            raise ConfigurationError(f"{self.path}: {name}() raised {told(error)}{at}{known}") from None

    def _known(self, error: Exception, given: Mapping[str, Any]) -> str:
        """Behind a KeyError for a name that it was not given: those that it was."""
        key = error.args[0] if isinstance(error, KeyError) and error.args else None
        if key == "rig" and "rig" not in self._about:
            return "; a model-free controller is told no rig"
        if not isinstance(key, str) or key in given:
            return ""
        return f"; {'about' if given is self._about else 'y'} has {', '.join(given)}"


def action_modes() -> tuple[str, ...]:
    """The action modes that there are, of all environments."""
    from cable_envs import ENV_IDS
    from cable_envs.sim.registered import setup_of

    return tuple(sorted({mode.name for env in ENV_IDS for mode in setup_of(env, {}).plant.action_modes}))


def _nothing() -> None:
    """The reset of a policy that has none."""


def _without_time(function: Callable[..., Any], t: float, obs: list[float]) -> Any:
    return function(obs)


def _single(action: Any) -> Any:
    """The entry of an array or list of one, as networks answer; anything else as it is."""
    while hasattr(action, "__len__") and not isinstance(action, (str, bytes)) and len(action) == 1:
        action = action[0]
    return action
