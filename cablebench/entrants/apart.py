"""A newcomer's .py file at work in a process of its own: what counts is only what arrives from there as an answer.

The simulator, the metrics and the records stay here; the other process is told what a controller may see and is asked
for one number at a time. If it ends (``os._exit(0)``, a crash), hangs or answers anything but a number, that is a
`ConfigurationError` that names the file, and no record. The process has neither seeds nor true parameters nor the place
of the store; what stands around it says `cablebench.entrants.sandbox.kinds`.

Messages are JSON, which cannot carry code: ``[operation, arguments]`` there, ``["ok", value]`` or ``["error", text]``
back.
"""

import base64
import json
import os
import shlex
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import permit
from cable_envs.core.params import is_number
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import LEVELS
from cablebench.entrants.entrant import BUDGETS, INFORMATION, Entrant, controller_entrant
from cablebench.entrants.sandbox.kinds import Sandbox, choose, environment
from cablebench.entrants.submission import read_source, source_hash
from cablebench.protocol.actors import Actor, ControllerActor, ObservationActor

ANSWER = 20.0
"""s after which an answer counts as never coming."""

START = 120.0
"""s for the process to start and to load the file, which may compile."""

EPISODE = 900.0
"""s that all answers of an episode may take together."""

LONGEST = 2**20
"""Bytes of an answer."""

PRINTED = 2**16
"""Bytes of what the file prints that are passed on."""


def submission_entrant(path: str | Path, sandbox: str = "auto") -> Entrant:
    """The entrant of a .py file. Executes the file, in a process of its own.

    ``sandbox`` is a kind of `entrants.sandbox.kinds`. Raises ConfigurationError that names the file and what is
    wrong: no reset() or act(), a wrong signature or declaration, an error while it is loaded, no answer.
    """
    kind = controller_kind(path, sandbox)
    arguments = f"--controller {shlex.quote(str(path))}"
    if kind.derived:
        made = replace(controller_entrant(kind), arguments=arguments, settings={"source": kind.source_hash})
        return replace(made, sandbox=kind.sandbox)
    return Entrant(
        kind.name, kind.information,
        make=lambda setup: kind.actor(kind.made_for(setup), setup),
        needs=kind.needs,
        arguments=arguments,
        charged=kind.charged,
        settings={"source": kind.source_hash},
        sandbox=kind.sandbox,
    )  # fmt: skip


def controller_kind(path: str | Path, sandbox: str = "auto") -> Any:
    """What a .py file offers, as `kind_of` gives it, from a process of its own."""
    return _Kind(Path(path), choose(sandbox))


class _Process:
    """The other process, and one question at a time."""

    def __init__(self, path: Path, sandbox: Sandbox):
        self.path = path
        ours, theirs = socket.socketpair()
        folder = tempfile.mkdtemp(prefix="cablebench-")
        with theirs:
            self._process = subprocess.Popen(
                sandbox.command(theirs.fileno(), folder), pass_fds=(theirs.fileno(),), cwd=folder, env=environment(),
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
        self._pipe = ours
        threading.Thread(target=_pass_on, args=(self._process.stdout,), daemon=True).start()
        self._end = weakref.finalize(self, _end, self._process, ours, folder)

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self._end.alive and self._process.poll() is None

    def ask(self, operation: str, *arguments: Any, limit: float | None = None) -> Any:
        """The answer, within `ANSWER` seconds or ``limit``. Raises ConfigurationError where there is none.

        Then the process is ended.
        """
        allowed = ANSWER if limit is None else limit
        try:
            message = json.dumps([operation, arguments]).encode()
            answer = json.loads(self._exchanged(message, time.monotonic() + allowed))
            ok, value = answer[0] == "ok", answer[1]
        except TimeoutError:
            self._end()
            raise ConfigurationError(f"{self.path}: {operation}() has not answered within {allowed:g} s") from None
        except (EOFError, OSError):
            raise ConfigurationError(f"{self.path}: {operation}() {self._how()}") from None
        except (ValueError, RecursionError, LookupError, TypeError):
            self._end()
            raise ConfigurationError(f"{self.path}: {operation}() sent no answer but something else") from None
        except BaseException:
            self._end()  # an answer that comes later must not be taken for that of another question
            raise
        if not ok:
            raise ConfigurationError(self._named(str(value)))
        return value

    def _exchanged(self, message: bytes, until: float) -> bytes:
        """The answer to a message, with its length before it as `multiprocessing.connection` writes it."""
        self._pipe.settimeout(max(until - time.monotonic(), 1e-3))
        self._pipe.sendall(struct.pack("!i", len(message)) + message)
        (size,) = struct.unpack("!i", self._received(4, until))
        if not 0 <= size <= LONGEST:
            raise ValueError("not the length of an answer")
        return self._received(size, until)

    def _received(self, size: int, until: float) -> bytes:
        """So many bytes. A process that has ended is not waited for, though others that it left may hold the pipe."""
        content = b""
        while len(content) < size:
            left = until - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._pipe.settimeout(min(left, 0.5))
            try:
                part = self._pipe.recv(size - len(content))
            except TimeoutError:
                if self._process.poll() is not None:
                    raise EOFError from None
                continue
            if not part:
                raise EOFError
            content += part
        return content

    def _named(self, text: str) -> str:
        """A message from there in one line, with the file's path, which is not known there."""
        line = "".join(c if c.isprintable() else " " for c in text)[:1000]
        name = self.path.name
        return f"{self.path}{line.removeprefix(name)}" if line.startswith(name) else f"{self.path}: {line}"

    def _how(self) -> str:
        """How it ended, in words."""
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "closed its connection without an answer"
        finally:
            self._end()
        code = 128 - code if code > 128 and code - 128 in set(signal.Signals) else code  # as bubblewrap says it
        how = f"killed by signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"exit code {code}"
        return f"ended its process without an answer ({how})"


def _end(process: subprocess.Popen[bytes], pipe: socket.socket, folder: str) -> None:
    pipe.close()
    with suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)  # with what it may have started
    process.kill()
    process.wait()
    with suppress(OSError):
        os.rmdir(folder)


def _pass_on(stream: IO[bytes]) -> None:
    """What the file prints, on standard error: without control characters, and no more than `PRINTED`."""
    left = PRINTED
    with suppress(OSError, ValueError):
        while part := os.read(stream.fileno(), 2**16):
            text = part[:left].decode(errors="replace")
            left -= len(part[:left])
            print("".join(c if c.isprintable() or c == "\n" else "?" for c in text), end="", file=sys.stderr)
    stream.close()


class _Kind:
    """Of the other process what `kind_of` gives there; a process that has ended is started anew."""

    def __init__(self, path: Path, sandbox: Sandbox):
        self.path, self._sandbox = path, sandbox
        self._content = read_source(path)
        permit(path, self._content)
        self.source_hash, self.sandbox = source_hash(self._content), sandbox.name
        self._process: _Process | None = None
        self._levels: dict[str, str | None] = {}
        about = self._declared(self._ask("declare"))
        self.derived: bool = about["derived"]
        """whether it is a class derived from `cable_envs.baselines.Controller`"""
        self.name, self.information, self.charged = about["name"], about["information"], about["charged"]
        self.observes: bool = about["observes"]
        """whether it takes the environment's observation instead of measurements in SI"""
        self._envs, self._mode = about["envs"], about.get("action_mode")

    def _declared(self, about: Any) -> dict[str, Any]:
        """The declaration, checked once more here: over there a file may answer in place of what checks it."""
        kinds: dict[str, Any] = {
            "derived": bool, "name": str, "information": str, "charged": dict, "envs": list, "observes": bool,
            "action_mode": (str, type(None)),
        }  # fmt: skip
        if not isinstance(about, dict) or any(not isinstance(about.get(k), kind) for k, kind in kinds.items()):
            raise ConfigurationError(f"{self.path}: declare() sent no declaration but something else")
        require_known(f"information class in {self.path}", [about["information"]], INFORMATION)
        require_known(f"budget in {self.path}", about["charged"], BUDGETS)
        for key, amount in about["charged"].items():
            if not is_number(amount) or amount < 0:
                raise ConfigurationError(f"{self.path}: charged.{key} = {amount!r}; expected a number of at least 0")
        return about

    def _ask(self, operation: str, *arguments: Any) -> Any:
        return self._running().ask(operation, *arguments)

    def _running(self) -> _Process:
        if self._process is None or not self._process.alive:
            self._process = _Process(self.path, self._sandbox)
            content = base64.b64encode(self._content).decode()
            self._process.ask("load", self.path.name, content, limit=START)
        return self._process

    @property
    def levels(self) -> "_Kind":
        """The observation level by plant: ``levels[plant]``."""
        return self

    def __getitem__(self, plant: str) -> str | None:
        if plant not in self._levels:
            level = self._ask("level", plant)
            require_known(f"observe level in {self.path}", [] if level is None else [str(level)], LEVELS)
            self._levels[plant] = level
        return self._levels[plant]

    def applies(self, *case: str) -> bool:
        """Whether it is made for a plant, action mode and task."""
        return bool(self._ask("applies", *case))

    def needs(self, env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        """Environment options it needs, or None where it does not enter."""
        if self._envs and env_id not in self._envs:
            return None
        modes = [mode.name for mode in setup.plant.action_modes]
        if self._mode is not None and self._mode not in modes:
            return None
        return self.choices(setup)

    def choices(self, setup: Setup) -> dict[str, str]:
        """What it observes and how it acts, where it says so."""
        chosen = {"observe": self[setup.plant.name], "action_mode": self._mode}
        return {option: value for option, value in chosen.items() if value is not None}

    def actor(self, controller: Any, setup: Setup) -> Actor:
        """What stands between one of its controllers and an environment."""
        return ObservationActor(controller) if self.observes else ControllerActor(controller, setup)

    def __call__(
        self, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float, **gains: float
    ) -> "_Controller":
        """As a class of `baselines`: the command's range is taken from the rig."""
        from cable_envs.baselines.base import command_range, complete_rig

        bounds = None if self.derived else command_range(plant, action_mode, complete_rig(plant, rig))
        return self._made(plant, action_mode, task, self._told(rig), dt, gains, bounds)

    def made_for(self, setup: Setup) -> "_Controller":
        """A controller for an environment with this setup, from a fresh run of the file."""
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        return self._made(*case, self._told(setup.rig.values), setup.control_period, {}, [setup.low, setup.high])

    def _told(self, rig: Mapping[str, Any]) -> dict[str, Any]:
        """What of the nominal rig goes over: nothing to a model-free file."""
        return {} if self.information == "model-free" and not self.derived else dict(rig)

    def _made(self, *arguments: Any) -> "_Controller":
        process = self._running()
        return _Controller(process, process.ask("make", *arguments, limit=START), self.information == "oracle")


class _Controller:
    """One controller over there, with the interface of `cable_envs.baselines.Controller`."""

    def __init__(self, process: _Process, number: int, true_rig: bool):
        self._process, self._number, self._true_rig = process, number, true_rig
        self._spent = 0.0

    def set_rig(self, rig: Mapping[str, Any]) -> None:
        """The true parameters: only an oracle's process is told them."""
        if self._true_rig:
            self._process.ask("set_rig", self._number, dict(rig))

    def reset(self) -> None:
        """Begin an episode."""
        self._spent = 0.0
        self._process.ask("reset", self._number)

    def act(self, t: float, y: Mapping[str, float], ref: tuple[float, float, float]) -> float:
        """The command in SI; NaN ends the episode as failed."""
        return self._asked("act", t, dict(y), ref)

    def act_observation(self, t: float, obs: list[float]) -> float:
        """The action in [-1, 1] of a policy on observations."""
        return self._asked("act_observation", t, obs)

    def _asked(self, operation: str, t: float, *told: Any) -> float:
        before = time.perf_counter()
        u = self._process.ask(operation, self._number, t, *told)
        self._spent += time.perf_counter() - before
        if self._spent > EPISODE:
            raise ConfigurationError(
                f"{self._process.path}: its answers took more than {EPISODE:g} s of one episode, up to t = {t:g} s"
            )
        if isinstance(u, bool) or not isinstance(u, (int, float)):
            raise ConfigurationError(f"{self._process.path}: {operation}() sent no number at t = {t:g} s")
        try:
            return float(u)
        except OverflowError:
            raise ConfigurationError(f"{self._process.path}: {operation}() sent no number at t = {t:g} s") from None
