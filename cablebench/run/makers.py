"""Whose record is whose: a row of a board joins only what one maker has made, of one content.

A record's `maker` is empty where the keeper of a store made it (`cablebench evaluate`), else the key that a submission
came with. It keeps people who use the commands out of each other's rows. It is no signature: who writes into the file
of records itself can write any maker there.
"""

import hashlib
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from cable_envs.core.config import configuration_hash

Record = Mapping[str, Any]


def maker_key(phrase: str, name: str) -> str:
    """The key of a maker who knows a phrase, for one name on a board: 24 hex digits that do not tell the phrase.

    Parameters
    ----------
    phrase : str
        Known to the maker alone.
    name : str
        On the board: the same phrase gives another key for another name.

    Returns
    -------
    str

    Examples
    --------
    >>> maker_key("correct horse", "ppo") == maker_key("correct horse", "ppo") != maker_key("correct horse", "sac")
    True
    """
    return hashlib.scrypt(phrase.encode(), salt=name.encode(), n=2**14, r=8, p=1, dklen=12).hex()


def content_of(record: Record) -> str:
    """Hash of what ran: settings with the hash of the file or weights, and what it was told."""
    return configuration_hash([record.get("settings") or {}, record.get("information")])


def training_of(record: Record) -> str:
    """The same without the weights: equal for the training seeds of one agent, and for every controller."""
    if record["training_seed"] is None:
        return ""
    settings = {k: v for k, v in (record.get("settings") or {}).items() if k != "policy"}
    return configuration_hash([settings, record["information"]])


def told_apart(records: Iterable[Record], reserved: Collection[str] = ()) -> list[Record]:
    """The records, with names that belong to one maker each, and on one environment to one training.

    Parameters
    ----------
    records : iterable of mapping
        Oldest first.
    reserved : collection of str
        Names of references: only the keeper of the store has them.

    Returns
    -------
    list of mapping
        A name is the keeper's where the keeper has it, else whose record came first; on one environment it is the first
        training's. All others have their key behind the name.
    """
    given = list(records)
    owner = dict.fromkeys(reserved, "")
    for r in given:
        if not r.get("maker"):
            owner[r["entrant"]] = ""
    trainings: dict[tuple[str, str, str], str] = {}
    for r in given:
        owner.setdefault(r["entrant"], r.get("maker", ""))
        trainings.setdefault((r["entrant"], r.get("maker", ""), r["env_id"]), training_of(r))
    return [_named(r, owner, trainings) for r in given]


def _named(r: Record, owner: Mapping[str, str], trainings: Mapping[tuple[str, str, str], str]) -> Record:
    name, maker, training = r["entrant"], r.get("maker", ""), training_of(r)
    if maker != owner[name]:
        name = f"{name} (maker {maker[:6] or 'unknown'})"
    if training != trainings[(r["entrant"], maker, r["env_id"])]:
        name = f"{name} (training {training[:6] or 'none'})"
    return r if name == r["entrant"] else {**r, "entrant": name}
