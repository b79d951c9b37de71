"""JSON files, plain or compressed: records of megabytes are kept as ``.json.gz``, a sixteenth of the size."""

import gzip
import json
import zlib
from pathlib import Path
from typing import Any


def read_json(path: str | Path) -> Any:
    """The content of a JSON file.

    Parameters
    ----------
    path : str or Path
        A ``.json`` file, or ``.json.gz``: by its name, what ends in ``.gz`` is compressed.

    Returns
    -------
    Any
        What ``json.loads`` makes of it.

    Raises
    ------
    OSError
        Where the file cannot be read.
    ValueError
        Where it is damaged, no text, or no JSON.
    """
    content = Path(path).read_bytes()
    if Path(path).suffix == ".gz":
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as problem:
            raise ValueError(f"damaged: {problem}") from None
    return json.loads(content)


def packed_json(value: Any) -> bytes:
    """``value`` as compressed JSON: the same value gives the same bytes. Raises ValueError for NaN and infinities."""
    return gzip.compress((json.dumps(value, indent=1, allow_nan=False) + "\n").encode(), 9, mtime=0)
