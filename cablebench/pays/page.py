"""The result of `cablebench retrain-study` for people: the command that repeats it, a page in Markdown, a figure."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from cable_envs.core.text import markdown_text
from cable_envs.drawing.charts import BLUE, INK, RED, key, svg
from cablebench.pays.rigs import RIGS
from cablebench.pays.scores import SIMULATORS, Study

FIGURE = "pays.svg"
_COLOURS = {"nominal": RED, "augmented": BLUE, "oracle": INK}


def command(studies: Sequence[Study], quick: bool) -> str:
    """The command line that repeats the studies, which differ in their rigs only."""
    study = studies[0]
    words = ["cablebench", "retrain-study"] + (["--quick"] if quick else [])
    for one in studies:
        words += ["--rig", one.rig]
    for name, value in (
        ("--steps", study.steps), ("--trials", study.trials), ("--episodes", study.episodes),
        ("--tuning-episodes", study.tuning_episodes), ("--duration", study.duration),
        ("--record-seconds", study.record_seconds),
    ):  # fmt: skip
        if value is not None:
            words += [name, f"{value:g}" if isinstance(value, float) else str(value)]
    for seed in study.seeds:
        words += ["--seed", str(seed)]
    for effect, values in (study.hidden or {}).items():
        for parameter, value in values.items():
            words += ["--hide", f"{effect}.{parameter}={value:g}"]
    return shlex.join([*words, "--out", "pays"])


def page(result: Mapping[str, Any]) -> str:
    """The result as a page in Markdown; the figure lies beside it."""
    budget = result["budget"]
    lines = [
        "# Does it pay?",
        "",
        "Does a controller or an agent become better on a rig when its simulator is corrected by a diagnosis? This "
        "page measures it on rigs that are simulated, so that the truth is known.",
        "",
        "1. A *hidden rig* has effects that its nominal simulator lacks. The generator of the blind proof, which "
        "shares no integrator with the simulators, recorded it.",
        "2. `cablebench diagnose` was given the recording and the preset of the rig. It was not told the effects.",
        "3. The paper's controller was tuned, and an agent that corrects this controller was trained without "
        "randomisation, on each of three simulators:",
        "",
        "| simulator | rig that it simulates, and that the controller takes for the true one |",
        "|---|---|",
        "| nominal | the preset |",
        "| augmented | the preset, corrected by the diagnosis |",
        "| oracle | the preset with the concealed effects |",
        "",
        "4. All were tested on the hidden rig, with seeds that no tuning or training used.",
        "",
        "The agent corrects the controller with the gains of the agent's own settings "
        "(`configs/agents/residual-ppo.yaml`) and not with the tuned ones. The numbers can therefore be compared along "
        "the rows and not down the columns.",
        "",
        "```",
        " ".join(result["command"].replace("`", "'").split()),
        "```",
        "",
        f"Each tuning had {budget['trials']} trials of {budget['tuning_episodes']} episodes and each training "
        f"{budget['steps']} steps, on every simulator. Brackets hold 95 % intervals: a bootstrap over "
        f"{len(result['seeds'])} seeds of tuning and training with {result['episodes']} episodes each. There is one "
        "recording and one diagnosis of each rig. The intervals therefore do not include what another recording would "
        "change.",
        "",
        f"![errors on the hidden rigs]({FIGURE})",
    ]
    for name, found in result["rigs"].items():
        lines += ["", *_of_rig(name, found)]
    return "\n".join(lines) + "\n"


def _of_rig(name: str, found: Mapping[str, Any]) -> list[str]:
    bench = RIGS[name]
    chosen = bench.chosen if found["hidden"] == bench.effects else ""
    lines = [
        f"## {name.capitalize()}",
        "",
        f"The hidden rig has the preset `{bench.preset}`. {bench.about} Concealed are {_said(found['hidden'])}.",
        "",
        *((chosen, "") if chosen else ()),
        f"The diagnosis answered **{markdown_text(found['diagnosis']['verdict'])}**:",
        "",
        *_against_truth(found["hidden"], found["diagnosis"]["effects"]),
        "",
        f"Tracking error on the hidden rig, RMSE in {bench.unit}:",
        "",
        "| controller or agent | nominal | augmented | oracle | nominal less augmented | share of the oracle's gain |",
        "|---|---|---|---|---|---|",
    ]
    for learner, entry in found["summary"].items():
        closed = "-" if entry["closed"] is None else f"{100 * entry['closed']:.0f} %"
        cells = [_shown(entry[column], bench.per_si) for column in (*SIMULATORS, "saved")]
        lines.append(f"| `{markdown_text(learner)}` | {' | '.join(cells)} | {closed} |")
    return lines


def _said(hidden: Mapping[str, Mapping[str, float]]) -> str:
    return ", ".join(markdown_text(f"{e}.{p} = {v:g}") for e, values in hidden.items() for p, v in values.items())


def _against_truth(hidden: Mapping[str, Mapping[str, float]], effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """Rows of a table: what was hidden, and what was named with its interval, whichever of them there is."""
    truth = {(effect, name): value for effect, values in hidden.items() for name, value in values.items()}
    named = {}
    for effect in effects:
        for name, q in effect["parameters"].items():
            named[effect["name"], name.split(".")[-1]] = (q, effect.get("confidence"))
    rows = ["| effect | true value | named value | 95 % interval | confidence |", "|---|---|---|---|---|"]
    for effect, name in dict.fromkeys((*truth, *named)):
        value = truth.get((effect, name))
        q, sure = named.get((effect, name), (None, None))
        cells = ["-" if value is None else f"{value:g}", "-", "-", "-" if sure is None else f"{sure:.2f}"]
        if q is not None:
            cells[1] = f"{q['value']:.3g} {markdown_text(q['unit'])}"
            cells[2] = "-" if not q.get("ci95") else f"{q['ci95'][0]:.3g} to {q['ci95'][1]:.3g}"
        rows.append(f"| {markdown_text(f'{effect}.{name}')} | {' | '.join(cells)} |")
    return rows


def _shown(found: Mapping[str, Any], per_si: float) -> str:
    return f"{per_si * found['value']:.3g} [{per_si * found['low']:.3g}, {per_si * found['high']:.3g}]"


def figure(result: Mapping[str, Any]) -> str:
    """Errors with their intervals as SVG: a panel for each rig, a row for each learner and simulator."""
    rigs = result["rigs"]

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, len(rigs), squeeze=False)[0]
        for ax, (name, found) in zip(axes, rigs.items(), strict=True):
            scale = RIGS[name].per_si
            for i, entry in enumerate(found["summary"].values()):
                for k, simulator in enumerate(SIMULATORS):
                    at, e = i + 0.24 * (k - 1), entry[simulator]
                    ax.plot([scale * e["low"], scale * e["high"]], [at, at], color=_COLOURS[simulator], linewidth=2.0)
                    ax.plot(scale * e["value"], at, "o", color=_COLOURS[simulator], markersize=4.5)
            ax.set(title=name, xlabel=f"RMSE, {RIGS[name].unit}", ylim=(len(found["summary"]) - 0.4, -0.6))
            ax.set_yticks(range(len(found["summary"])), list(found["summary"]))
            ax.set_xlim(left=0.0)
        key(figure, list(_COLOURS.items()))
        width, height = figure.get_size_inches()
        figure.subplots_adjust(
            left=1.1 / width, right=1 - 0.15 / width, top=1 - 0.6 / height, bottom=0.5 / height, wspace=0.45
        )

    return svg(draw, 4.9 * len(rigs) + 0.5, 2.4)
