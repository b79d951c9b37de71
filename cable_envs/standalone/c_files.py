"""A rig as one C99 file and its header."""

import textwrap
from collections.abc import Mapping
from typing import Any

from cable_envs.core.inputs import INPUTS
from cable_envs.standalone.c_text import functions_in_c
from cable_envs.standalone.c_values import number, safe
from cable_envs.standalone.law import Law
from cable_envs.standalone.program import TILES, TOP, Program
from cable_envs.standalone.types import fields_used

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Options of a compiler with which the numbers are those of the simulator to the bit."""


def c_files(law: Law) -> dict[str, str]:
    """A rig in C.

    Parameters
    ----------
    law : Law
        The rig.

    Returns
    -------
    dict of str to str
        Name of the file -> its text: the header, and the source.
    """
    program = law.program(())
    return {f"{law.name}.h": _header(law, program), f"{law.name}.c": _source(law, program)}


def _header(law: Law, program: Program) -> str:
    name = law.name
    inputs = [f"double {one.name}; /* {one.unit}: {one.meaning} */" for one in law.inputs]
    shown = [f"double {s.signal};" for s in law.sensors] or ["char none; /* no sensor has an effect */"]
    return "\n".join([
        f"/* {law.rig.name}: {_comment(law.rig.description or law.plant.name)}",
        "",
        "   Written by `cablebench export-rig`. All numbers are SI.",
        "",
        f"       {name}_mechanism rig;",
        f"       {name}_start(&rig);",
        "       for (;;) {",
        f"           rig.inputs.{law.inputs[0].name} = ...;",
        f"           {name}_step(&rig);                 one control step of {law.period:g} s",
        f"           ... rig.signals.{next(iter(law.values['signals']))} ...",
        "       }",
        "",
        f"   Compile with {' '.join(FLAGS)}, and link the mathematical library (-lm). */",
        f"#ifndef {name.upper()}_H", f"#define {name.upper()}_H",
        "#include <stdint.h>", "#ifdef __cplusplus", 'extern "C" {', "#endif",
        f"#define {name.upper()}_PERIOD {number(law.period)} /* s, control step */",
        "", "/* what it is told */", "typedef struct {", *_indented(inputs), f"}} {name}_inputs;",
        "", "/* what it shows: true values */", "typedef struct {",
        *_indented(_signal_lines(law)), f"}} {name}_signals;",
        "", "/* what sensors show that have an effect */", "typedef struct {", *_indented(shown), f"}} {name}_shown;",
        "", "/* what effects remember */", "typedef struct {",
        *_indented(_members(law.values["states"], _states(program)) or ["char none;"]), f"}} {name}_states;",
        "", "/* a mechanism; a copy of it is another one in the same state */", "typedef struct {",
        *_indented([
            f"{name}_inputs inputs;", f"{name}_signals signals;", f"{name}_shown shown;", f"{name}_states states;",
            f"{name}_inputs before; /* inputs of the step before */", "int64_t steps; /* since the start */",
            *([f"double kept[{_kept(law)}]; /* what late sensors have yet to show */"] if _kept(law) else []),
        ]),
        f"}} {name}_mechanism;",
        "", f"void {name}_start({name}_mechanism *rig); /* at rest with the output at {law.start:g} */",
        f"void {name}_step({name}_mechanism *rig);",
        "#ifdef __cplusplus", "}", "#endif", "#endif", "",
    ])  # fmt: skip


def _signal_lines(law: Law) -> list[str]:
    lines, entries = [], {one.name: one for one in law.outputs}
    groups: dict[str, list[str]] = {}
    for signal, (field, _) in law.places.items():
        groups.setdefault(field, []).append(signal)
    for field, signals in groups.items():
        first = entries[signals[0]]
        many = f"[{len(signals)}]" if isinstance(law.values["signals"][field], list) else ""
        lines.append(f"double {safe(field)}{many}; /* {first.unit}: {_comment(first.meaning)} */")
    return lines


def _states(program: Program) -> list[str]:
    return fields_used(program).get("states", [])


def _kept(law: Law) -> int:
    return sum(slots(sensor.late) for sensor in law.sensors if sensor.late > 0.0)


def slots(late: float) -> int:
    """Samples that a sensor with this delay, in control steps, must keep."""
    return int(late) + 2


def _source(law: Law, program: Program) -> str:
    name, used = law.name, fields_used(program)
    records = []
    for record in used:
        if record in ("signals", "states"):
            records.append(f"typedef {name}_{record} {record}_t;")
        else:
            wanted = list(INPUTS.names) if record == "inputs" else used[record]
            records.append(
                f"typedef struct {{ {' '.join(_members(_sizes(law, program, record), wanted))} }} {record}_t;"
            )
    data = [_constant(record, law.values[record], used[record]) for record in ("rig", "effects") if used.get(record)]
    parameters = [f"   {n} = {value!r} {unit}: {_comment(m)}" for n, value, unit, m in law.parameters]
    return "\n".join([
        f"/* {law.rig.name}: see {name}.h. Written by `cablebench export-rig`.", "",
        "   Parameters of the rig, SI. The numbers below are derived from them: to change one, export the rig again.",
        "",
        *parameters, "*/",
        "#include <math.h>", "#include <stdint.h>", "#include <string.h>", f'#include "{name}.h"', "",
        *records, "", functions_in_c(program), *data, "",
        _start(law, used), "", *([_sensors(law), ""] if law.sensors else []), _step(law, program), "",
    ])  # fmt: skip


def _sizes(law: Law, program: Program, record: str) -> Mapping[str, Any]:
    if record in law.values:
        return law.values[record]
    letter = {"inputs": "u", "scratch": "w", "control": "g"}[record]
    rows = INPUTS.zeros(1) if letter == "u" else program.records[letter].zeros(1)
    return {n: [0.0] * len(v) if v.ndim == 2 else 0.0 for n, v in zip(rows._fields, rows, strict=True) if n != "rows"}


def _members(values: Mapping[str, Any], wanted: list[str]) -> list[str]:
    sizes = {n: f"[{len(values[n])}]" if isinstance(values[n], list) else "" for n in wanted}
    return [f"double {safe(n)}{many};" for n, many in sizes.items()]


def _literal(value: Any) -> str:
    return f"{{{', '.join(map(number, value))}}}" if isinstance(value, list) else number(value)


def _constant(record: str, values: Mapping[str, Any], wanted: list[str]) -> str:
    lines = [f"    .{safe(n)} = {_literal(values[n])}," for n in wanted]
    return "\n".join([f"static const {record}_t {record}_values = {{", *lines, "};"])


def _start(law: Law, used: Mapping[str, list[str]]) -> str:
    lines = ["memset(rig, 0, sizeof *rig);"]
    for record in ("signals", "states"):
        for field in law.values[record] if record == "signals" else used.get(record, []):
            value = law.values[record][field]
            for k, one in enumerate(value if isinstance(value, list) else [value]):
                if one != 0.0:
                    index = f"[{k}]" if isinstance(value, list) else ""
                    lines.append(f"rig->{record}.{safe(field)}{index} = {number(one)};")
    if law.second:
        lines.append(f"rig->inputs.second = {number(law.second)};")
    if law.sensors:
        lines.append("show(rig);")
    ahead = f"static void show({law.name}_mechanism *rig);\n\n" if law.sensors else ""
    return ahead + f"void {law.name}_start({law.name}_mechanism *rig)\n{{\n" + "\n".join(_indented(lines)) + "\n}"


def _sensors(law: Law) -> str:
    lines, first = ["double value;"], 0
    for one in law.sensors:
        field, k = law.places[one.signal]
        place = f"rig->signals.{safe(field)}" + (f"[{k}]" if k >= 0 else "")
        lines.append(f"value = {place} * {number(one.scale)} + {number(one.bias)};")
        lines.append(f"value = value - {number(one.cut)} * smaller(value, 0.0);")
        if one.late > 0.0:
            lines.append(
                f"value = late(rig->kept + {first}, {slots(one.late)}, rig->steps, {number(one.late)}, value);"
            )
            first += slots(one.late)
        lines.append(f"rig->shown.{one.signal} = value;")
    delay = textwrap.dedent("""\
        /* A sample n steps after the start as a sensor shows it that is late by some steps; kept: samples before. */
        static double late(double *kept, int64_t slots, int64_t n, double steps, double value)
        {
            const double at = larger((double)n - steps, 0.0);
            const int64_t before = (int64_t)at, after = before + 1 < n ? before + 1 : n;
            kept[n % slots] = value;
            return kept[before % slots] + (at - (double)before) * (kept[after % slots] - kept[before % slots]);
        }

        """)
    body = f"static void show({law.name}_mechanism *rig)\n{{\n" + "\n".join(_indented(lines)) + "\n}"
    return (delay if any(s.late > 0.0 for s in law.sensors) else "") + body


def _step(law: Law, program: Program) -> str:
    given = {one.name for one in law.inputs}
    period = number(law.period)
    used = fields_used(program)
    made = next(m for m in program.functions if m.node.name == TOP)
    fresh = ["inputs", *(TILES[t] for t in ("w", "g") if t in made.tiles)]
    lines = [f"{record}_t {record};" for record in fresh]
    lines += [f"{r}_t {r}_now = {r}_values;" for r in ("rig", "effects") if used.get(r)]
    lines += [f"memset(&{record}, 0, sizeof {record});" for record in fresh]
    lines += [f"inputs.{one.name} = rig->inputs.{one.name};" for one in law.inputs]
    for name in ("command", "second"):
        if name in given and f"{name}_rate" not in given:
            lines.append(
                f"inputs.{name}_rate = rig->steps > 0 ? (rig->inputs.{name} - rig->before.{name}) / {period} : 0.0;"
            )
    lines += [f"inputs.mode = {number(law.mode)};", "rig->before = rig->inputs;"]
    where = {
        "x": "&rig->signals", "s": "&rig->states", "u": "&inputs", "w": "&scratch", "g": "&control",
        "p": "&rig_now", "e": "&effects_now",
    }  # fmt: skip
    records = ", ".join(where[t] for t in made.tiles)
    lines.append(f"{TOP}({records}, {law.substeps}, {number(law.period / law.substeps)});")
    lines.append("rig->steps++;")
    if law.sensors:
        lines.append("show(rig);")
    return f"void {law.name}_step({law.name}_mechanism *rig)\n{{\n" + "\n".join(_indented(lines)) + "\n}"


def _indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _comment(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")
