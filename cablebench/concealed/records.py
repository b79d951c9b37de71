"""Recordings of a hidden rig on its bench; the recording states the rig that everybody believes in."""

from contextlib import closing
from pathlib import Path

import gymnasium as gym

from cable_envs.diagnosis.data.writing import FILE
from cable_envs.sim.rigs import load_rig
from cablebench.concealed.hidden import HiddenRig
from cablebench.concealed.mechanism import Mechanism
from cablebench.entrants.entrant import controller_entrant
from cablebench.export.recording import write_recording
from cablebench.export.trace import record

FIRST_SEED = 7_000_000
"""Of the bench's episodes: their noise and drawn references are those of no other use."""


def record_hidden(hidden: HiddenRig, mechanism: Mechanism, folder: Path) -> Path:
    """Record as many motions on the mechanism's bench as it says; the last record is held out.

    Parameters
    ----------
    hidden : HiddenRig
    mechanism : Mechanism
        Its bench: environment, options, controller and number of records.
    folder : Path
        For the recording. What lies there already is taken as it is.

    Returns
    -------
    Path
        The recording's file.
    """
    if (folder / FILE).is_file():
        return folder / FILE
    bench = mechanism.bench
    entrant = controller_entrant(bench["controller"])
    options = {**bench["options"], **hidden.options(mechanism), "observe": "full"}
    first = FIRST_SEED + bench["records"] * hidden.number
    with closing(gym.make(bench["env"], disable_env_checker=True, **options)) as env:
        traces = record(env, entrant, range(first, first + bench["records"]))
        return write_recording(traces, env, entrant, folder, heldout=1, believed=load_rig(mechanism.preset))
