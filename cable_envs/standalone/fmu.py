"""A rig as a functional mock-up unit for co-simulation (FMI 3.0): an archive with its C sources and a compiled library.

Source: Functional Mock-up Interface Specification 3.0 (Modelica Association, 2022), sections 2.4
(modelDescription.xml), 2.5 (archive, buildDescription.xml), 4 (co-simulation).
"""

import hashlib
import io
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from cable_envs.core.errors import ConfigurationError
from cable_envs.standalone.c_files import FLAGS, c_files
from cable_envs.standalone.c_values import number, safe
from cable_envs.standalone.law import Law
from cable_envs.standalone.units import base_units

WRAPPER = Path(__file__).with_name("fmi3.c.txt")
"""The functions of the interface around the rig's own; the names in capitals are filled in."""

COMPILERS = ("cc", "gcc", "clang")
"""Names of C compilers, unless the environment variable CC says another one."""

LONGEST = 120.0
"""Seconds after which a compiler is given up."""

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The date of every file in the archive, so that the same rig gives the same archive."""


@dataclass(frozen=True)
class Variable:
    """A variable of the unit; ``place`` is where it is in C, or its value where it is a constant."""

    name: str
    causality: str
    unit: str
    meaning: str
    place: str
    start: float | None = None


def fmu(law: Law) -> bytes:
    """A rig as a functional mock-up unit.

    Parameters
    ----------
    law : Law
        The rig.

    Returns
    -------
    bytes
        The archive.

    Raises
    ------
    ConfigurationError
        Where there is no C compiler, or it fails.
    """
    sources = {**c_files(law), "fmi3.c": _wrapper(law)}
    folder, ending = platform_of()
    files: dict[str, str | bytes] = {
        "modelDescription.xml": model_description(law),
        "sources/buildDescription.xml": _build_description(law),
        **{f"sources/{name}": text for name, text in sources.items()},
        f"binaries/{folder}/{law.name}{ending}": compiled(sources, ending),
    }
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            packed.writestr(info, content)
    return archive.getvalue()


def platform_of() -> tuple[str, str]:
    """Folder of the libraries of this platform in an archive, as "x86_64-linux", and the ending of their names."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system, ending = {"darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}.get(sys.platform, ("linux", ".so"))
    return f"{machine}-{system}", ending


def compiler() -> str:
    """The C compiler of this machine; ConfigurationError where there is none."""
    asked = os.environ.get("CC", "")
    for name in (asked,) if asked else COMPILERS:
        found = shutil.which(name)
        if found:
            return found
    tried = f"the environment variable CC names '{asked}'" if asked else f"none of {', '.join(COMPILERS)} was found"
    raise ConfigurationError(f"an FMU needs a C compiler, and {tried}; install one (gcc), or export --format c")


def compiled(sources: dict[str, str], ending: str) -> bytes:
    """A shared library of C sources.

    Parameters
    ----------
    sources : dict of str to str
        Name of the file -> text.
    ending : str
        Ending of a library's name.

    Returns
    -------
    bytes
        The library.

    Raises
    ------
    ConfigurationError
        With what the compiler says.
    """
    program = compiler()
    with tempfile.TemporaryDirectory() as where:
        folder = Path(where)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        code = [name for name in sources if name.endswith(".c")]
        command = [program, *FLAGS, "-fPIC", "-shared", "-s", "-o", f"rig{ending}", *code, "-lm"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=LONGEST)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ConfigurationError(f"the C compiler {program} failed: {error}") from error
        if done.returncode:
            raise ConfigurationError(f"the C compiler {program} failed: {done.stderr.strip()[:500]}")
        return (folder / f"rig{ending}").read_bytes()


def variables(law: Law) -> list[Variable]:
    """The variables of the unit, in the order of their value references."""
    found = [Variable("time", "independent", "s", "simulated time", "c->time")]
    start = {"second": law.second}
    for one in law.inputs:
        value = start.get(one.name, 0.0)
        found.append(Variable(one.name, "input", one.unit, one.meaning, f"c->rig.inputs.{one.name}", value))
    for one in law.outputs:
        field, k = law.places[one.name]
        place = f"c->rig.signals.{safe(field)}" + (f"[{k}]" if k >= 0 else "")
        found.append(Variable(one.name, "output", one.unit, one.meaning, place))
    units = {one.name: one.unit for one in law.outputs}
    for sensor in law.sensors:
        meaning, name = f"what the sensor of {sensor.signal} shows", f"shown_{sensor.signal}"
        found.append(Variable(name, "output", units[sensor.signal], meaning, f"c->rig.shown.{sensor.signal}"))
    for name, value, unit, meaning in law.parameters:
        known = name.replace(".", "_")
        found.append(Variable(f"rig_{known}", "local", unit, meaning, number(value), value))
    return found


def token(law: Law) -> str:
    """What tells one unit from another."""
    digest = hashlib.sha256("".join(c_files(law).values()).encode()).hexdigest()
    return f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"


def model_description(law: Law) -> str:
    """The text of ``modelDescription.xml``."""
    known = variables(law)
    units = list(dict.fromkeys(v.unit for v in known))
    about = " ".join((law.rig.description or law.plant.name).split())
    period = number(law.period)
    shown = [k for k, v in enumerate(known) if v.causality == "output"]
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(law.rig.name)} instantiationToken="{token(law)}"',
        f'  description={quoteattr(about)} generationTool="cablebench export-rig" variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{law.name}" canHandleVariableCommunicationStepSize="true"',
        f'    fixedInternalStepSize="{period}" canGetAndSetFMUState="true"/>',
        "  <UnitDefinitions>", *(_unit(unit) for unit in units), "  </UnitDefinitions>",
        f'  <DefaultExperiment startTime="0" stopTime="{number(200 * law.period)}" stepSize="{period}"/>',
        "  <ModelVariables>", *(_variable(k, v) for k, v in enumerate(known)), "  </ModelVariables>",
        "  <ModelStructure>",
        *(f'    <Output valueReference="{k}"/>' for k in shown),
        *(f'    <InitialUnknown valueReference="{k}"/>' for k in shown),
        "  </ModelStructure>", "</fmiModelDescription>", "",
    ])  # fmt: skip


def _unit(unit: str) -> str:
    base = base_units(unit)
    inner = " ".join(f'{name}="{power}"' for name, power in base.items())
    return (
        f"    <Unit name={quoteattr(unit)}><BaseUnit {inner}/></Unit>"
        if inner
        else f"    <Unit name={quoteattr(unit)}/>"
    )


_VARIABILITY = {"local": "constant", "input": "discrete", "output": "discrete", "independent": "continuous"}


def _variable(k: int, one: Variable) -> str:
    start = "" if one.start is None else f' start="{number(one.start)}"'
    return (
        f'    <Float64 name="{one.name}" valueReference="{k}" causality="{one.causality}" '
        f'variability="{_VARIABILITY[one.causality]}" unit={quoteattr(one.unit)} '
        f"description={quoteattr(one.meaning)}{start}/>"
    )


def _build_description(law: Law) -> str:
    options = " ".join(FLAGS)
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>', '<fmiBuildDescription fmiVersion="3.0">',
        f'  <BuildConfiguration modelIdentifier="{law.name}">',
        f'    <SourceFileSet language="C99" compilerOptions="{options}">',
        f'      <SourceFile name="{law.name}.c"/>', '      <SourceFile name="fmi3.c"/>',
        "    </SourceFileSet>", "  </BuildConfiguration>", "</fmiBuildDescription>", "",
    ])  # fmt: skip


def _wrapper(law: Law) -> str:
    known = variables(law)
    got = [f"    case {k}: *value = {v.place}; return 1;" for k, v in enumerate(known)]
    put = [f"    case {k}: {v.place} = value; return 1;" for k, v in enumerate(known) if v.causality == "input"]
    filled = {
        "NAME": law.name, "TOKEN": token(law), "PERIOD": number(law.period), "GET_CASES": "\n".join(got),
        "SET_CASES": "\n".join(put),
    }  # fmt: skip
    text = WRAPPER.read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: filled[found[1]], text)
