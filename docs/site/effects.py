"""The catalogue of effects, docs/effects.md, from what each effect declares.

Run ``python -m docs.site.effects`` after a change of an effect. The site shows the same text with a picture of each
effect on each plant (`docs.site.signatures`).
"""

import sys
from pathlib import Path

from cable_envs.effects import EFFECTS
from cable_envs.effects.base import Effect, EffectParameter
from cable_envs.plants import families, family_of, forms_of, plant_for, plants_with
from docs.site.markdown import table

FILE = Path(__file__).parents[1] / "effects.md"
HEAD = """# Effects that a simulator may lack

An effect is a piece of physics that a simulator may lack. Each one is off unless it is asked for:

    gymnasium.make("cable_envs/CableHole-Position-Sine-v0", effects={"backlash": {"gap": 0.0005}})

The [diagnosis](diagnosis.md) looks for them in a recording; for what says "only where it is named" it takes
`--effects`. Physics that is not here can be [your own effect](your-own-effect.md). Each effect below has

- its **equation**, and a table of its parameters: the *null* is the value at which the effect changes no bit of a
  result (of a period, a speed and the like, which only shape it, the default), and the *typical* value shows it plainly
  (in brackets: the value for a plant that turns, in rad and N m);
- the **plants** that have it, and the **seam**: the place in the equations of motion where it acts, from the command
  (actuate) over the cable, the contact and the load to the sensors (sense);
- the effects it may be **confused with**, because they look alike in some motions, and the **experiment** that
  isolates it from them;
- where the equation is **valid**, and its **source**.

`python -m docs.site.effects` makes this page from the files in `cable_envs/effects/`. The [glossary](glossary.md)
explains further terms.
"""
SHOWN = """Each picture shows one plant whose drive moves slowly back and forth. The upper part is the signal that the
effect changes most, over the position of the drive (of a rotary joint, over the voltage of its motor): without the
effect (grey) and with it at its typical size (blue). The lower part is the change. A plant that has the effect but no
picture does not show it in this motion.
"""


def pages() -> dict[str, str | bytes]:
    """The catalogue with its pictures."""
    from docs.site.signatures import drawn

    made: dict[str, str | bytes] = {}
    pictures: dict[str, list[tuple[str, str, str]]] = {}
    for (effect, plant), svg in drawn().items():
        address = f"effects/{effect}-{plant}.svg"
        made[address] = svg
        words = f"{effect} on {family_of(plant).title}: without and with the effect"
        pictures.setdefault(effect, []).append((address, words, family_of(plant).title))
    shown = {name: _figures(found) for name, found in pictures.items()}
    return {**made, FILE.name: page(shown)}


def _figures(found: list[tuple[str, str, str]]) -> str:
    """Pictures beside each other, as far as the width allows."""
    items = [
        f'<figure><img src="{address}" alt="{words}" loading="lazy"><figcaption>{title}</figcaption></figure>'
        for address, words, title in found
    ]
    return '<div class="signatures">\n' + "\n".join(items) + "\n</div>"


def line(parameter: EffectParameter) -> tuple[str, ...]:
    """A row of an effect's table."""
    null = _with_turning(parameter.null, parameter.null_turning)
    typical = _with_turning(parameter.typical, parameter.typical_turning)
    return f"`{parameter.name}`", parameter.unit or "-", null, typical, parameter.meaning.replace("|", "/")


def _with_turning(value: float, turning: float | None) -> str:
    return f"{value:g}" if turning in (None, value) else f"{value:g} (turning: {turning:g})"


def form(plant: str, effect: Effect) -> str:
    """What the page says of an effect's own form on a plant."""
    numbers = ", ".join(f"`{p.name}` ({p.meaning}, {p.unit})" for p in effect.parameters)
    return f"- On `{plant}`: {effect.equation}. Parameters: {numbers}."


def described(effect: Effect) -> str:
    """What an effect of the library is, in a sentence: the first line of its file."""
    words = (sys.modules[f"cable_envs.effects.{effect.name}"].__doc__ or "").strip()
    return words.splitlines()[0]


def section(effect: Effect, figures: str = "", linked: bool = False) -> str:
    """What the page says of one effect."""
    names = [f"[`{name}`](#{name})" if linked else f"`{name}`" for name in effect.confusable]
    plants = ", ".join(f"`{name}`" for name in plants_with(effect.name))
    head = ("parameter", "unit", "null", "typical", "meaning")
    return "\n".join(
        (
            f"## {effect.name}",
            "",
            *((described(effect), "") if effect.name in EFFECTS else ()),
            f"Equation: {effect.equation}." if not linked else f"Equation: `{effect.equation}`.",
            "",
            *((figures, "") if figures else ()),
            table(head, map(line, effect.parameters), numbers=(2, 3)),
            "",
            f"- Plants: {plants}. Seam: {effect.seam}.",
            *(form(plant, one) for plant, one in forms_of(effect.name).items() if effect.name in EFFECTS),
            *(() if effect.hypothesis else ("- Diagnosis: only where it is named.",)),
            f"- May be confused with: {', '.join(names) or 'none'}.",
            f"- Experiment: {effect.experiment}.",
            f"- Valid for: {effect.validity}.",
            f"- Source: {effect.source}.",
        )
    )


def of_one_plant() -> list[Effect]:
    """Effects that a plant has for itself, beside the library's."""
    plants = [plant_for(one.name, variant) for one in families().values() for variant in one.variants]
    forms = {effect.name: effect for plant in plants for effect in plant.effects.acting.forms}
    return [effect for name, effect in forms.items() if name not in EFFECTS]


def page(figures: dict[str, str] | None = None) -> str:
    """The whole page.

    Parameters
    ----------
    figures : dict of str to str, optional
        Effect -> HTML of its pictures; None: the page of the checkout, which has none.

    Returns
    -------
    str
        Markdown.
    """
    on_site = figures is not None
    shown = figures or {}
    library = [section(effect, shown.get(name, ""), on_site) + "\n" for name, effect in EFFECTS.items()]
    alone = [section(effect, linked=on_site) + "\n" for effect in of_one_plant()]
    between = "The effects below are of one plant only.\n"
    return "\n".join([HEAD, *((SHOWN,) if on_site else ()), *library, between, *alone])


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(f"wrote {FILE}: {len(EFFECTS)} effects")
