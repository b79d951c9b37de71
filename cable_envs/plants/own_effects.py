"""A user's own effect, from a file: compiled into a copy of the plant's kernel on first use, and then found on disk.

The file defines ``EFFECT``, an `Effect` like the canonical ones, with plain functions of numbers as hooks. A hook asks
by the names of its arguments for what it needs: what there is at its seam, and the effect's parameters and states.

seam    | there is                                                        | the hook gives
------- | --------------------------------------------------------------- | --------------------------------------------
actuate | command; position, velocity, speed of the drive                 | the command that acts
cable   | tension (N; closed-form circuit: N m) that the law before gives | the tension
contact | position, velocity, speed of the sliding cable; tension,        | what the friction coefficient has more
        | tension_behind: towards the drive and towards the load          | (cable_hole, tendon_sheath)
load    | position, velocity, speed; tension at the load                  | force or torque against positive motion
all     | time since the start, dt: length of an integration step, s      |

``speed`` is the size of ``velocity``. A cubic spring to ground, which pushes the slide of a drive back:

    from cable_envs.effects import Effect, EffectParameter

    def spring(position, stiffness):
        return stiffness * position**3

    EFFECT = Effect(
        name="cubic_spring", seam="load", equation="F = -stiffness y^3", source="Duffing 1918",
        parameters=(EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e8, "spring to ground", typical=5e3),),
        plants=("linear_drive",), validity="any travel", experiment="Hold at eight positions", hooks={"load": spring},
    )

An effect may remember: ``states`` declares what, and ``advance`` has a function for each state, which gives its value
``dt`` later from the same names, at the effect's seam. A cable whose friction grows with the way that it has slid:

    def longer(worn, speed, dt):
        return worn + speed * dt

    def rougher(worn, growth):
        return growth * worn

    EFFECT = Effect(
        name="wear", seam="contact", states=(EffectState("worn", "m", 0.0, "way that the cable has slid"),),
        advance={"worn": longer}, hooks={"contact": rougher},
        parameters=(EffectParameter("growth", "1/m", 0.0, 0.0, 10.0, "friction coefficient for 1 m", typical=0.1),), ...
    )

States are part of the environment's: they are copied, pickled, restored and reset with it. Hooks get time and states in
the middle of the step, the states moved there by ``advance`` with the velocity at which the hook is called. A load is
integrated linearly implicitly with slopes from differences of the hook, and these so include how the states follow the
motion: a friction with bristles may be stiff, as long as ``advance`` by itself is stable for any ``dt``.

A file from before may ask for nothing by name: ``f(command, *numbers)``, ``f(tension, *numbers)``, ``f(speed, tension,
*numbers)`` and ``f(position, velocity, tension, *numbers)``, the values of the parameters in their order, work as they
did.

Functions may use arithmetic, comparisons, ``abs``, ``min``, ``max``, the functions of `math`, those of
`cable_envs.core.kernels`, and other functions of the file that are written so.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.core.files import read_python, run_python
from cable_envs.effects import EFFECTS, Effect, Layout
from cable_envs.effects.own import ARGUMENTS, asked
from cable_envs.plants.base import Plant


def load_effect(path: str | Path) -> Effect:
    """A user's own effect from a file; the same object again for the same file with the same content.

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
    return _effect_of(path, read_python(path))


@cache  # so that its plants and their kernels are made once in a process
def _effect_of(path: Path, content: bytes) -> Effect:
    effect = getattr(run_python(path, f"own_effect_{path.stem}", content), "EFFECT", None)
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
        For the name of a canonical effect or one that is no identifier, no hooks, unknown seams, states that nothing
        advances, and functions that ask for what there is not.
    """
    if effect.name in EFFECTS:
        raise ConfigurationError(f"{where}: the name '{effect.name}' is that of a canonical effect")
    if not effect.name.isidentifier():
        raise ConfigurationError(f"{where}: the name '{effect.name}' is no identifier")
    if not effect.hooks:
        raise ConfigurationError(f"{where}: no hooks; give hooks={{seam: function}}, seams {', '.join(ARGUMENTS)}")
    require_known(f"seam of a hook in {where}", effect.hooks, ARGUMENTS)
    names = [state.name for state in effect.states]
    for name in names:
        if not name.isidentifier():
            raise ConfigurationError(f"{where}: the state '{name}' is no identifier")
        if name not in effect.advance:
            raise ConfigurationError(
                f"{where}: nothing advances the state '{name}'; give advance={{'{name}': function}}"
            )
    require_known(f"state that something advances in {where}", effect.advance, names)
    if names and effect.seam not in effect.hooks:
        raise ConfigurationError(f"{where}: an effect with states needs a hook at its seam '{effect.seam}'")
    try:
        for seam in effect.hooks:
            asked(effect, seam)
        for name in names:
            asked(effect, effect.seam, name)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from None


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
        several = [seam for seam in effect.hooks if seam in plant.effects.acting.several]
        if effect.states and several:
            raise ConfigurationError(
                f"effect '{effect.name}' has states, and {plant.name} has its seam '{several[0]}' at several places"
            )
    effects = Layout(plant.name, plant.parameters, plant.effects.acting, own, plant.effects.worn)
    return replace(plant, effects=effects, own=own)
