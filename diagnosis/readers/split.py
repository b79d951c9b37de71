"""Which records are imported and which are held out: by name or by condition."""

import fnmatch
import re
from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.diagnosis.readers.base import RecordSpec

_CONDITION = re.compile(r"(\w+)\s*(<=|>=|!=|=|<|>)\s*(.+)")
_COMPARE = {
    "=": lambda a, b: a == b, "!=": lambda a, b: a != b, "<": lambda a, b: a < b, ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b,
}  # fmt: skip


def plain(value: Any) -> float | str:
    """A condition's value as it is written, without its unit."""
    value = value["value"] if isinstance(value, Mapping) else value
    return value if isinstance(value, str) else float(value)


def matches(record: RecordSpec, rule: str) -> bool:
    """Whether a rule holds for a record: ``NAME=VALUE`` (or <, <=, >, >=, !=) of a condition, or a pattern of names."""
    found = _CONDITION.fullmatch(rule.strip())
    if not found:
        return any(fnmatch.fnmatchcase(name, rule) for name in (record.name, record.file))
    name, operator, text = found.groups()
    if name not in record.conditions:
        raise ConfigurationError(f"'{rule}': record {record.name} has no condition '{name}'; "
                                 f"{nearest(name, record.conditions)}")  # fmt: skip
    value = plain(record.conditions[name])
    try:
        wanted: float | str = text if isinstance(value, str) else float(text)
    except ValueError:
        raise ConfigurationError(f"'{rule}': {name} is a number, '{text}' is none") from None
    return bool(_COMPARE[operator](value, wanted))


def select(records: Sequence[RecordSpec], rules: Sequence[str], flag: str) -> list[RecordSpec]:
    """Records for which any of the rules holds. Raises ConfigurationError for a rule that holds for none."""
    for rule in rules:
        if not any(matches(record, rule) for record in records):
            raise ConfigurationError(f"{flag} '{rule}' fits no record; there are {', '.join(r.name for r in records)}")
    return [record for record in records if any(matches(record, rule) for rule in rules)]
