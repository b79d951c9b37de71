"""``cablebench run``: one episode of one controller or policy, its metrics, its data, its picture."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from cable_envs.core.errors import ConfigurationError, nearest
from cablebench.cli.shared.arguments import options_for, parse_gains, parse_options, resolve_env
from cablebench.cli.shared.output import console, print_json, progress_bar
from cablebench.cli.shared.trust import Trusted, Walls

DATA_FORMATS = (".npz", ".csv")
PICTURE_FORMATS = (".png", ".gif")

FRAMES_PER_SECOND = 10
"""of an animation, in simulated time"""


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
    render: Annotated[Path | None, typer.Option(help="Picture of the end (FILE.png) or animation (FILE.gif).")] = None,
    sandbox: Walls = "auto",
    trust: Trusted = False,
    as_json: Annotated[bool, typer.Option("--json", help="Metrics as JSON on standard output.")] = False,
) -> None:
    """Run one episode and print its metrics in SI units."""
    _check_suffix(save, DATA_FORMATS, "--save")
    _check_suffix(render, PICTURE_FORMATS, "--render")
    env_id = resolve_env(env)
    options = parse_options(option or ())
    entrant = choose_entrant(controller, policy, gain or (), sandbox)
    with progress_bar() as update:
        episode, film = _play(env_id, options, entrant, seed, render, update)
    written = [str(path) for path, content in _files(episode, save, render, film) if _write(path, content)]
    _report(env_id, entrant, seed, episode, written, as_json)


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


def _play(env_id: str, options: dict[str, Any], entrant: Any, seed: int, render: Path | None, update: Any) -> Any:
    """(episode, frames): frames is empty unless a picture is wanted."""
    import gymnasium as gym

    from cablebench.run.evaluation import core_of, run_episode

    options = options_for(entrant, env_id, options)
    made = gym.make(env_id, disable_env_checker=True, render_mode="rgb_array" if render else None, **options)
    film: list[Any] = []
    watched = _watch(made, film, render is not None and render.suffix == ".gif", update)
    try:
        actor = entrant.make(core_of(made).setup)
        episode = run_episode(watched, actor, seed, settings={"controller": entrant.title, "options": options})
        if render is not None:
            film.append(made.render())
    finally:
        made.close()
    return episode, film


def _watch(env: Any, film: list[Any], animate: bool, update: Any) -> Any:
    """``env`` with a progress report and, for an animation, a frame every 1 / FRAMES_PER_SECOND s."""
    import gymnasium as gym

    steps = env.unwrapped.setup.steps
    every = max(round(1.0 / (FRAMES_PER_SECOND * env.unwrapped.setup.control_period)), 1)

    class Watched(gym.Wrapper):
        count = 0

        def step(self, action: Any) -> Any:
            result = super().step(action)
            self.count += 1
            if self.count % every == 0:
                update("running", self.count, steps)
                if animate:
                    film.append(self.env.render())
            return result

    return Watched(env)


def _check_suffix(path: Path | None, known: tuple[str, ...], flag: str) -> None:
    if path is not None and path.suffix not in known:
        raise ConfigurationError(f"{flag} {path}: unknown format '{path.suffix}'; {nearest(path.suffix, known)}")


def _files(episode: Any, save: Path | None, render: Path | None, film: list[Any]) -> list[tuple[Path, bytes]]:
    files = []
    if save is not None:
        files.append((save, (_npz if save.suffix == ".npz" else _csv)(episode)))
    if render is not None:
        files.append((render, _picture(film, render.suffix)))
    return files


def _write(path: Path, content: bytes) -> Path:
    from cable_envs.core.files import write_atomic

    try:
        return write_atomic(path, content)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror or error}") from error


def _columns(episode: Any) -> dict[str, Any]:
    """Arrays of the episode by "name [unit]"."""
    import gymnasium as gym

    units = _signal_units(gym.spec(episode.settings["env_id"]).kwargs["task"])
    y, u = episode.output_unit, episode.command_unit
    own = {"time": "s", "reference": y, "output": y, "command": u, "reward": "1", "inference": "s"}
    columns = {f"{name} [{unit}]": getattr(episode, name) for name, unit in own.items()}
    return columns | {f"{name} [{units.get(name, '1')}]": values for name, values in episode.signals.items()}


def _signal_units(task: str) -> dict[str, str]:
    from cable_envs.sim.setup import make_setup

    return {s.name: s.unit for s in make_setup(task, "step").plant.signals}


def _csv(episode: Any) -> bytes:
    """One row for each control step; the first line holds names with units."""
    columns = _columns(episode)
    lines = [",".join(columns)]
    lines += [",".join(f"{v:.9g}" for v in row) for row in zip(*columns.values(), strict=True)]
    return ("\n".join(lines) + "\n").encode()


def _npz(episode: Any) -> bytes:
    """Arrays by name, and under "about" what produced them as JSON, units included."""
    import numpy as np

    from cable_envs.core.files import jsonable

    named = {key.split(" [")[0]: (key.split(" [")[1][:-1], values) for key, values in _columns(episode).items()}
    about = {**episode.settings, "units": {name: unit for name, (unit, _) in named.items()}}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, about=json.dumps(jsonable(about)), **{name: values for name, (_, values) in named.items()}
    )
    return buffer.getvalue()


def _picture(film: list[Any], suffix: str) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    images = [Image.fromarray(frame) for frame in film]
    if suffix == ".png":
        images[-1].save(buffer, "PNG")
    else:
        images = [image.convert("P", palette=Image.Palette.ADAPTIVE, colors=64) for image in images]
        images[0].save(
            buffer, "GIF", save_all=True, append_images=images[1:], duration=1000 // FRAMES_PER_SECOND, loop=0
        )
    return buffer.getvalue()


def _report(env_id: str, entrant: Any, seed: int, episode: Any, written: list[str], as_json: bool) -> None:
    from cablebench.protocol.metrics import METRICS, measure

    values = measure(episode)
    units = {m.name: m.unit_of(episode.output_unit, episode.command_unit) for m in METRICS}
    if as_json:
        print_json({"env_id": env_id, "entrant": entrant.name, "information": entrant.information, "seed": seed,
                    "settings": episode.settings, "metrics": values, "units": units, "files": written})  # fmt: skip
        return
    out = console()
    state = "ran to its end" if episode.complete else "FAILED (cable torn, or state or action not finite)"
    out.print(f"{entrant.title} on {env_id}, seed {seed}: {len(episode.time)} steps, {state}", markup=False)
    _print_metrics(values, units, out)
    for path in written:
        out.print(f"wrote {path}", markup=False)


def _print_metrics(values: Mapping[str, float], units: Mapping[str, str], out: Any) -> None:
    import math

    from rich.table import Table
    from rich.text import Text

    from cable_envs.core.text import number
    from cablebench.protocol.metrics import METRICS

    table = Table(box=None, pad_edge=False, show_header=False)
    for m in METRICS:
        if math.isfinite(values[m.name]) and not m.name.endswith("_censored"):
            bound = "> " if values.get(f"{m.name}_censored") else ""
            unit = "" if units[m.name] == "1" else units[m.name]
            table.add_row(m.label, Text(bound + number(values[m.name]), justify="right"), Text(unit))
    out.print(table)
