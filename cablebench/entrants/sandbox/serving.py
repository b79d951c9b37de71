"""What runs in the process of a stranger's file: it answers questions until the connection is closed.

The file's content comes over the connection, so this process knows neither where it lies nor anything else of the one
that asks. Messages: `cablebench.entrants.apart`.
"""

import base64
import json
import os
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cablebench.entrants.submission import FileController, kind_of, told


def serve(descriptor: int) -> None:
    """Answer until the connection is closed."""
    pipe = Connection(descriptor)
    kind: Any = None
    made: list[Any] = []
    while True:
        try:
            operation, arguments = json.loads(pipe.recv_bytes())
        except (EOFError, OSError):
            return
        try:
            if operation == "load":
                name, content = arguments
                kind = kind_of(Path(name), base64.b64decode(content))
                value: Any = kind.source_hash
            else:
                value = _answer(kind, made, operation, arguments)
            reply = json.dumps(["ok", value])
        except ConfigurationError as error:
            reply = json.dumps(["error", str(error)])
        except BaseException as error:  # SystemExit and the like: said there, not taken for an end
            reply = json.dumps(["error", f"{operation}() raised {told(error)}"])
        pipe.send_bytes(reply.encode())


def _answer(kind: Any, made: list[Any], operation: str, arguments: list[Any]) -> Any:
    if operation == "declare":
        own = isinstance(kind, FileController)
        return {
            "derived": not own, "name": kind.name, "information": kind.information,
            "charged": dict(getattr(kind, "charged", {})), "envs": list(kind.envs) if own else [],
            "observes": own and kind.observes, "action_mode": kind.action_mode if own else None,
        }  # fmt: skip
    if operation == "level":
        return kind.levels[arguments[0]]
    if operation == "applies":
        return kind.applies(*arguments)
    if operation == "make":
        plant, mode, task, rig, dt, gains, bounds = arguments
        case = (plant, mode, task)
        if bounds is None:
            made.append(kind(*case, rig, dt, **gains))
        else:
            made.append(kind.within(*case, rig, dt, *bounds, **gains))
        return len(made) - 1
    controller, rest = made[arguments[0]], arguments[1:]
    if operation == "act":
        t, y, ref = rest
        return float(controller.act(t, y, tuple(ref)))
    return getattr(controller, operation)(*rest)


def end_with_parent() -> None:
    """End this process with the one that started it, also where that was killed while nothing is answered here."""
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
