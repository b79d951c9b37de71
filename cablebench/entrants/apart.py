"""A newcomer's .py file at work in a process of its own: what counts is only what arrives from there as an answer.

The simulator, the metrics and the records stay here; the other process is told what a controller may see and is asked
for one number at a time. If it ends (``os._exit(0)``, a crash), hangs or answers anything but a number, that is a
`ConfigurationError` that names the file, and no record. It protects the evaluation from mistakes and from code that
would change the scorer from within. It is no sandbox: the process has all rights of the account.

Messages are JSON, which cannot carry code: ``[operation, arguments]`` there, ``["ok", value]`` or ``["error", text]``
back.
"""

import json
import os
import shlex
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.setup import Setup
from cablebench.entrants.entrant import Entrant, controller_entrant
from cablebench.entrants.submission import FileController, load_kind, read_source, source_hash, told
from cablebench.protocol.actors import ControllerActor

ANSWER = 20.0
"""s after which an answer counts as never coming."""

START = 120.0
"""s for the process to start and to load the file, which may compile."""

EPISODE = 900.0
"""s that all answers of an episode may take together."""

LONGEST = 2**20
"""Bytes of an answer."""

_BOOT = "import sys, json; sys.path[:] = json.loads(sys.argv[1]); from cablebench.entrants.apart import serve; serve()"


def submission_entrant(path: str | Path) -> Entrant:
    """The entrant of a .py file. Executes the file, in a process of its own.

    Raises ConfigurationError that names the file and what is wrong: no reset() or act(), a wrong signature or
    declaration, an error while it is loaded, no answer.
    """
    kind = controller_kind(path)
    arguments = f"--controller {shlex.quote(str(path))}"
    if kind.derived:
        return replace(controller_entrant(kind), arguments=arguments, settings={"source": kind.source_hash})
    return Entrant(
        kind.name, kind.information,
        make=lambda setup: ControllerActor(kind.made_for(setup), setup),
        needs=kind.needs,
        arguments=arguments,
        charged=kind.charged,
        settings={"source": kind.source_hash},
    )  # fmt: skip


def controller_kind(path: str | Path) -> Any:
    """What a .py file offers, as `load_kind` gives it, from a process of its own."""
    return _Kind(Path(path))


class _Process:
    """The other process, and one question at a time."""

    def __init__(self, path: Path):
        self.path = path
        ours, theirs = socket.socketpair()
        for waits in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):  # half an answer must not be waited for either
            ours.setsockopt(socket.SOL_SOCKET, waits, struct.pack("ll", int(START), 0))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _BOOT, json.dumps(sys.path), str(theirs.fileno()), str(path)],
                pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, stdout=2, start_new_session=True,
            )  # fmt: skip
        self._pipe = Connection(ours.detach())
        self._end = weakref.finalize(self, _end, self._process, self._pipe)

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return self._end.alive and self._process.poll() is None

    def ask(self, operation: str, *arguments: Any, limit: float = ANSWER) -> Any:
        """The answer. Raises ConfigurationError where there is none; then the process is ended."""
        try:
            self._pipe.send_bytes(json.dumps([operation, arguments]).encode())
            if not self._pipe.poll(limit):
                raise ConfigurationError(f"{self.path}: {operation}() has not answered within {limit:g} s")
            answer = json.loads(self._pipe.recv_bytes(LONGEST))
            ok, value = answer[0] == "ok", answer[1]
        except (EOFError, OSError):
            raise ConfigurationError(f"{self.path}: {operation}() {self._how()}") from None
        except (ValueError, RecursionError, LookupError, TypeError) as error:
            self._end()
            if isinstance(error, ConfigurationError):
                raise
            raise ConfigurationError(f"{self.path}: {operation}() sent no answer but something else") from None
        except BaseException:
            self._end()  # an answer that comes later must not be taken for that of another question
            raise
        if not ok:
            raise ConfigurationError(str(value))
        return value

    def _how(self) -> str:
        """How it ended, in words."""
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "closed its connection without an answer"
        finally:
            self._end()
        how = f"killed by signal {-code} ({signal.Signals(-code).name})" if code < 0 else f"exit code {code}"
        return f"ended its process without an answer ({how})"


def _end(process: subprocess.Popen, pipe: Connection) -> None:
    pipe.close()
    process.kill()
    process.wait()


class _Kind:
    """Of the other process what `load_kind` gives in this one; a process that has ended is started anew."""

    def __init__(self, path: Path):
        self.path = path
        self.source_hash = source_hash(read_source(path))
        self._process: _Process | None = None
        self._levels: dict[str, str | None] = {}
        about = self._ask("declare")
        self.derived: bool = about["derived"]
        """whether it is a class derived from `cable_envs.baselines.Controller`"""
        self.name, self.information, self.charged = about["name"], about["information"], about["charged"]
        self._envs = about["envs"]

    def _ask(self, operation: str, *arguments: Any) -> Any:
        return self._running().ask(operation, *arguments)

    def _running(self) -> _Process:
        if self._process is None or not self._process.alive:
            self._process = _Process(self.path)
            if self._process.ask("load", limit=START) != self.source_hash:
                raise ConfigurationError(f"{self.path} has changed while it was used")
        return self._process

    @property
    def levels(self) -> "_Kind":
        """The observation level by plant: ``levels[plant]``."""
        return self

    def __getitem__(self, plant: str) -> str | None:
        if plant not in self._levels:
            self._levels[plant] = self._ask("level", plant)
        return self._levels[plant]

    def applies(self, *case: str) -> bool:
        """Whether it is made for a plant, action mode and task."""
        return bool(self._ask("applies", *case))

    def needs(self, env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        """Environment options it needs, or None where it does not enter."""
        if self._envs and env_id not in self._envs:
            return None
        level = self[setup.plant.name]
        return {} if level is None else {"observe": level}

    def __call__(
        self, plant: str, action_mode: str, task: str, rig: Mapping[str, Any], dt: float, **gains: float
    ) -> "_Controller":
        return self._made(plant, action_mode, task, dict(rig), dt, gains, None)

    def made_for(self, setup: Setup) -> "_Controller":
        """A controller for an environment with this setup, from a fresh run of the file."""
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        return self._made(*case, dict(setup.rig.values), setup.control_period, {}, [setup.low, setup.high])

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
        before = time.perf_counter()
        u = self._process.ask("act", self._number, t, dict(y), ref)
        self._spent += time.perf_counter() - before
        if self._spent > EPISODE:
            raise ConfigurationError(
                f"{self._process.path}: its answers took more than {EPISODE:g} s of one episode, up to t = {t:g} s"
            )
        if isinstance(u, bool) or not isinstance(u, (int, float)):
            raise ConfigurationError(f"{self._process.path}: act() sent no number at t = {t:g} s")
        return float(u)


def serve() -> None:
    """Body of the other process: answers questions until the connection is closed."""
    pipe, path, parent = Connection(int(sys.argv[2])), Path(sys.argv[3]), os.getppid()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    kind: Any = None
    made: list[Any] = []
    while True:
        try:
            operation, arguments = json.loads(pipe.recv_bytes())
        except (EOFError, OSError):
            return
        try:
            if operation == "load":
                kind = load_kind(path)
                value: Any = kind.source_hash
            else:
                value = _answer(kind, made, operation, arguments)
            reply = json.dumps(["ok", value])
        except ConfigurationError as error:
            reply = json.dumps(["error", str(error)])
        except BaseException as error:  # SystemExit and the like: said there, not taken for an end
            reply = json.dumps(["error", f"{path}: {operation}() raised {told(error)}"])
        pipe.send_bytes(reply.encode())


def _answer(kind: Any, made: list[Any], operation: str, arguments: list[Any]) -> Any:
    if operation == "declare":
        own = isinstance(kind, FileController)
        return {
            "derived": not own, "name": kind.name, "information": kind.information,
            "charged": dict(getattr(kind, "charged", {})), "envs": list(kind.envs) if own else [],
        }  # fmt: skip
    if operation == "level":
        return kind.levels[arguments[0]]
    if operation == "applies":
        return kind.applies(*arguments)
    if operation == "make":
        plant, mode, task, rig, dt, gains, bounds = arguments
        case = (plant, mode, task)
        made.append(kind(*case, rig, dt, **gains) if bounds is None else kind.within(*case, rig, dt, *bounds))
        return len(made) - 1
    controller, rest = made[arguments[0]], arguments[1:]
    if operation == "act":
        t, y, ref = rest
        return float(controller.act(t, y, tuple(ref)))
    return getattr(controller, operation)(*rest)


def _end_with(parent: int) -> None:
    """End with the process that asks, also where it was killed while nothing is answered here."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
