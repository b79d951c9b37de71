"""``cablebench real-data``: the diagnosis of the public recordings of real rigs, as one page with figures."""

import shlex
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import require_writable
from cablebench.cli.shared.output import console
from cablebench.cli.shared.progress import stages


def real_data(
    out: Annotated[Path, typer.Option(help="Folder for index.html, figures and the numbers of each set as JSON.")],
    shared: Annotated[Path, typer.Option(help="Folder that holds the sets as published.")] = Path(
        "../shared/recordings"
    ),
    only: Annotated[list[str] | None, typer.Option(help="Run this set alone; may be repeated.")] = None,
    page_only: Annotated[bool, typer.Option("--page-only", help="Make the page again from what is there.")] = False,
) -> None:
    """Diagnose da Vinci jaw, band brake, EMPS, coupled drives and servo pendulum from naive simulators; ten minutes."""
    from cable_envs.core.files import write_atomic
    from cable_envs.diagnosis.fit.rounds import heard
    from cablebench.pages.recordings import PAGE, SUMMARY, render, summary, write_set
    from cablebench.pages.recordings_sets import SETS

    names = list(dict.fromkeys(only or SETS))
    require_known("set", names, SETS)
    if page_only and only:
        raise ConfigurationError("--page-only runs no set; leave out --only")
    if not page_only and not shared.is_dir():
        raise ConfigurationError(f"no folder {shared}; --shared names the one that holds the sets as published")
    require_writable(out)
    say = console(stderr=True)
    with tempfile.TemporaryDirectory() as work:
        for name in () if page_only else names:
            began = time.perf_counter()
            with stages() as (tell, hear), heard(hear):
                numbers, figures = SETS[name](shared, Path(work), tell)
            took = time.perf_counter() - began
            command = shlex.join(["cablebench", "real-data", "--only", name, "--out", str(out)])
            write_set(out, name, {"command": command, "seconds": round(took), **numbers}, figures)
            say.print(f"{name}: {took:.0f} s", markup=False)
    write_atomic(out / PAGE, render(out, list(SETS)))
    write_atomic(out / SUMMARY, summary(out, list(SETS)))
    say.print(f"wrote {out / PAGE} and {SUMMARY}", markup=False)
