"""One folder per plant; each says what it is in a ``FAMILY`` of its own, and is found by its name."""

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import MappingProxyType
from typing import NamedTuple

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.effects import Effect
from cable_envs.plants.base import Plant
from cable_envs.plants.family import Family


@cache
def families() -> Mapping[str, Family]:
    """Every family of plants.

    Returns
    -------
    mapping of str to Family
        By name, in the order of their folders; read-only.
    """
    folders = sorted(module.name for module in iter_modules(__path__) if module.ispkg)
    found = [import_module(f"{__name__}.{folder}").FAMILY for folder in folders]
    return MappingProxyType({family.name: family for family in found})


def family(name: str) -> Family:
    """The family of a name.

    Parameters
    ----------
    name : str
        As in rig files: "cable_hole", "pulley_circuit", "linear_drive", ...

    Returns
    -------
    Family
        What its folder says of itself.

    Raises
    ------
    ConfigurationError
        Where there is none, with the nearest name.
    """
    if name not in families():
        raise ConfigurationError(f"unknown plant '{name}'; {nearest(name, families())}")
    return families()[name]


def variants() -> tuple[str, ...]:
    """Names of the variants of all plants, each once."""
    return tuple(dict.fromkeys(variant for one in families().values() for variant in one.variants))


VERSIONS = ("v0", "v1")
"""Versions of the ids; a plant has the numbers of the last one unless another is asked for."""


DRIVES = ("ideal", "motor")
"""What may move a cable: a drive without a motor, which is what its command says, or one with all that a motor has."""


@cache
def plant_for(
    name: str, variant: str = "analytic", holes: int = 1, version: str = VERSIONS[-1], drive: str = DRIVES[0],
    contacts: int = 0,
) -> Plant:  # fmt: skip
    """The plant that simulates rigs of a family.

    Parameters
    ----------
    name : str
        A family's name: "cable_hole", "pulley_circuit", "linear_drive", ...
    variant : str
        Which simulator of it: "chain" is the circuit's chain of spans and contacts beside its closed form. A family
        without the variant gives its first one.
    holes : int
        How many holes are in series, where the family has such.
    version : str
        Version of the ids whose numbers it gives, one of `VERSIONS`: those of an older one are kept, so that its boards
        can be replayed.
    drive : str
        What moves the cable, one of `DRIVES`.
    contacts : int
        At how many places a sheath rubs, where the family has such; 0: its friction is taken all together.

    Returns
    -------
    Plant
        Its kernels are compiled on first use.

    Raises
    ------
    ConfigurationError
        Where there is no such plant, variant or version, naming the nearest, and for several holes, or contacts, where
        there are none such.

    Examples
    --------
    >>> plant_for("pulley_circuit").name
    'pulley_circuit'
    >>> plant_for("pulley_circuit", "chain").name
    'pulley_chain'
    """
    if variant not in variants():
        raise ConfigurationError(f"unknown plant variant '{variant}'; {nearest(variant, variants())}")
    found = family(name)
    if holes != 1 and not found.series:
        series = " or ".join(one.name for one in families().values() if one.series)
        raise ConfigurationError(f"'holes' belongs to {series} rigs only")
    if version not in VERSIONS:
        raise ConfigurationError(f"unknown version '{version}'; {nearest(version, VERSIONS)}")
    plant = _built_of(found, variant, holes, contacts)
    if drive not in DRIVES:
        raise ConfigurationError(f"unknown drive '{drive}'; {nearest(drive, DRIVES)}")
    if version == "v0":
        if contacts:
            raise ConfigurationError(f"contacts belong to the ids -v1: those of -v0 have one contact ({name})")
        if drive != "ideal":
            raise ConfigurationError(
                f"a drive with a motor belongs to the ids -v1: those of -v0 have ideal ones ({name})"
            )
        return found.as_v0(plant)
    if drive == "motor":
        if found.with_motor is None:
            raise ConfigurationError(f"{name} has an ideal drive only; leave out 'drive: motor'")
        return found.with_motor(plant)
    return plant


def _built_of(found: Family, variant: str, holes: int, contacts: int) -> Plant:
    if not contacts:
        return found.build(variant if variant in found.variants else found.variants[0], holes)
    if found.with_contacts is None:
        known = " or ".join(one.name for one in families().values() if one.with_contacts)
        raise ConfigurationError(f"'contacts' belongs to {known} rigs only")
    return found.with_contacts(contacts)


class _Built(NamedTuple):
    """A plant with what it was built of."""

    family: Family
    variant: str
    plant: Plant


@cache
def _built() -> Mapping[str, _Built]:
    """Every plant by its own name."""
    made = (_Built(one, form, one.build(form, 1)) for one in families().values() for form in one.variants)
    return {one.plant.name: one for one in made}


def plants_with(effect: str) -> tuple[str, ...]:
    """Names of the plants that an effect acts on.

    Parameters
    ----------
    effect : str
        Name of an effect of the library (`cable_envs.effects.EFFECTS`), or of one that a plant has for itself.

    Returns
    -------
    tuple of str
        Names of plants, each variant with its own.

    Examples
    --------
    >>> plants_with("lateral_extrusion")
    ('cable_hole',)
    """
    has = {name: plant.effects.effects.get(effect) for name, (*_, plant) in _built().items()}
    return tuple(name for name, one in has.items() if one is not None and one.parameters)


def forms_of(effect: str) -> Mapping[str, Effect]:
    """The plants on which an effect has a law or parameters of its own (`cable_envs.effects.Acting`).

    Parameters
    ----------
    effect : str
        Name of an effect of the library.

    Returns
    -------
    mapping of str to Effect
        Its form there by the name of the plant.
    """
    forms = {name: plant.effects.acting.forms for name, (*_, plant) in _built().items()}
    return {name: one for name, own in forms.items() for one in own if one.name == effect}


def family_of(plant: str) -> Family:
    """The family that a plant belongs to.

    Parameters
    ----------
    plant : str
        The plant's own name, which differs from the family's for a variant.

    Returns
    -------
    Family
        What its folder says of itself.

    Raises
    ------
    ConfigurationError
        Where there is no such plant, with the nearest name.

    Examples
    --------
    >>> family_of("pulley_chain").name
    'pulley_circuit'
    """
    return _found(plant).family


def variant_of(plant: str) -> str:
    """Which of its family's variants a plant is.

    Parameters
    ----------
    plant : str
        The plant's own name.

    Returns
    -------
    str
        As a rig file has it; "" where its family has only one.

    Raises
    ------
    ConfigurationError
        Where there is no such plant, with the nearest name.

    Examples
    --------
    >>> variant_of("pulley_chain"), variant_of("cable_hole")
    ('chain', '')
    """
    found = _found(plant)
    return found.variant if len(found.family.variants) > 1 else ""


def _found(plant: str) -> _Built:
    if plant not in _built():
        raise ConfigurationError(f"unknown plant '{plant}'; {nearest(plant, _built())}")
    return _built()[plant]


def title_of(tasks: str) -> str:
    """A family's title for people.

    Parameters
    ----------
    tasks : str
        First part of its tasks' names, as "CableHole".

    Returns
    -------
    str
        The title; ``tasks`` itself where it belongs to no family.

    Examples
    --------
    >>> title_of("CableHole")
    'Cable through a hole'
    """
    return next((one.title for one in families().values() if one.tasks == tasks), tasks)
