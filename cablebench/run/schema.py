"""What a record of a results store must hold before anything is computed with it: the fields, their types and ranges.

A store may hold what strangers have sent. A record that passes has every field that a board reads, of its type, with
finite numbers, and texts that are one printable line.
"""

from collections.abc import Mapping
from functools import cache, partial
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from cablebench.entrants.entrant import BUDGETS, IN_NAMES, INFORMATION, is_name
from cablebench.protocol.protocol import Task

SCHEMA = 1
"""Version of the record format; a record of a newer one is left out, not misread."""


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise ValueError("expected one line of printable characters")
    return text


def _one_of(known: tuple[str, ...], text: str) -> str:
    if text not in known:
        raise ValueError(f"expected one of {', '.join(known)}")
    return text


def _a_name(text: str) -> str:
    if not is_name(text):
        raise ValueError("expected a name of letters, digits and " + IN_NAMES)
    return text


Text = Annotated[str, Field(max_length=500), AfterValidator(_one_line)]
Name = Annotated[Text, Field(min_length=1, max_length=100)]
Command = Annotated[str, Field(max_length=20_000), AfterValidator(_one_line)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(allow_inf_nan=False, ge=0.0)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
Run = Annotated[str, Field(pattern=r"^[\w.=-]{1,200}$")]
"""key of a run: it names a file of trajectories, so it must not lead to another folder"""


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")


class _Metrics(_Strict):
    __pydantic_extra__: dict[str, Number | None]
    rmse: Positive | None
    failed: Annotated[float, Field(ge=0.0, le=1.0)]

    @model_validator(mode="after")
    def _has_an_error(self) -> "_Metrics":
        if self.rmse is None and not self.failed:
            raise ValueError("a completed episode needs an rmse")
        return self


class _Record(_Strict):
    schema_: Annotated[int, Field(alias="schema", ge=1, le=SCHEMA)]
    protocol: Text = ""
    protocol_version: int = 1
    protocol_hash: Name
    run: Run
    env_id: Name
    task: Name
    family: Name
    track: Name
    sweep: Name | None = None
    sweep_value: Number | None = None
    sweep_unit: Text = "1"
    entrant: Annotated[Name, AfterValidator(_a_name)]
    information: Annotated[str, AfterValidator(partial(_one_of, INFORMATION))]
    training_seed: Seed | None
    seed: Seed
    options: dict[str, Any] = {}
    settings: dict[str, Any] = {}
    charged: dict[Annotated[str, AfterValidator(partial(_one_of, BUDGETS))], Positive]
    versions: dict[Text, Text]
    replay: Command
    output_unit: Text
    command_unit: Text
    metrics: _Metrics
    machine: Text = ""
    created: Text = ""
    maker: Annotated[str, Field(pattern=r"^[0-9a-f]{0,64}$")] = ""
    sandbox: Text = ""
    seal: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""

    @model_validator(mode="after")
    def _is_of_one_piece(self) -> "_Record":
        task = Task(self.env_id)
        if (self.task, self.family) != (task.short, task.family):
            raise ValueError(f"task {self.task!r} of {self.family!r} is not that of {self.env_id!r}")
        if (self.sweep is None) != (self.sweep_value is None):
            raise ValueError("sweep and sweep_value belong together")
        return self


@cache
def _adapter() -> TypeAdapter[_Record]:
    return TypeAdapter(_Record)


def wrong_with(record: Any) -> str:
    """What is wrong with a record.

    Parameters
    ----------
    record : Any
        As read from a line of a store, "schema" included.

    Returns
    -------
    str
        The first fault and how many more there are, in one line; empty where it can be used.

    Examples
    --------
    >>> wrong_with([1, 2])
    'not a whole record'
    >>> wrong_with({"schema": 99})
    'schema 99; this version reads up to 1: upgrade cable-envs'
    """
    if not isinstance(record, Mapping):
        return "not a whole record"
    version = record.get("schema")
    if isinstance(version, int) and version > SCHEMA:
        return f"schema {version}; this version reads up to {SCHEMA}: upgrade cable-envs"
    try:
        _adapter().validate_python(record)
    except ValidationError as found:
        faults = found.errors(include_url=False)
        place = ".".join(str(part) for part in faults[0]["loc"] if part != "[key]")
        text = faults[0]["msg"].removeprefix("Value error, ")
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        given = "" if faults[0]["type"] in ("missing", "value_error") else f", found {_short(faults[0]['input'])}"
        return f"{place + ': ' if place else ''}{text[:1].lower()}{text[1:]}{given}{more}"
    except (OverflowError, RecursionError) as error:
        return f"cannot be read: {error}"
    return ""


def _short(value: Any) -> str:
    text = ascii(value)
    return text if len(text) <= 40 else f"{text[:40]} and so on"
