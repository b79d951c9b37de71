"""Pictures of a running mechanism: tensions in colour, and a live trace of reference, output and tension.

`Renderer` knows no Gymnasium. It draws with matplotlib's Agg canvas (no pyplot, no display): what stands still is
drawn once and kept, so that a frame costs only what moves. matplotlib is imported when a Renderer is made, pygame when
its window is first shown; both come with the extra ``render``. The live web page needs no pygame.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.plants import family_of

if TYPE_CHECKING:
    from cable_envs.drawing.live import Shown
    from cable_envs.sim.setup import Setup

MODES = ("rgb_array", "human", "web")
LISTED = "rgb_array_list"
"""Render mode of a batch that keeps the pictures of all steps; Gymnasium makes it of a single environment by a
wrapper."""

THEMES = ("light", "dark")

_DISPLAY = {  # SI unit of the reference -> unit shown, factor, quantity, least range of the trace in the unit shown
    "m": ("mm", 1e3, "load position", 1.0),
    "N": ("N", 1.0, "load-side tension", 4.0),
    "rad": ("rad", 1.0, "output angle", 0.05),
    "N m": ("N m", 1.0, "output torque", 0.02),
}
_ROWS = 1500  # samples that the trace keeps


class Renderer:
    """Draws one mechanism and a trace of what it did.

    Parameters
    ----------
    plant : str
        Name of a plant: "cable_hole", "pulley_circuit", "pulley_chain", "tendon_sheath".
    rig : mapping of str to float
        Parameters by name, SI. What is missing takes the plant's default look.
    task : str
        A line for the title.
    reference_unit : str
        SI unit of reference and output: "m", "N", "rad" or "N m".
    mode : str
        "rgb_array" for frames only, "human" for a window too, "web" for a live page of this machine.
    window : float
        Length of the trace, s, in [0.1, 3600].
    scale : float
        Size of the frames over 960 x 640 pixels, in [0.25, 8].
    fps : float
        How often the window or page is redrawn per simulated second, in [1, 240].
    theme : str
        "light", or "dark": lightness turned round, hues kept. A live page is dark too where the browser asks for it.

    Raises
    ------
    ConfigurationError
        For an unknown plant, unit or mode, a plant without a scene, and numbers out of range.
    ImportError
        Where matplotlib is missing.
    """

    def __init__(
        self,
        plant: str,
        rig: Mapping[str, float],
        task: str = "",
        reference_unit: str = "m",
        mode: str = "rgb_array",
        *,
        window: float = 12.0,
        scale: float = 1.0,
        fps: float = 30.0,
        theme: str = "light",
    ):
        for kind, value, valid in (
            ("reference unit", reference_unit, _DISPLAY),
            ("render mode", mode, MODES),
            ("theme", theme, THEMES),
        ):
            if value not in valid:
                raise ConfigurationError(f"unknown {kind} '{value}'; {nearest(value, valid)}")
        for name, number, low, high in (
            ("window", window, 0.1, 3600.0),
            ("scale", scale, 0.25, 8.0),
            ("fps", fps, 1.0, 240.0),
        ):
            if not low <= number <= high:
                raise ConfigurationError(f"{name} = {number:g} is outside [{low:g}, {high:g}]")
        self.mode, self.fps, self.theme = mode, fps, theme
        self._picture = _Picture(plant, rig, task, reference_unit, window, scale)
        self._window: Shown | None = None
        self._history = _History(len(self._picture.curve_signals) + 2, window)
        self._signals: dict[str, float] = dict.fromkeys(_signals_of(plant), 0.0)

    @classmethod
    def for_setup(cls, setup: "Setup", mode: str, theme: str = "light") -> "Renderer":
        """The renderer of an environment.

        Parameters
        ----------
        setup : Setup
            What defines the environment.
        mode : str
            "rgb_array", "human" or "web".
        theme : str
            "light" or "dark".

        Returns
        -------
        Renderer
            With the task, the kind of reference and the rig in its title.
        """
        kind = setup.reference.get("kind", "")
        task = f"{setup.task.name}, {kind}, rig {setup.rig.name}"
        return cls(setup.plant.name, setup.rig.values, task, setup.output_unit, mode, theme=theme)

    def push(self, signals: Mapping[str, float], time: float, reference: float, output: float) -> None:
        """Store the state after a control step.

        Parameters
        ----------
        signals : mapping of str to float
            Signals of the plant by name, SI. Those that are missing keep their last value, at first 0.
        time : float
            Time since the episode began, s. An earlier time than the last one clears the trace.
        reference, output : float
            In the unit of the reference.
        """
        self._signals.update(signals)
        tensions = [self._signals[name] for name in self._picture.curve_signals]
        self._history.add(time, (reference, output, *tensions))

    def frame(self) -> np.ndarray:
        """The present picture.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            A new array in RGB at every call; 640 x 960 pixels at scale 1.
        """
        picture = self._light()
        return darkened(picture) if self.theme == "dark" else picture

    def _light(self) -> np.ndarray:
        return self._picture.draw(self._signals, self._history)

    @property
    def address(self) -> str | None:
        """Where the live page is, once it is shown; None of a renderer that has none."""
        return getattr(self._window, "address", None)

    def show(self) -> None:
        """Bring the window or page up to date, at most ``fps`` times per simulated second and no faster than real time.

        It handles the window's events at every call. Once the user has closed the window, it does nothing.

        Raises
        ------
        ConfigurationError
            Where the renderer was made for frames only.
        ImportError
            Where pygame is missing.
        """
        if self.mode == "rgb_array":
            raise ConfigurationError("this renderer was made with mode 'rgb_array'; a window needs mode 'human'")
        if self._window is None:
            from cable_envs.drawing import live

            web = self.mode == "web"
            dark = {"dark": self.theme == "dark"} if web else {}
            self._window = (live.WebPage if web else live.Window)(self._picture.caption, self.fps, **dark)
        # a page turns the lightness round itself, as whoever looks at it wants
        self._window.show(self._history.time, self._light if self.mode == "web" else self.frame)

    def reset(self) -> None:
        """Forget the trace."""
        self._history.clear()

    def close(self) -> None:
        """Close the window or page, if there is one. It may be called more than once."""
        if self._window is not None:
            self._window.close()
            self._window = None


class BatchRenderer:
    """Pictures of a batch: a `Renderer` for each environment that is drawn, made when it is first drawn.

    Parameters
    ----------
    setup : Setup
        What defines the environments.
    mode : str, optional
        "rgb_array", "rgb_array_list", "human" or "web". A window or page shows the first of ``lanes``.
    theme : str
        "light" or "dark".
    lanes : sequence of int
        Environments that are drawn.

    Attributes
    ----------
    renderers : dict of int to Renderer
        Those that were made, by environment.
    frames : dict of int to list of ndarray
        Pictures since the last `pictures`, by environment, in the mode "rgb_array_list".
    """

    def __init__(self, setup: "Setup", mode: str | None, theme: str = "light", lanes: Sequence[int] = ()):
        self.setup, self.mode, self.theme = setup, mode, theme
        self.shown = mode in ("human", "web")
        self.lanes = tuple(lanes[:1] if self.shown else lanes)
        self.renderers: dict[int, Renderer] = {}
        self.frames: dict[int, list[np.ndarray]] = {}

    def draw(self, names: Sequence[str], table: np.ndarray) -> None:
        """Take in the present state of the environments.

        Parameters
        ----------
        names : sequence of str
            Entries of an info.
        table : ndarray, shape (len(names), number of environments)
            Their values, SI.
        """
        for lane in self.lanes:
            if lane not in self.renderers:
                mode = str(self.mode) if self.shown else "rgb_array"
                self.renderers[lane] = Renderer.for_setup(self.setup, mode, self.theme)
            renderer = self.renderers[lane]
            now = dict(zip(names, table[:, lane].tolist(), strict=True))
            if now["time"] == 0.0:
                renderer.reset()
            renderer.push(now, now["time"], now["reference"], now["output"])
            if self.mode == LISTED:
                self.frames.setdefault(lane, []).append(renderer.frame())
            if self.shown:
                renderer.show()

    def pictures(self) -> tuple[Any, ...] | None:
        """An entry for each environment that is drawn: its picture, or the list of those since the last call.

        None where a window or page shows them.
        """
        if self.shown:
            return None
        if self.mode == LISTED:
            frames, self.frames = self.frames, {}
            return tuple(frames.get(lane, []) for lane in self.lanes)
        return tuple(self.renderers[lane].frame() for lane in self.lanes)

    def close(self) -> None:
        """Close the window or page, if there is one."""
        for renderer in self.renderers.values():
            renderer.close()
        self.renderers = {}


def darkened(picture: np.ndarray) -> np.ndarray:
    """A frame with its lightness (of the colour model HSL) turned round: white becomes a dark grey, hues stay."""
    wide = picture.astype(np.int16)
    turned = wide + (255 - wide.max(axis=2) - wide.min(axis=2))[..., None]
    return (20 + turned * 9 // 10).astype(np.uint8)


def _signals_of(plant: str) -> tuple[str, ...]:
    """The signals that a scene cannot do without; they are zero until something is pushed."""
    return family_of(plant).shown


class _History:
    """A ring of the last samples: row 0 time, then reference, output and tensions."""

    def __init__(self, width: int, window: float):
        self._ring = np.full((width + 1, _ROWS), np.nan)
        self._window, self._spacing = window, window / (_ROWS - 1)
        self.clear()

    def clear(self) -> None:
        self._count, self.time = 0, 0.0

    def add(self, time: float, values: tuple[float, ...]) -> None:
        """Append; samples closer than the trace can show replace the newest one."""
        if self._count and time < self.time:
            self.clear()
        self.time = time
        last = self._ring[0]
        if self._count < 2 or last[(self._count - 1) % _ROWS] - last[(self._count - 2) % _ROWS] >= self._spacing:
            self._count += 1
        column = self._ring[:, (self._count - 1) % _ROWS]
        column[0], column[1:] = time, values

    def latest(self) -> np.ndarray:
        """The newest sample [rows]; zeros before the first."""
        return self._ring[:, (self._count - 1) % _ROWS] if self._count else np.zeros(len(self._ring))

    def visible(self) -> np.ndarray:
        """Samples in the window, oldest first [rows, n]."""
        stored = min(self._count, _ROWS)
        order = np.arange(self._count - stored, self._count) % _ROWS
        rows = self._ring[:, order]
        return rows[:, rows[0] >= self.time - self._window]


class _Picture:
    """Scene, header and two traces; laid out anew when a ruler or the tension scale must grow."""

    def __init__(self, plant: str, rig: Mapping[str, float], task: str, unit: str, window: float, scale: float):
        try:
            from cable_envs.drawing import draw as render_draw
            from cable_envs.drawing import widgets as render_widgets

            scene = family_of(plant).draws()
        except ImportError as error:
            raise ImportError("rendering needs matplotlib: pip install 'cable-envs[render]'") from error
        self._draw, self._widgets = render_draw, render_widgets
        self._scene = scene(rig, unit)
        self.curve_signals = self._scene.curve_signals
        kind = self._scene.title if plant == family_of(plant).name else f"{self._scene.title} ({plant.split('_')[-1]})"
        self.caption = f"{kind}: {task}" if task else kind
        self._unit, self._factor, self._quantity, self._least = _DISPLAY[unit]
        self._sheet = render_draw.Sheet(scale)
        self._span = window
        self._digits = {"mm": ".2f", "N": ".1f"}.get(self._unit, ".3f")
        self._motion = render_draw.nice_range(0.0, 0.0, self._scene.least_motion)
        self._tension = render_draw.nice_range(0.0, self._scene.first_tension, self._scene.least_tension)[1]
        self._laid_out: Any = None

    def draw(self, signals: Mapping[str, float], history: _History) -> np.ndarray:
        """Frame uint8 [height, width, 3] of ``signals`` (values that are not finite are shown as zero)."""
        shown = {k: float(v) if math.isfinite(v) else 0.0 for k, v in signals.items()}
        _, reference, output, *_ = np.nan_to_num(history.latest(), posinf=0.0, neginf=0.0)
        self._widen(shown, reference)
        if self._laid_out != (self._motion, self._tension):
            self._lay_out()
        self._scene.update(shown, reference)
        self._clock.set(f"t = {history.time:.2f} s")
        samples = history.visible()
        samples[~np.isfinite(samples)] = np.nan  # a gap in the line
        age = samples[0] - history.time
        error = self._widgets.number(self._factor * (reference - output), self._digits)
        self._panels[0].set(age, self._factor * samples[1:3], f"error {error} {self._unit}")
        self._panels[1].set(age, samples[3:], "")
        return self._sheet.picture()

    def _widen(self, signals: Mapping[str, float], reference: float) -> None:
        """Rulers and tension scale hold what is to be shown; they never shrink, and grow with room to spare."""
        scene, nice = self._scene, self._draw.nice_range
        motion = list(scene.motion(signals))
        if motion and self._unit == "mm":
            motion.append(1e3 * reference)
        if motion and (min(motion) < self._motion[0] or max(motion) > self._motion[1]):
            self._motion = nice(min(1.5 * min(motion), self._motion[0]), max(1.5 * max(motion), self._motion[1]), 0.0)
        highest = max(scene.tensions(signals))
        if highest > self._tension:
            self._tension = nice(0.0, 1.2 * highest, scene.least_tension)[1]

    def _lay_out(self) -> None:
        """Draw what stands still. Under matplotlib's own defaults, whatever style the user has set."""
        import matplotlib

        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update({"hatch.linewidth": 0.6, "hatch.color": self._draw.METAL_EDGE})
            self._sheet.clear()
            self._scene.build(self._sheet, self._motion, self._tension)
            self._build_header_and_traces()
            self._sheet.keep()
        self._laid_out = self._motion, self._tension

    def _build_header_and_traces(self) -> None:
        draw, widgets, scene, sheet = self._draw, self._widgets, self._scene, self._sheet
        width, height = draw.SIZE
        widgets.Label(sheet, 24, height - 28, self.caption, draw.LARGE, weight="bold")
        self._clock = widgets.Label(sheet, width - 24, height - 28, "", draw.LARGE, ha="right", moving=True)
        first = widgets.Curve("reference", draw.REFERENCE, (0, (4, 2))), widgets.Curve("output", draw.OUTPUT)
        parts = (
            (first, f"{scene.shows or self._quantity} ({self._unit})", self._least),
            (scene.curves, scene.pulls, scene.least_tension),
        )
        self._panels = [
            widgets.TracePanel(sheet, box, curves, label, self._span, least)
            for box, (curves, label, least) in zip(scene.trace_boxes, parts, strict=True)
        ]
