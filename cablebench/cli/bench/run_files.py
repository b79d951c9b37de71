"""What ``cablebench run`` writes: an episode's data as CSV or NPZ, its pictures as PNG, GIF or MP4."""

import io
import json
import tempfile
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError, nearest

DATA_FORMATS = (".npz", ".csv")
PICTURE_FORMATS = (".png", ".gif", ".mp4")

FRAMES_PER_SECOND = {".gif": 10, ".mp4": 25}
"""of an animation, in simulated time, which passes as real time does"""


class Film:
    """Pictures for one file: of a still the last one counts, a video is encoded while it comes."""

    def __init__(self, suffix: str):
        self._suffix, self._images, self._writer = suffix, [], None  # type: str, list[Any], Any
        if suffix == ".mp4":
            import imageio_ffmpeg  # says before the episode what is missing

            self._folder = tempfile.TemporaryDirectory(prefix="cablebench-")
            self._file = Path(self._folder.name) / "film.mp4"
            self._ffmpeg = imageio_ffmpeg

    def append(self, frame: Any) -> None:
        """The next picture: uint8 [height, width, 3]."""
        if self._suffix != ".mp4":
            if self._suffix == ".png":
                self._images.clear()
            self._images.append(frame)
            return
        if self._writer is None:
            size = frame.shape[1], frame.shape[0]
            self._writer = self._ffmpeg.write_frames(
                str(self._file), size, fps=FRAMES_PER_SECOND[".mp4"], quality=7, ffmpeg_log_level="error"
            )
            self._writer.send(None)
        self._writer.send(frame.tobytes())

    def content(self) -> bytes:
        """The file; nothing can be appended after."""
        if self._suffix != ".mp4":
            return _picture(self._images, self._suffix)
        self._writer.close()
        with self._folder:
            return self._file.read_bytes()


def check_suffix(path: Path | None, known: tuple[str, ...], flag: str) -> None:
    """ConfigurationError where a file is asked for in a format that is none."""
    if path is not None and path.suffix not in known:
        raise ConfigurationError(f"{flag} {path}: unknown format '{path.suffix}'; {nearest(path.suffix, known)}")


def contents(episode: Any, save: Path | None, render: Path | None, film: Any) -> list[tuple[Path, bytes]]:
    """(path, content) of every file that is asked for."""
    files = []
    if save is not None:
        files.append((save, (_npz if save.suffix == ".npz" else _csv)(episode)))
    if render is not None:
        files.append((render, film.content()))
    return files


def write(path: Path, content: bytes) -> Path:
    """Write the file whole or not at all; ConfigurationError where it cannot be written."""
    from cable_envs.core.files import write_atomic

    try:
        return write_atomic(path, content)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror or error}") from error


def _columns(episode: Any) -> dict[str, Any]:
    """Arrays of the episode by "name [unit]"."""
    import gymnasium as gym

    units = _signal_units(gym.spec(episode.settings["env_id"]).kwargs["task"])
    y, u = episode.output_unit, episode.command_unit
    own = {"time": "s", "reference": y, "output": y, "command": u, "reward": "1", "inference": "s"}
    columns = {f"{name} [{unit}]": getattr(episode, name) for name, unit in own.items()}
    return columns | {f"{name} [{units.get(name, '1')}]": values for name, values in episode.signals.items()}


def _signal_units(task: str) -> dict[str, str]:
    from cable_envs.sim.setup import make_setup

    return {s.name: s.unit for s in make_setup(task, "step").plant.signals}


def _csv(episode: Any) -> bytes:
    """One row for each control step; the first line holds names with units."""
    columns = _columns(episode)
    lines = [",".join(columns)]
    lines += [",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True)]
    return ("\n".join(lines) + "\n").encode()


def _npz(episode: Any) -> bytes:
    """Arrays by name, and under "about" what produced them as JSON, units included."""
    import numpy as np

    from cable_envs.core.files import jsonable

    named = {key.split(" [")[0]: (key.split(" [")[1][:-1], values) for key, values in _columns(episode).items()}
    about = {**episode.settings, "units": {name: unit for name, (unit, _) in named.items()}}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, about=json.dumps(jsonable(about)), **{name: values for name, (_, values) in named.items()}
    )
    return buffer.getvalue()


def _picture(film: list[Any], suffix: str) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    images = [Image.fromarray(frame) for frame in film]
    if suffix == ".png":
        images[-1].save(buffer, "PNG")
    else:
        images = [image.convert("P", palette=Image.Palette.ADAPTIVE, colors=64) for image in images]
        images[0].save(
            buffer, "GIF", save_all=True, append_images=images[1:], duration=1000 // FRAMES_PER_SECOND[suffix], loop=0
        )
    return buffer.getvalue()
