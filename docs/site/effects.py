"""The catalogue of effects, docs/effects.md, from what each effect declares.

Run ``python docs/effects.py`` after a change of an effect.
"""

from pathlib import Path

from cable_envs.effects import EFFECTS
from cable_envs.effects.base import Effect, EffectParameter
from cable_envs.plants import families, forms_of, plant_for, plants_with

FILE = Path(__file__).with_name("effects.md")
HEAD = """# Effects that a simulator may lack

Made from the files in `cable_envs/effects/` by `python docs/effects.py`. Each effect is off unless it is asked for,
and at its null value changes no bit of a result:

    gymnasium.make("cable_envs/CableHole-Position-Sine-v0", effects={"backlash": {"gap": 0.0005}})

The diagnosis looks for all of them ([diagnosis.md](diagnosis.md)). *Acts on* names the plants that have the effect;
*confused with*, the effects that look alike in some motions; *isolated by*, the experiment in which they do not.
"""


def line(parameter: EffectParameter) -> str:
    """A row of an effect's table."""
    typical = f"{parameter.typical:g}"
    if parameter.typical_turning not in (None, parameter.typical):
        typical += f" (turning: {parameter.typical_turning:g})"
    plain = parameter.meaning.replace("|", "/")
    return f"| `{parameter.name}` | {parameter.unit or '-'} | {parameter.null:g} | {typical} | {plain} |"


def form(plant: str, effect: Effect) -> str:
    """What the page says of an effect's own form on a plant."""
    numbers = ", ".join(f"`{p.name}` ({p.meaning}, {p.unit})" for p in effect.parameters)
    return f"- On `{plant}`: {effect.equation}; {numbers}."


def section(effect: Effect) -> str:
    """What the page says of one effect."""
    confusable = ", ".join(f"`{name}`" for name in effect.confusable) or "none"
    plants = ", ".join(f"`{name}`" for name in plants_with(effect.name))
    return "\n".join(
        (
            f"## {effect.name}",
            "",
            f"Equation: {effect.equation}.",
            "",
            "| parameter | unit | null | typical | meaning |",
            "|---|---|--:|--:|---|",
            *map(line, effect.parameters),
            "",
            f"- Acts on: {plants}. Seam: {effect.seam}.",
            *(form(plant, one) for plant, one in forms_of(effect.name).items() if effect.name in EFFECTS),
            f"- Confused with: {confusable}. Isolated by: {effect.experiment}.",
            f"- Valid: {effect.validity}.",
            f"- Source: {effect.source}.",
        )
    )


def of_one_plant() -> list[Effect]:
    """Effects that a plant has for itself, beside the library's."""
    plants = [plant_for(one.name, variant) for one in families().values() for variant in one.variants]
    forms = {effect.name: effect for plant in plants for effect in plant.effects.acting.forms}
    return [effect for name, effect in forms.items() if name not in EFFECTS]


def page() -> str:
    """The whole page."""
    library = [section(effect) + "\n" for effect in EFFECTS.values()]
    alone = [section(effect) + "\n" for effect in of_one_plant()]
    return "\n".join([HEAD, *library, "# Effects of one plant only\n", *alone])


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(f"wrote {FILE}: {len(EFFECTS)} effects")
