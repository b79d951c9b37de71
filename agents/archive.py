"""What is read of a stranger's policy.zip: two entries, bounded in size, checked, and never unpickled.

Weights are read by ``torch.load(..., weights_only=True)`` from a file that is itself a zip, as torch writes it since
1.6; its sizes are looked at before anything is unpacked.
"""

import io
import json
import pickle
import stat
import warnings
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cable_envs.core.errors import ConfigurationError

WEIGHTS = "policy.pth"
LARGEST = 2**28
"""Bytes that an entry, or all tensors of it, may unpack to: 256 MiB, hundreds of times a policy of these tasks."""

LARGEST_TEXT = 2**24
"""Bytes of the metadata: a learning curve of a long training takes one hundredth of it."""

_DAMAGED = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError, KeyError)


def entry(path: Path, content: bytes, name: str, largest: int = LARGEST) -> bytes:
    """One entry of a policy's zip file.

    Parameters
    ----------
    path : Path
        What errors call the file.
    content : bytes
        Of the zip file.
    name : str
        Of the entry.
    largest : int
        Bytes that it may have.

    Returns
    -------
    bytes

    Raises
    ------
    ConfigurationError
        For what is no zip or a damaged one, without that entry, with a larger one, or with one that is twice there,
        encrypted, a link, or named so that it would be unpacked to another folder.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _check(path, archive, name, largest)
            return archive.read(name)
    except ConfigurationError:
        raise
    except _DAMAGED as error:
        raise ConfigurationError(f"{path} is no whole zip file of a policy: {_line(error)}") from None


def _check(path: Path, archive: zipfile.ZipFile, name: str, largest: int) -> None:
    names = archive.namelist()
    for info in archive.infolist():
        parts = PurePosixPath(info.filename.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or stat.S_ISLNK(info.external_attr >> 16):
            raise ConfigurationError(f"{path}: its entry {info.filename[:80]!a} leads to another place; it is not read")
        if info.file_size > largest and info.filename == name:
            raise ConfigurationError(f"{path}: {name} unpacks to {info.file_size} bytes; at most {largest} are read")
    if names.count(name) != 1:
        raise ConfigurationError(f"{path} holds {names.count(name)} entries '{name}'; a policy has one")


def mapping(path: Path, text: bytes, what: str) -> dict[str, Any]:
    """The mapping in a JSON text. Raises ConfigurationError that names the file where it is none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path}: {what} is no JSON: {_line(error)}") from None
    if not isinstance(found, dict):
        raise ConfigurationError(f"{path}: {what} must be a mapping, found {type(found).__name__}")
    return found


def weights(path: Path, content: bytes) -> dict[str, torch.Tensor]:
    """The tensors by name in a policy's zip file.

    Parameters
    ----------
    path : Path
        What errors call the file.
    content : bytes
        Of the zip file.

    Returns
    -------
    dict of str to Tensor
        On the CPU, of floating point, finite.

    Raises
    ------
    ConfigurationError
        Where there are none, something else is with them, or one is not finite.
    """
    packed = entry(path, content, WEIGHTS)
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as inner:
            size = sum(info.file_size for info in inner.infolist())
        if size > LARGEST:
            raise ConfigurationError(f"{path}: the weights unpack to {size} bytes; at most {LARGEST} are read")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a damaged file, before the error
            found = torch.load(io.BytesIO(packed), map_location="cpu", weights_only=True)
    except ConfigurationError:
        raise
    except pickle.UnpicklingError:
        raise ConfigurationError(f"{path}: {WEIGHTS} holds more than weights; it is not read") from None
    except Exception as error:  # torch says what is wrong with a file by whatever it stumbles over
        raise ConfigurationError(f"{path}: {WEIGHTS} is no file of weights: {_line(error)}") from None
    if not isinstance(found, Mapping) or not found:
        raise ConfigurationError(f"{path}: {WEIGHTS} must map names to weights, found {type(found).__name__}")
    for name, tensor in found.items():
        _check_tensor(path, name, tensor)
    return dict(found)


def _check_tensor(path: Path, name: Any, tensor: Any) -> None:
    where = f"{path}: the weights {str(name)[:80]!a}"
    if not isinstance(name, str) or not isinstance(tensor, torch.Tensor):
        raise ConfigurationError(f"{where} are no tensor but {type(tensor).__name__}")
    counter = tensor.dtype is torch.int64 and not tensor.dim()  # of steps, as batch normalisation keeps
    if tensor.layout is not torch.strided or not (tensor.is_floating_point() or counter):
        raise ConfigurationError(f"{where} are of type {tensor.dtype}; expected plain floating point")
    if tensor.numel() * tensor.element_size() > LARGEST:
        raise ConfigurationError(f"{where} are of shape {tuple(tensor.shape)}: larger than any policy")
    if not bool(torch.isfinite(tensor).all()):
        raise ConfigurationError(f"{where} are not finite")


Number = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, lt=2**63)]


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _CheckedNormalization(_Strict):
    mean: list[Number]
    variance: list[Annotated[Number, Field(ge=0.0)]]
    clip: Annotated[Number, Field(gt=0.0)]
    epsilon: Annotated[Number, Field(ge=0.0)]


class _CheckedSettings(_Strict):
    """Of `cable_envs.agents.settings.Settings` what decides how a policy acts."""

    algo: str
    env_id: str
    n_envs: Count
    n_timesteps: Count
    policy: str = ""
    policy_kwargs: dict[str, Any] = {}
    learner: dict[str, Any] = {}
    env_options: dict[str, Any] = {}
    stagger: bool = True
    smoothing: Annotated[Number, Field(ge=0.0, lt=1.0)] = 0.0
    tuning_trials: Count
    algorithm_name: str = ""
    first_frame: bool = False
    frame_stack: Annotated[int, Field(ge=1, le=1000)] = 1
    normalize: dict[str, Any] = {}
    noise_type: str = ""
    noise_std: Number = 0.0
    residual: dict[str, Any] = {}
    curriculum: dict[str, Any] = {}


class _Checked(_Strict):
    """Types and ranges of `cable_envs.agents.policy.Metadata` as it stands in a file."""

    name: Annotated[str, Field(min_length=1, max_length=100)]
    env_id: str
    seed: Count
    steps: Count
    complete: bool
    channels: list[str]
    settings: _CheckedSettings
    settings_hash: str
    versions: dict[str, str]
    curve: list[list[Number | None]] = []
    normalization: _CheckedNormalization | None = None


def check_metadata(path: Path, data: Mapping[str, Any]) -> None:
    """Check types and ranges of a policy's metadata.

    Raises ConfigurationError that names the file and the first fault.
    """
    try:
        _Checked.model_validate(data)
    except ValidationError as found:
        fault = found.errors(include_url=False)[0]
        place = ".".join(str(part) for part in fault["loc"])
        raise ConfigurationError(f"{path}: {place}: {fault['msg']}, found {ascii(fault['input'])[:60]}") from None


def check_size(path: Path, arguments: Any, depth: int = 0) -> None:
    """Refuse arguments of a network that would make a gigantic one, before it is made.

    Parameters
    ----------
    path : Path
        What errors call the file.
    arguments : Any
        ``policy_kwargs``, as deep as they are.
    depth : int
        Of the arguments within others.

    Raises
    ------
    ConfigurationError
        For a number above 4096, a list of more than 16 things, and what is deeper than 6.
    """
    nested = list(arguments.values()) if isinstance(arguments, Mapping) else arguments
    if isinstance(nested, (list, tuple)):
        if len(nested) > 16 or depth > 6:
            raise ConfigurationError(f"{path}: policy_kwargs describe a network that is larger than any policy")
        for value in nested:
            check_size(path, value, depth + 1)
    elif isinstance(nested, (int, float)) and not abs(nested) <= 4096:
        raise ConfigurationError(
            f"{path}: policy_kwargs hold {nested!r}; no layer of a policy has more than 4096 units"
        )


def _line(error: BaseException) -> str:
    text = " ".join(str(error)[:300].split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
