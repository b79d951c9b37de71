"""What a recording shows that its simulator leaves out: effects, their sizes, and how sure that is.

    from cable_envs.diagnosis import diagnose, load_recording

    found = diagnose("my-recording/")           # a folder with recording.yaml and one table for each record
    print(found.verdict, [effect.name for effect in found.effects])

`Recording.from_arrays` and `Recording.from_dataframe` make a recording of numbers in memory, without a folder.

The package from the question to the answer; each folder imports only those below it:

==================  =====================================================================================
`engine`            `diagnose`: every step in its order
`report`            from the selected model to the answer (`Diagnosis`)
`search`            which effects explain a recording: comparison by evidence, exchange, limit cycles
`evidence`          marginal likelihood of a model, what it may be off by, and what it leaves
`intake`            faults of the data that are refused before anything is fitted
`systems`           a recording as a model: the plant's kernel driven by what was recorded as its input
`fit`               least squares, likelihood, score tests of effects, covariance, localisation in time
`model`             what all systems share: residual model, noise and whitening, hypotheses, the answer's data
`readers`           measured data of other formats as a recording
`data`              the recording: its YAML, its tables, and a first look at them
`real`              studies of the published recordings
==================  =====================================================================================

docs/diagnosis.md says what is done and why, with sources.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if __name__ != "cable_envs.diagnosis":
    raise ImportError("the folder diagnosis/ of this checkout is imported as cable_envs.diagnosis")

if TYPE_CHECKING:
    from cable_envs.diagnosis.data.recording import Recording, load_recording
    from cable_envs.diagnosis.engine import diagnose
    from cable_envs.diagnosis.model.verdict import Diagnosis

__all__ = ["Diagnosis", "Recording", "diagnose", "load_recording"]

_WHERE = {
    "Diagnosis": "cable_envs.diagnosis.model.verdict",
    "Recording": "cable_envs.diagnosis.data.recording",
    "diagnose": "cable_envs.diagnosis.engine",
    "load_recording": "cable_envs.diagnosis.data.recording",
}


def __getattr__(name: str) -> Any:
    """Names of ``__all__``, imported when they are first asked for: kernels take a second to load."""
    if name not in _WHERE:
        raise AttributeError(f"module 'cable_envs.diagnosis' has no attribute '{name}'")
    return getattr(import_module(_WHERE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
