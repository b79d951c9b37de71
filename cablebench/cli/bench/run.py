"""``cablebench run``: one episode of one controller or policy, its metrics, its data, its picture."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError, require_known
from cablebench.cli.bench.run_files import (
    DATA_FORMATS,
    FRAMES_PER_SECOND,
    PICTURE_FORMATS,
    Film,
    check_suffix,
    contents,
    write,
)
from cablebench.cli.bench.run_score import episode_score
from cablebench.cli.shared.arguments import options_for, parse_gains, parse_options, resolve_env
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.trust import Trusted, Walls


def run(
    env: Annotated[str, typer.Argument(help="Environment, by full or short id.")],
    controller: Annotated[
        str | None, typer.Option(help="Controller: a reference, a controller file, a .py file.")
    ] = None,
    policy: Annotated[str | None, typer.Option(help="Trained policy: its file or folder.")] = None,
    gain: Annotated[list[str] | None, typer.Option(help="Gain of the controller, NAME=NUMBER; repeatable.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--option", "-o", help="Environment option, KEY=YAML (rig=gu-steel-2mm); repeatable."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the episode.")] = 0,
    save: Annotated[Path | None, typer.Option(help="Save the episode's data: FILE.npz or FILE.csv.")] = None,
    render: Annotated[
        Path | None, typer.Option(help="Picture of the end (FILE.png), or film in real time (FILE.gif, FILE.mp4).")
    ] = None,
    theme: Annotated[str, typer.Option(help="Of the picture: light or dark.")] = "light",
    sandbox: Walls = "auto",
    trust: Trusted = False,
    score: Annotated[
        bool, typer.Option(help="Run open loop and oracle on the same episode too, which gives the board's score.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Metrics in SI units as JSON on standard output.")] = False,
) -> None:
    """Run one episode; print its metrics in the units of the boards and its score: 0 is open loop, 1 the oracle."""
    check_suffix(save, DATA_FORMATS, "--save")
    check_suffix(render, PICTURE_FORMATS, "--render")
    require_known("theme", [theme], ("light", "dark"))
    env_id = resolve_env(env, every_version=True)
    options = parse_options(option or ())
    entrant = choose_entrant(controller, policy, gain or (), sandbox)
    with progress_bar() as update:
        episode, film = _play(env_id, options, entrant, seed, render, theme, update)
        scored = episode_score(env_id, options, seed, episode) if score else None
    written = [str(path) for path, content in contents(episode, save, render, film) if write(path, content)]
    _report(env_id, entrant, seed, episode, scored, written, as_json)


def choose_entrant(
    controller: str | None, policy: str | None, gains: list[str] | tuple[str, ...], sandbox: str = "auto"
) -> Any:
    """The one entrant that the flags name. Raises ConfigurationError when they name none or two."""
    if (controller is None) == (policy is None):
        raise ConfigurationError("name either --controller or --policy")
    if policy is not None:
        if gains:
            raise ConfigurationError("--gain belongs to --controller: a trained policy has no gains")
        from cablebench.cli.shared.policies import policy_entrant

        return policy_entrant(policy)
    assert controller is not None
    from cablebench.entrants.named import named_entrant

    return named_entrant(controller, parse_gains(gains), sandbox)


def _play(
    env_id: str, options: dict[str, Any], entrant: Any, seed: int, render: Path | None, theme: str, update: Any
) -> Any:
    """(episode, film): None for the film unless a picture is wanted."""
    import gymnasium as gym

    from cablebench.run.evaluation import core_of, run_episode

    options = options_for(entrant, env_id, options)
    film = None if render is None else Film(render.suffix)
    drawn: dict[str, Any] = {"render_mode": "rgb_array", "render_theme": theme} if render else {}
    made = gym.make(env_id, disable_env_checker=True, **drawn, **options)
    watched = _watch(made, film, "" if render is None else render.suffix, update)
    try:
        actor = entrant.make(core_of(made).setup)
        episode = run_episode(watched, actor, seed, settings={"controller": entrant.title, "options": options})
        if film is not None:
            film.append(made.render())
    finally:
        made.close()
    return episode, film


def _watch(env: Any, film: Film | None, suffix: str, update: Any) -> Any:
    """``env`` with a progress report and, for a film, as many pictures a second as files of that suffix have."""
    import gymnasium as gym

    steps = env.unwrapped.setup.steps
    every = max(round(1.0 / (FRAMES_PER_SECOND.get(suffix, 10) * env.unwrapped.setup.control_period)), 1)

    class Watched(gym.Wrapper):
        count = 0

        def step(self, action: Any) -> Any:
            result = super().step(action)
            self.count += 1
            if self.count % every == 0:
                update("running", self.count, steps)
                if film is not None and suffix in FRAMES_PER_SECOND:
                    film.append(self.env.render())
            return result

    return Watched(env)


def _report(env_id: str, entrant: Any, seed: int, episode: Any, score: Any, written: list[str], as_json: bool) -> None:
    from cablebench.protocol.metrics import METRICS, measure

    values = measure(episode)
    if as_json:
        units = {m.name: m.unit_of(episode.output_unit, episode.command_unit) for m in METRICS}
        print_json({"env_id": env_id, "entrant": entrant.name, "information": entrant.information, "seed": seed,
                    "settings": episode.settings, "metrics": values, "units": units,
                    "score": None if score is None else score.as_json(), "files": written})  # fmt: skip
        return
    out = console()
    state = "ran to its end" if episode.complete else "FAILED (cable torn, or state or action not finite)"
    out.print(f"{entrant.title} on {env_id}, seed {seed}: {len(episode.time)} steps, {state}", markup=False)
    _print_metrics(values, episode, out)
    beyond = episode.signals.get("out_of_range")
    if beyond is not None and beyond.any():
        share = 100.0 * float((beyond > 0.0).mean())
        out.print(
            f"{share:.0f} % of it is outside the range that the rig's parameters and the laws hold in", markup=False
        )
    if score is not None:
        out.print(score.said(episode), markup=False)
    for path in written:
        out.print(f"wrote {path}", markup=False)


def _print_metrics(values: dict[str, float], episode: Any, out: Any) -> None:
    import math

    from rich.table import Table
    from rich.text import Text

    from cablebench.protocol.metrics import METRICS
    from cablebench.protocol.units import shown, unit_of

    table = Table(box=None, pad_edge=False, show_header=False)
    for m in METRICS:
        if math.isfinite(values[m.name]) and not m.name.endswith("_censored"):
            bound = "> " if values.get(f"{m.name}_censored") else ""
            number = Text(bound + shown(values[m.name], m.name, episode), justify="right")
            table.add_row(m.label, number, Text(unit_of(m.name, episode)))
    out.print(table)
