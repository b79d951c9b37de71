"""Finished steps of a diagnosis on disk, so that an interrupted one goes on where it was."""

import hashlib
import pickle
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cable_envs.core.files import write_atomic
from cable_envs.core.provenance import sources
from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.hypotheses import Hypothesis

FOLDER = ".steps"
T = TypeVar("T")


class Steps:
    """``steps(name, make)`` is ``make()``, or what it gave before an interruption. Without a folder nothing is kept.

    The state of ``rng`` is kept with each step, so that what follows draws the same numbers either way. Hypotheses are
    kept by name: those of the running diagnosis take their place. A file that cannot be read counts as absent.
    """

    def __init__(self, out: Path | None, key: str, hypotheses: Sequence[Hypothesis], rng: np.random.Generator):
        self._root = None if out is None else out / FOLDER
        self._folder = None if out is None else out / FOLDER / key
        self._by_name = {h.name: h for h in hypotheses}
        self._rng, self._count = rng, 0
        self.found = 0
        """steps that were finished already"""

    def __call__(self, name: str, make: Callable[[], T]) -> T:
        self._count += 1
        if self._folder is None:
            return make()
        file = self._folder / f"{self._count:03d}-{name}.pickle"
        if file.is_file():
            try:
                with file.open("rb") as stream:
                    result, state = _Reader(stream, self._by_name).load()
            except (pickle.UnpicklingError, EOFError, KeyError, AttributeError, ImportError):
                file.unlink()
            else:
                self._rng.bit_generator.state = state
                self.found += 1
                return result
        result = make()
        write_atomic(file, _dumped((result, self._rng.bit_generator.state)))
        return result

    def forget(self) -> None:
        """Remove all steps: the diagnosis is finished."""
        if self._root is not None:
            shutil.rmtree(self._root, ignore_errors=True)


class _Writer(pickle.Pickler):
    def persistent_id(self, thing: Any) -> str | None:
        return thing.name if isinstance(thing, Hypothesis) else None


class _Reader(pickle.Unpickler):
    def __init__(self, stream: Any, hypotheses: Mapping[str, Hypothesis]):
        super().__init__(stream)
        self._hypotheses = hypotheses

    def persistent_load(self, name: str) -> Hypothesis:
        return self._hypotheses[name]


def _dumped(thing: Any) -> bytes:
    import io

    stream = io.BytesIO()
    _Writer(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(thing)
    return stream.getvalue()


def digest(recording: Recording, options: Iterable[Any]) -> str:
    """Of the recording's data and all that is said of it, the options, and the program's text."""
    total = hashlib.sha256()
    about = (recording.system, recording.rig, recording.known, recording.nominal, recording.channels, *options)
    total.update(repr(about).encode())
    for record in recording.records:
        total.update(repr((record.name, record.use, record.conditions, record.offsets, record.quality)).encode())
        for channel, values in record.data.items():
            total.update(channel.encode() + np.ascontiguousarray(values).tobytes())
    for package in ("cable_envs.diagnosis", "cable_envs"):
        for content in sources(package).values():
            total.update(content)
    return total.hexdigest()[:16]
