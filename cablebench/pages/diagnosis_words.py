"""A diagnosis in words: for the terminal and at the head of the report, from the verdict's JSON."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.diagnosis.evidence.likely import EVEN

VERDICT = {
    "named": "An effect is missing, and it is named",
    "equivalence_class": "An effect is missing, and this recording cannot tell which of a few",
    "partly_named": "An effect is probably missing, and it is not all",
    "unknown": "Something is missing, and no known effect is sure to be it",
    "data_fault": "The data have a fault, and the simulator has none that they could show",
    "no_detectable_mismatch": "Nothing is missing that this recording could show",
}
_SHOWN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", 57.29577951308232), "s": ("ms", 1e3)}


_MOST_DIGITS = 7
HARDLY = 0.03
"""Share of an RMS error below which its fall needs no number."""


def plain(name: str) -> str:
    """``load_dependent_friction`` -> load-dependent friction; ``sensor_bias.force`` -> sensor bias (force).

    ``logger.clock`` -> the logger's clock.
    """
    whose = "the logger's " if name.startswith("logger.") else ""
    effect, _, channel = name.removeprefix("logger.").partition(".")
    words = effect.replace("load_dependent", "load-dependent").replace("position_dependent", "position-dependent")
    return whose + words.replace("_", " ") + (f" ({channel.replace('_', ' ')})" if channel else "")


def number(value: float | None, digits: int = 3) -> str:
    """A number for a person; a dash where there is none."""
    return "–" if value is None else f"{value:.{digits}g}"


def shown(value: float | None, unit: str, digits: int = 3) -> str:
    """``(0.0031, "s")`` -> 3.1 ms."""
    if value is None:
        return "–"
    name, factor = _SHOWN.get(unit, (unit, 1.0))
    return number(factor * value, digits) + ("" if name in ("", "1") else f" {name}")


def interval(parameter: Mapping[str, Any]) -> str:
    """``3.02 ms (95 %: 2.91 ms to 3.13 ms)``, with as many digits as tell the ends from the value."""
    low, high = parameter.get("ci95") or (None, None)
    value, unit = parameter["value"], parameter["unit"]
    digits = 3
    if value and low is not None and 0.0 < high - low < abs(value):
        digits = min(3 + int(math.log10(abs(value) / (high - low))), _MOST_DIGITS)
    return f"{shown(value, unit, digits)} (95 %: {shown(low, unit, digits)} to {shown(high, unit, digits)})"


def odds(log_odds: float | None) -> str:
    """``odds 400 to 1`` of a logarithm of odds; large ones as powers of ten, less than one to one as none."""
    if log_odds is None or log_odds <= 0.0:
        return "odds below 1 to 1"
    power = log_odds / 2.302585092994046
    return f"odds {float(f'{10**power:.2g}'):g} to 1" if power < 3.0 else f"odds 10^{power:.0f} to 1"


def named(record: Mapping[str, Any]) -> bool:
    """Whether the answer has effects."""
    return record["verdict"] in ("named", "equivalence_class", "partly_named")


def not_noise(record: Mapping[str, Any]) -> bool:
    """Whether the answer's own odds say that something is left that is no noise."""
    left = record["test"]["log_odds_left"]
    return left is not None and left > record["test"]["sure"]


def title(record: Mapping[str, Any]) -> str:
    """The kind of the answer, and that something is left."""
    what = VERDICT[record["verdict"]]
    more = record["verdict"] in ("named", "equivalence_class") and unexplained(record)
    return f"{what}; something is left that is not noise" if more else what


def unexplained(record: Mapping[str, Any]) -> str:
    """What no effect and no fault of the data explains, in words with its share; empty where that is noise."""
    test = record["test"]
    if not not_noise(record) or test.get("cause_left", test["cause"]):
        return ""
    return f"{_share(record)}, and that is not noise ({odds(test['log_odds_left'])})"


def _share(record: Mapping[str, Any]) -> str:
    """``4 % of the mismatch is unexplained``; of a model without effects nothing is explained."""
    share = record["test"]["share_left"]
    if share is None or not 0.0 <= share < 1.0:
        return "something is left"
    return f"{'less than 1' if share < 0.01 else f'{100.0 * share:.0f}'} % of the mismatch is unexplained"


def headline(record: Mapping[str, Any]) -> str:
    """What is missing, how sure that is and what is left, in a sentence or two."""
    verdict, rest, cause = record["verdict"], unexplained(record), record["test"]["cause"]
    if verdict == "no_detectable_mismatch":
        itself = " It oscillates by itself, as the recording does." if record.get("spectra") else ""
        alone = (
            "No mismatch beyond noise: after the refit of its nominal parameters the simulator explains this recording."
        )
        beside = f"No effect is missing, but {rest}: too little beside what the rig's own effects explain."
        return (beside if rest else alone) + itself
    if verdict == "data_fault":
        besides = f" Besides, {rest}." if rest else ""
        if record["suspected"]:
            helps = f"The fit improves with {_suspects(record)}, of which nothing can be told before that is mended."
            return f"Your data before your physics: {cause}. {helps}{besides}"
        if "a steady tone" in cause:
            return f"Your data, or something that shakes the rig where one sensor alone shows it: {cause}.{besides}"
        return f"Your data, not your physics: nothing of the rig is missing, but {cause}.{besides}"
    if verdict == "unknown":
        return _unknown(record, rest)
    several = "; ".join(" and ".join(part) for part in _by_place(record["effects"], bool(rest)) if part)
    probably = "probably " if verdict == "partly_named" else ""
    besides = f" Besides, of the data: {cause}." if cause else ""
    return f"The simulator {probably}lacks {several}{f', but that is not all: {rest}' if rest else ''}.{besides}"


def _unknown(record: Mapping[str, Any], rest: str) -> str:
    places, cause = record["location"], record["test"]["cause"]
    where = f" It shows {places[0]['in_words']}, mostly in {plain(places[0]['channel'])}." if places else ""
    where += f" Besides, of the data: {cause}." if cause else ""
    if record.get("suspected"):
        but = rest or _against(record)
        return f"Something is missing. The fit improves with {_suspects(record)}, but {but}.{where}"
    more = f": {rest}" if rest else ""
    return f"Something is missing, and none of the {len(record['hypotheses'])} effects tried explains it{more}.{where}"


def _against(record: Mapping[str, Any]) -> str:
    """What speaks against effects that help where nothing is left beside them."""
    if record["test"].get("worse_than_claim"):
        return "held-out records are predicted better by the model as it was claimed"
    best = max(effect["confidence"] for effect in record["suspected"])
    alike = any(effect.get("alternatives") for effect in record["suspected"])
    if best < EVEN:
        which = "it or a law that does as well" if alike else "it"
        return f"the probability that {which} is there is only {100 * best:.0f} %"
    return "unlike laws do as well" if alike else "a channel is predicted worse than by its own mean"


def sure(effect: Mapping[str, Any], rest: bool) -> str:
    """How sure an effect is; rest: whether something is left, of which that says nothing."""
    text = f"{100 * effect['confidence']:.0f} % sure"
    if effect["alternatives"]:
        return f"{text} that it is one of them"
    return f"{text} that it is there" if rest else text


def _by_place(effects: Sequence[Mapping[str, Any]], rest: bool) -> tuple[list[str], list[str]]:
    """Effects in words, the unlikely ones last: those that nothing speaks against, and those that are local."""
    effects = sorted(effects, key=_unlikely)
    everywhere = [_one(effect, rest) for effect in effects if not effect.get("local")]
    return everywhere, [f"{_one(effect, rest)} only where it was fitted" for effect in effects if effect.get("local")]


def elsewhere(effect: Mapping[str, Any]) -> list[str]:
    """On which records an effect holds that it was not fitted to, in sentences; none where it was not asked."""
    if not (asked := effect.get("elsewhere")):
        return []
    local, holds = effect["local"], effect["holds"]
    open_ = [group for group in asked if group not in local and group not in holds]
    found = []
    if local:
        found.append(
            f"Local: fitted to the other records it does not hold on {_listed(local)}, where the model without it is "
            "better."
        )
    if holds:
        found.append(f"Fitted to the other records it holds on {_listed(holds)}.")
    if open_:
        found.append(f"Whether it holds there, {_listed(open_)} {'does' if len(open_) == 1 else 'do'} not tell.")
    return found


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)


def _one(effect: Mapping[str, Any], rest: bool) -> str:
    possibly = "possibly " if _unlikely(effect) else ""
    if effect["alternatives"]:
        others = " or ".join(plain(n) for n in (effect["name"], *effect["alternatives"]))
        return f"{possibly}either {others} ({sure(effect, rest)})"
    return f"{possibly}{_called(effect)} ({sure(effect, rest)})"


def _unlikely(effect: Mapping[str, Any]) -> bool:
    """Whether an effect is rather not there; beside a likelier one it is said."""
    return bool(effect["confidence"] < EVEN)


def _called(effect: Mapping[str, Any]) -> str:
    return plain(effect["hypothesis"] or effect["name"])


def _suspects(record: Mapping[str, Any]) -> str:
    return " and ".join(map(_called, record["suspected"]))


def cost(record: Mapping[str, Any]) -> str:
    """What the effect changes: the channel whose held-out error falls most, or is farthest above its noise."""
    known = named(record)

    def above(fit: Mapping[str, Any]) -> float:
        least = fit["heldout_rmse"]["augmented"] if known else fit["noise_floor"]
        return fit["heldout_rmse"]["refit"] / max(least, 1e-300)

    worst = max(record["fit"].items(), default=None, key=lambda item: above(item[1]))
    if worst is None:
        return ""
    channel, fit = worst
    held, unit = fit["heldout_rmse"], fit["unit"]
    floor = shown(fit["noise_floor"], unit)
    if not known:
        helped = f", and {shown(held['suspected'], unit)} with {_suspects(record)}" if record.get("suspected") else ""
        return (
            f"On held-out records the error of {plain(channel)} is {shown(held['refit'], unit)} RMS with the refitted "
            f"parameters, {shown(held['nominal'], unit)} with the claimed ones{helped}. Its noise is about {floor}."
        )
    if record.get("spectra"):
        return (
            f"With it the simulation oscillates by itself as the recording does, most at {_loudest(record):.3g} Hz. "
            f"The phase of the oscillation cannot be predicted, so that the error of {plain(channel)} on held-out "
            f"records stays at {shown(held['refit'], unit)} RMS (the noise is {floor}). Without the effect the "
            "simulation does not oscillate."
        )
    change = 1.0 - held["augmented"] / max(held["refit"], 1e-300)
    if change < HARDLY:
        return (
            f"It changes little: on held-out records the error of {plain(channel)} is {shown(held['refit'], unit)} RMS "
            f"without it and {shown(held['augmented'], unit)} with it. The noise is {floor}."
        )
    return (
        f"On held-out records the error of {plain(channel)} is {shown(held['refit'], unit)} RMS without it and "
        f"{shown(held['augmented'], unit)} with it ({100.0 * change:.0f} % less). The noise is {floor}."
    )


def _loudest(record: Mapping[str, Any]) -> float:
    """Frequency, Hz, at which most is left over the noise."""
    powers = ((power, at) for row in record["spectra"] for power, at in zip(row["left"], row["at"], strict=True))
    return max(powers)[1]


def advice(record: Mapping[str, Any]) -> str:
    """What to do next."""
    verdict = record["verdict"]
    if verdict in ("named", "partly_named"):
        rig = record["augmented_rig"]
        if not record["about"].get("environment", True):
            return f"Use the corrected rig, {rig}, which has the effect and the refitted parameters."
        return f"Simulate with the corrected rig, which has the effect and the refit: gymnasium.make(..., rig='{rig}')."
    if verdict == "equivalence_class":
        effect = next((e for e in record["effects"] if e["alternatives"]), record["effects"][0])  # or another sensor's
        return f"To tell them apart: {effect['separating_experiment']}."
    if verdict == "unknown":
        places = record["location"]
        where = f" where the mismatch is ({places[0]['in_words']})" if places else ""
        return (
            f"Look at the rig{where}. Then test an idea of your own with --effect-file. The maps of what is left show "
            "what shape the effect must have."
        )
    if verdict == "data_fault":
        return (
            "Mend the log, or mark the channel as it is under 'quality' in the recording's file; then diagnose again."
        )
    return "The table of the effects tried says from which size on this recording would have shown each."


def _power(name: str, exponent: float, less: float) -> str:
    base = plain(name) if less == 0.0 else f"({plain(name)} - {less:g})"
    return base if exponent == 1.0 else f"{base}^{exponent:g}"


def _to(low: float, high: float) -> str:
    """``3 %`` of an interval's ends on either side of its geometric mean; ``a factor of 2.4``."""
    factor = abs(high / low) ** 0.5 if low * high > 0.0 else float("inf")
    if factor == float("inf"):
        return "no factor"
    return f"a factor of {factor:.2g}" if factor > 1.5 else f"{100.0 * (factor - 1.0):.2g} %"


def products(record: Mapping[str, Any]) -> list[str]:
    """What is known as a product only, a sentence for each."""
    said = []
    for one in record.get("products", ()):
        names = one["names"]
        text = " * ".join(map(_power, names, one["exponents"], one["less"]))
        value = f"{number(one['value'])} {one['unit']}".strip()
        alone = "; ".join(f"{plain(n)} to {_to(*ends)}" for n, ends in zip(names, one["alone_ci95"], strict=True))
        said.append(f"Only the product {text} = {value} is known, to {_to(*one['ci95'])}. Each alone: {alone}.")
    return said


def _stepped(step: Mapping[str, Any], fit: Mapping[str, Any]) -> str:
    errors = ", ".join(f"{plain(c)} {shown(value, fit[c]['unit'])}" for c, value in step["heldout"].items())
    return f"  step: {plain(step['name'])}; RMS on held-out records after it: {errors}"


def lines(record: Mapping[str, Any]) -> list[str]:
    """The verdict for a terminal, the sentence first."""
    found = [headline(record)]
    if cost(record):
        found.append(cost(record))
    found.append(advice(record))
    for effect in (*record["effects"], *record.get("suspected", ())):
        found.append(f"  {_called(effect)}: {effect['equation']}")
        found += [f"    {name} = {interval(p)}" for name, p in effect["parameters"].items()]
        found += [f"    {sentence}" for sentence in elsewhere(effect)]
    found += [f"  {said}" for said in products(record)]
    if len(record["steps"]) > 2:
        found += [_stepped(step, record["fit"]) for step in record["steps"][1:]]
    found += [f"  where: {place['where']}" for place in record["location"][:4]]
    for name, p in record["absorbed"].items():
        values = [shown(p[key], p["unit"]) for key in ("before", "after_refit", "after_model")]
        found.append(
            f"  {name}: {start_of(record, name)} {values[0]}, refitted {values[1]}, "
            f"refitted with the answer {values[2]}"
        )
    for channel, fit in record["fit"].items():
        held, unit = fit["heldout_rmse"], fit["unit"]
        found.append(
            f"  {channel}, RMS error on held-out records: claimed {shown(held['nominal'], unit)}, refitted "
            f"{shown(held['refit'], unit)}, with the answer {shown(held['augmented'], unit)}; noise "
            f"{shown(fit['noise_floor'], unit)}"
        )
    found += [f"  not asked: {what} ({why})" for why, what in not_asked(record)]
    return found + [f"  note: {note}" for note in record["notes"]]


def start_of(record: Mapping[str, Any], name: str) -> str:
    """What the start of a refitted parameter is: claimed by the user, or assumed, or told by the records."""
    about = next((p for p in record.get("parameters", ()) if p["name"] == name), None)
    if about is None or about["stated"]:
        return "claimed"
    return "assumed" if about["source"].startswith("default") else about["source"]


def numbers_of(record: Mapping[str, Any]) -> dict[str, list[Mapping[str, Any]]]:
    """Status -> parameters of the simulator that have it: stated, assumed, fitted."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for status in ("stated", "fitted", "assumed"):
        found[status] = [p for p in record.get("parameters", ()) if p["status"] == status]
    return {status: rows for status, rows in found.items() if rows}


def not_asked(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(why, the effects that were not looked for because of it), each reason once, in the order of the record."""
    by_reason: dict[str, list[str]] = {}
    for name, why in record.get("not_asked", {}).items():
        by_reason.setdefault(why, []).append(plain(name))
    return [(why, ", ".join(names)) for why, names in by_reason.items()]
