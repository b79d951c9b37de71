"""The HTML report of a diagnosis, from its JSON record and its traces: one file, no network."""

from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.drawing import pages
from cablebench.pages import diagnosis_figures as figures
from cablebench.pages import diagnosis_words as words

_CHANNELS = 3
"""Shown over time and along coordinates."""


def render(record: Mapping[str, Any], traces: Sequence[Any] = ()) -> str:
    """The page; ``traces`` (`diagnosis.model.verdict.Trace`) are drawn, without them the page has tables only."""
    from markupsafe import Markup

    named = words.named(record)
    shown = [
        {"text": text, "time": Markup(time), "along": Markup(along)}
        for text, time, along in _places(record, traces, named)
    ]
    last = [row for row in record["leftover"] if row["when"] == "after the model"] or record["leftover"]
    content = {
        "record": record, "named": named, "title": words.title(record), "headline": words.headline(record),
        "cost": words.cost(record), "advice": words.advice(record), "places": shown, "left": last,
        "errors": Markup(figures.errors(record["fit"], named)), "maps": Markup(figures.maps(last, record["fit"])),
        "spectra": Markup(figures.spectra(record["spectra"])),
        "top": max((row["log_odds"] or 0.0 for row in record["hypotheses"]), default=0.0), "visited": _visited(record),
        "not_noise": words.not_noise(record), "products": words.products(record),
        "unexplained": words.unexplained(record), "not_asked": words.not_asked(record),
        "numbers": words.numbers_of(record),
    }  # fmt: skip
    return pages.render(
        "cablebench.pages",
        "templates/diagnosis.html.j2",
        content,
        filters={
            "plain": words.plain,
            "number": words.number,
            "interval": words.interval,
            "odds": words.odds,
            "elsewhere": words.elsewhere,
        },
        helpers={"shown": words.shown, "sure": words.sure, "start_of": words.start_of},
    )


def _places(record: Mapping[str, Any], traces: Sequence[Any], named: bool) -> list[tuple[str, str, str]]:
    """(sentence, figure over time, figure along coordinates) of the channels that show most of the mismatch."""
    fitted = [t for t in traces if t.use == "fit"]
    found = []
    places = {p["channel"]: p for p in reversed(record["location"])}  # the largest of each channel stays
    channels = sorted(places, key=lambda c: -places[c]["share_of_all"]) or list(
        dict.fromkeys(t.channel for t in fitted)
    )
    for channel in channels[:_CHANNELS]:
        own, place = [t for t in fitted if t.channel == channel], places.get(channel)
        if not own:
            continue
        first = next((t for t in own if place and t.record == place["record"]), own[0])
        text = place["where"] if place else f"{words.plain(channel)} of {first.record}: there is nothing beyond noise"
        found.append((text, figures.over_time(first, named), figures.along(own, place, named)))
    return found


def _visited(record: Mapping[str, Any]) -> str:
    """What the records to fit have seen, in a sentence."""
    seen = record["visited"]
    if not seen:
        return ""
    ranges = [
        f"{words.plain(c)} {words.shown(r['low'], r['unit'])} to {words.shown(r['high'], r['unit'])}"
        for c, r in seen["ranges"].items()
    ]
    text = f"The fitted records last {seen['seconds']:.0f} s and cover {'; '.join(ranges)}"
    if "reversals" in seen:
        unit = seen["ranges"][seen["motion"]]["unit"]
        text += f"; {seen['reversals']} reversals, speeds up to {words.shown(seen['fastest'], unit + '/s')}"
    return text + "."
