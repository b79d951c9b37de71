"""A user's own effect, from a file: compiled into a copy of the plant's kernel on first use, and then found on disk.

The file defines ``EFFECT``, an `Effect` like the canonical ones, with plain functions of numbers as hooks; the values
of its parameters follow in their order:

seam    | hook                                  | gives
------- | ------------------------------------- | -----------------------------------------------------------------
actuate | f(command, *numbers)                  | the command that acts
cable   | f(tension, *numbers)                  | the tension (N; closed-form circuit: N m) that the law before gives
contact | f(speed, tension, *numbers)           | what the hole's friction coefficient has more (cable_hole)
load    | f(position, velocity, tension, *n)    | force or torque on the load or output against positive motion

A cubic spring to ground, which pushes the slide of a drive back:

    from cable_envs.effects import Effect, EffectParameter

    def spring(position, velocity, tension, stiffness):
        return stiffness * position**3

    EFFECT = Effect(
        name="cubic_spring", seam="load", equation="F = -stiffness y^3", source="Duffing 1918",
        parameters=(EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e8, "spring to ground", typical=5e3),),
        plants=("linear_drive",), validity="any travel", experiment="Hold at eight positions", hooks={"load": spring},
    )

They may use arithmetic, comparisons, ``abs``, ``min``, ``max``, the functions of `math` and those of
`cable_envs.core.kernels`. A load is integrated linearly implicitly with slopes from differences, so it may be stiff.
"""

import inspect
from dataclasses import replace
from functools import cache
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import run_python
from cable_envs.effects import EFFECTS, Effect, Layout
from cable_envs.effects.own import ARGUMENTS
from cable_envs.plants.base import Plant


def load_effect(path: str | Path) -> Effect:
    """A user's own effect from a file.

    Parameters
    ----------
    path : str or Path
        A Python file that defines ``EFFECT``. The file is run; the command line asks before, a program that calls this
        does not.

    Returns
    -------
    Effect
        Checked by `check_effect`.

    Raises
    ------
    ConfigurationError
        Where there is no such file, it fails, it defines no effect, or the effect cannot be compiled in.
    """
    if not isinstance(path, (str, Path)):
        raise ConfigurationError(f"effect_file: expected a Python file, got {path!r}")
    path = Path(path)
    if not path.is_file():
        raise ConfigurationError(f"effect file {path}: there is no such file")
    module = run_python(path, f"own_effect_{path.stem}")
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise ConfigurationError(f"effect file {path}: it must define EFFECT, a cable_envs.effects.Effect")
    check_effect(effect, str(path))
    return effect


def check_effect(effect: Effect, where: str) -> None:
    """Refuse an effect that cannot be compiled in.

    Parameters
    ----------
    effect : Effect
        A user's own effect.
    where : str
        Where it is from, for the error.

    Raises
    ------
    ConfigurationError
        For the name of a canonical effect or one that is no identifier, no hooks, unknown seams, and hooks with another
        number of arguments than the seam and the parameters give them.
    """
    if effect.name in EFFECTS:
        raise ConfigurationError(f"{where}: the name '{effect.name}' is that of a canonical effect")
    if not effect.name.isidentifier():
        raise ConfigurationError(f"{where}: the name '{effect.name}' is no identifier")
    if not effect.hooks:
        raise ConfigurationError(f"{where}: no hooks; give hooks={{seam: function}}, seams {', '.join(ARGUMENTS)}")
    require_known(f"seam of a hook in {where}", effect.hooks, ARGUMENTS)
    for seam, function in effect.hooks.items():
        wanted = [*ARGUMENTS[seam], *(p.name for p in effect.parameters)]
        given = list(inspect.signature(function).parameters)
        if len(given) != len(wanted):
            raise ConfigurationError(
                f"{where}: the hook '{seam}' takes ({', '.join(given)}); it is given ({', '.join(wanted)})"
            )


@cache
def with_own_effects(plant: Plant, own: tuple[Effect, ...]) -> Plant:
    """A plant with further effects.

    Parameters
    ----------
    plant : Plant
        The plant without them.
    own : tuple of Effect
        A user's own effects.

    Returns
    -------
    Plant
        A copy whose kernel is compiled on first use; ``plant`` itself where there are none.

    Raises
    ------
    ConfigurationError
        Where an effect does not act on the plant, or the plant has no such seam.
    """
    if not own:
        return plant
    for effect in own:
        if effect.plants and plant.name not in effect.plants:
            raise ConfigurationError(f"effect '{effect.name}' does not act on {plant.name}")
        missing = [seam for seam in effect.hooks if seam not in plant.effects.acting.seams]
        if missing:
            raise ConfigurationError(f"{plant.name} has no seam '{missing[0]}' for own effects")
    effects = Layout(plant.name, plant.parameters, plant.effects.acting, own, plant.effects.worn)
    return replace(plant, effects=effects, own=own)
