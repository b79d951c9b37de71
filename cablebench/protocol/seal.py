"""Sealed exams: test episodes drawn from a secret, so that nobody can simulate them before the deadline.

Who holds an exam draws a secret of 256 random bits and publishes its SHA-256, the commitment, in the protocol. Test
seeds are HMAC-SHA256 of the secret over the protocol's hash and a number. After the deadline the secret is published:
everybody can check it against the commitment, and run every episode again.
"""

import hashlib
import hmac
import re
import secrets
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, islice
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError

SECRET_BYTES = 32
"""Bytes of a secret: as many as can be guessed neither from the commitment nor from the seeds."""

_LOWEST = 2**62
"""Seeds lie from here to below 2^63, far from those of any training."""


def draw_secret() -> str:
    """A new secret: 64 hexadecimal digits from the system's source of randomness."""
    return secrets.token_hex(SECRET_BYTES)


def commitment(secret: str) -> str:
    """What is published before: the SHA-256 of the secret's file, as ``sha256sum FILE`` prints it.

    Parameters
    ----------
    secret : str
        64 hexadecimal digits; the file has a line's end behind them.

    Returns
    -------
    str
        64 hexadecimal digits.

    Examples
    --------
    >>> commitment("0" * 64)[:12]
    '827d096d92f3'
    """
    return hashlib.sha256(f"{secret}\n".encode()).hexdigest()


def read_secret(path: str | Path) -> str:
    """The secret in a file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    ConfigurationError
        Where the file cannot be read or holds no secret.
    """
    try:
        text = Path(path).read_bytes()[:1000].decode("ascii", errors="replace").strip()
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror or error}") from None
    if not re.fullmatch(r"[0-9a-f]{64}", text):
        raise ConfigurationError(f"{path}: expected the secret of `cablebench seal`, 64 hexadecimal digits")
    return text


def opened(protocol: Any, path: str | Path) -> Any:
    """A sealed protocol with the secret in a file, so that its test episodes can be run.

    Parameters
    ----------
    protocol : Protocol
        With a seal.
    path : str or Path
        File of the secret.

    Returns
    -------
    Protocol

    Raises
    ------
    ConfigurationError
        Where the protocol is not sealed, or with another secret.
    """
    secret = read_secret(path)
    if not protocol.seal:
        raise ConfigurationError(f"'{protocol.name}' is not sealed: a secret belongs to an exam of `cablebench seal`")
    if not hmac.compare_digest(commitment(secret), protocol.seal):
        raise ConfigurationError(
            f"{path} is not the secret of '{protocol.name}': its SHA-256 is {commitment(secret)[:12]}, "
            f"the seal is {protocol.seal[:12]}"
        )
    return replace(protocol, secret=secret)


def drawn_seeds(secret: str, about: str, number: int, taken: Callable[[int], bool]) -> tuple[int, ...]:
    """Seeds that only the secret tells, all different.

    Parameters
    ----------
    secret : str
        64 hexadecimal digits.
    about : str
        What else they depend on: hash of the protocol.
    number : int
        How many; the first of more are the same.
    taken : callable
        Whether a seed belongs to somebody else, as to the training; such a one is passed over.

    Returns
    -------
    tuple of int
        From 2^62 to below 2^63.
    """
    key = bytes.fromhex(secret)

    def draws() -> Iterator[int]:
        seen: set[int] = set()
        for index in count():
            digest = hmac.digest(key, f"cable-seal/1 {about} {index}".encode(), "sha256")
            seed = _LOWEST + int.from_bytes(digest[:8], "big") % _LOWEST
            if seed not in seen and not taken(seed):
                seen.add(seed)
                yield seed

    return tuple(islice(draws(), number))
