"""The program ``cablebench``: starts the command line and turns every expected error into one line and exit code 2."""

import errno
import os
import sys
from collections.abc import Sequence

from cable_envs.core.errors import ConfigurationError

USAGE_ERROR = 2
"""Exit code for input that cannot be used (typer's own, too)."""

THEIRS = (
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG,
    errno.ENOTDIR, errno.EISDIR, errno.EIO, errno.ELOOP,
)  # fmt: skip
"""System errors that say something of the disk or of a name that was given, and nothing of the program."""

EXTRAS = {
    **dict.fromkeys(("typer", "rich", "jinja2", "markupsafe", "markdown_it", "matplotlib", "PIL"), "bench"),
    **dict.fromkeys(("pydantic", "filelock"), "bench"),
    **dict.fromkeys(("torch", "stable_baselines3", "sb3_contrib", "tensorboard"), "agents"),
    **dict.fromkeys(("optuna", "sqlalchemy"), "tuning"),
    "ray": "ray",
    "cma": "identification",
    **dict.fromkeys(("pysindy", "sklearn"), "proof"),
    "pyarrow": "parquet",
    **dict.fromkeys(("minari", "h5py"), "offline"),
    "imageio_ffmpeg": "video",
    "rosbags": "ros",
    "asammdf": "mdf",
    **dict.fromkeys(("mcap", "mcap_protobuf", "mcap_ros2"), "mcap"),
}
"""Module that may be missing -> the extra that brings it."""

CPU_BUILD = (
    "--extra-index-url https://download.pytorch.org/whl/cpu ",
    " (this index has torch's build for CPUs; without it pip fetches gigabytes of CUDA)",
)
"""What the command for the extra that brings torch has besides, and why."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``cablebench``; ``arguments`` default to those of the process. Ends by SystemExit."""
    try:
        from cablebench.cli.app import app
        from cablebench.cli.shared.output import remarks_shown
        from cablebench.cli.shared.trust import asking

        with remarks_shown(), asking():
            app(args=None if arguments is None else list(arguments), prog_name="cablebench")
    except ConfigurationError as error:
        _stop(str(error))
    except OSError as error:
        if error.errno not in THEIRS:
            raise
        _stop(f"{error.filename or 'writing'}: {os.strerror(error.errno)}")
    except ImportError as error:
        hint = missing_extra(error)
        if hint is None:
            raise
        _stop(hint)


def missing_extra(error: ImportError) -> str | None:
    """How to install what is missing, in one line; None where no extra would bring it (then it is a defect)."""
    if "pip install 'cable-envs[" in str(error):
        return str(error)
    module = (error.name or "").split(".")[0]
    if isinstance(error, ModuleNotFoundError) and module in EXTRAS:
        extra = EXTRAS[module]
        index, why = CPU_BUILD if extra == "agents" else ("", "")
        return f"this command needs {module}: pip install {index}'cable-envs[{extra}]'{why}"
    return None


def _stop(message: str) -> None:
    print(f"cablebench: error: {message}", file=sys.stderr)
    raise SystemExit(USAGE_ERROR) from None
