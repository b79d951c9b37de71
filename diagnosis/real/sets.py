"""The published sets as recordings: imported by their readers into a folder, or where they are not, said so."""

from pathlib import Path

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.readers import reader
from cable_envs.diagnosis.readers.base import Request
from cable_envs.diagnosis.readers.writer import write_data_set

FOLDERS = {
    "da-vinci-jaw": "davinci_tool", "band-brake": "band_brake", "emps": "emps", "coupled-drives": "coupled_drives",
    "servo-pendulum": "servo_pendulum",
}  # fmt: skip
"""Format of ``cablebench import`` -> folder of the set."""


def imported(form: str, shared: Path, work: Path) -> Recording:
    """The set of one format below ``shared``, imported with the format's own split into a folder of ``work``.

    Raises ConfigurationError where the set is not there.
    """
    source = shared / FOLDERS[form]
    if not source.is_dir():
        raise ConfigurationError(f"{form}: no folder {source}; --shared names the folder that holds the sets")
    done = write_data_set(reader(form).open_dataset(source, Request()), work / FOLDERS[form])
    return load_recording(done.path)
