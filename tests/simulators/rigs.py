"""A pendulum and a cart, once as a user's simulator and once as reality, which is integrated by SciPy.

The two share nothing but the equations without what is concealed.
"""

from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.simulators import (
    Command,
    Declaration,
    ForcePort,
    FunctionSimulator,
    Output,
    SimulatorParameter,
)

PERIOD = 0.01
GRAVITY, LENGTH = 9.81, 0.5
PENDULUM = Declaration(
    "pendulum", PERIOD,
    (SimulatorParameter("inertia", "kg m^2", 0.105, 0.01, 1.0, std=0.01),
     SimulatorParameter("mass", "kg", 0.41, 0.05, 5.0, std=0.02),
     SimulatorParameter("damping", "N m s/rad", 0.04, 0.0, 1.0, std=0.02)),
    (Command("torque", "N m"),),
    (Output("angle", "rad", starts=True), Output("speed", "rad/s", starts=True)),
    (ForcePort("pivot", "speed", "angle"),),
)  # fmt: skip
CART = Declaration(
    "cart", PERIOD,
    (SimulatorParameter("mass", "kg", 2.1, 0.1, 20.0, std=0.3),
     SimulatorParameter("damping", "N s/m", 1.0, 0.0, 50.0, std=0.5)),
    (Command("force", "N", full=20.0),),
    (Output("position", "m", starts=True), Output("velocity", "m/s", starts=True)),
    (ForcePort("slide", "velocity", "position"),),
)  # fmt: skip


def begun(names, parameters, first):
    """`start` of a FunctionSimulator."""
    count = len(next(iter(parameters.values())))
    state = np.stack([first.get(name, np.zeros(count)) for name in names])
    return state, dict(zip(names, state))


def integrated(names, faster, state, commands, forces, parameters):
    """`run` of a FunctionSimulator: Runge and Kutta's steps of acceleration ``faster(x, v, push, parameters)``."""
    (push,), (added,) = commands.values(), forces.values()
    total = push + added
    x, v = state
    out = np.empty((2, *total.shape))
    h = PERIOD
    for k in range(total.shape[1]):
        f = total[:, k]
        a1 = faster(x, v, f, parameters)
        a2 = faster(x + 0.5 * h * v, v + 0.5 * h * a1, f, parameters)
        a3 = faster(x + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2, f, parameters)
        a4 = faster(x + h * v + 0.5 * h * h * a2, v + h * a3, f, parameters)
        x = x + h * v + h * h / 6.0 * (a1 + a2 + a3)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        out[0, :, k], out[1, :, k] = x, v
    return np.stack([x, v]), dict(zip(names, out))


def _swings(x, v, torque, p):
    return (torque - p["damping"] * v - p["mass"] * GRAVITY * LENGTH * np.sin(x)) / p["inertia"]


def _rolls(x, v, force, p):
    return (force - p["damping"] * v) / p["mass"]


def pendulum(**more):
    names = ("angle", "speed")
    return FunctionSimulator(PENDULUM, partial(begun, names), partial(integrated, names, _swings), **more)


def cart(**more):
    names = ("position", "velocity")
    return FunctionSimulator(CART, partial(begun, names), partial(integrated, names, _rolls), **more)


def chirp(time, size, slow, fast, phase=0.0):
    """A command whose frequency rises, Hz, held from sample to sample."""
    turns = slow * time + 0.5 * (fast - slow) * time**2 / time[-1]
    return size * np.sin(2.0 * np.pi * turns + phase)


class Reality:
    """A body with dry friction, behind a lag: position, speed and what acts of the command, by solve_ivp with events.

    faster: (x, v, push) -> acceleration without friction; level: friction over the inertia; lag: s.
    """

    def __init__(self, faster, level, lag):
        self.faster, self.level, self.lag = faster, level, lag
        self.way, self.push, self.began = 0.0, 0.0, 0.0

    def pull(self, y):
        return self.faster(y[0], y[1], y[2] if self.lag else self.push)

    def slope(self, t, y):
        settles = (self.push - y[2]) / self.lag if self.lag else 0.0
        if self.way == 0.0 and self.level > 0.0:
            return [0.0, 0.0, settles]
        return [y[1], self.pull(y) - self.level * self.way, settles]

    def turns(self, t, y):
        if self.way == 0.0 or self.level == 0.0:
            return 1.0
        return y[1] * self.way + (1e-9 if t <= self.began + 1e-9 else 0.0)

    def breaks(self, t, y):
        return abs(self.pull([y[0], 0.0, y[2]])) - self.level if self.way == 0.0 and self.level > 0.0 else -1.0

    def after(self, y, push, now, stop):
        """State at ``stop``, under a push that does not change until then."""
        self.push = push
        events = [lambda t, y: self.turns(t, y), lambda t, y: self.breaks(t, y)]
        for event, direction in zip(events, (-1, 1)):
            event.terminal, event.direction = True, direction
        while now < stop - 1e-12:
            self.began = now
            if self.way == 0.0:
                pull = self.pull([y[0], 0.0, y[2]])
                self.way = np.sign(pull) if abs(pull) > self.level else 0.0
            done = solve_ivp(self.slope, (now, stop), y, events=events, rtol=1e-9, atol=1e-11, max_step=PERIOD)
            y, now = list(done.y[:, -1]), done.t[-1]
            if len(done.t_events[0]):
                y[1] = 0.0
            if done.status == 1:
                self.way = 0.0
        return y


def real(time, command, faster, start=(0.0, 0.0), coulomb=0.0, inertia=1.0, lag=0.0, delay=0.0):
    """Positions and speeds [T] of reality; the command is held from sample to sample and acts ``delay`` s later."""
    rig = Reality(faster, coulomb / inertia, lag)
    y, out, rig.way = [*start, command[0]], [list(start)], np.sign(start[1])
    late, part = int(delay / PERIOD + 1e-9), delay % PERIOD
    asked = np.concatenate([np.full(late + 1, command[0]), command])
    for k in range(len(time) - 1):
        if part > 1e-9:
            y = rig.after(y, asked[k], time[k], time[k] + part)
        y = rig.after(y, asked[k + 1], time[k] + (part if part > 1e-9 else 0.0), time[k + 1])
        out.append(y[:2])
    return np.array(out).T


def recording(system_records, units, noise, name="memory", heldout=("other",), hold=()):
    return Recording.from_arrays(
        "own",
        system_records,
        units=units,
        noise=noise,
        heldout=heldout,
        name=name,
        channels={channel: {"hold": "step"} for channel in hold},
    )


def pendulum_records(
    seed=0, seconds=8.0, noise=5e-4, mass=0.4, inertia=0.1, damping=0.05, spring=0.0, scale=1.0, **concealed
):
    """A chirp to fit and another one held out, of a pendulum with what is concealed; angles only."""
    rng, time, runs = np.random.default_rng(seed), np.arange(round(seconds / PERIOD) + 1) * PERIOD, {}
    for run, (size, slow, fast) in {"one": (0.8, 0.2, 1.0), "two": (0.5, 0.1, 0.6), "other": (0.6, 0.15, 0.8)}.items():
        command = chirp(time, size, slow, fast)

        def faster(x, v, torque):
            return (torque - damping * v - mass * GRAVITY * LENGTH * np.sin(x) - spring * x) / inertia

        angle, _ = real(time, command, faster, inertia=inertia, **concealed)
        runs[run] = {"time": time, "torque": command, "angle": scale * angle + rng.normal(0.0, noise, len(time))}
    return recording(runs, {"torque": "N m", "angle": "rad"}, {"angle": noise}, hold=("torque",))


def cart_records(
    seed=0, seconds=8.0, noise=1e-4, mass=2.0, damping=1.2, scale=1.0, spring=0.0, met=(0.0, 0.0), **concealed
):
    """The same of a cart, with its velocity; ``met``: stiffness and place of a spring that it meets going up."""
    rng, time, runs = np.random.default_rng(seed), np.arange(round(seconds / PERIOD) + 1) * PERIOD, {}
    for run, (size, slow, fast) in {"one": (10.0, 0.3, 2.0), "two": (6.0, 0.2, 1.0), "other": (8.0, 0.25, 1.5)}.items():
        command = chirp(time, size, slow, fast, 0.5 * np.pi)

        def faster(x, v, force):
            return (force - damping * v - spring * x - met[0] * max(x - met[1], 0.0)) / mass

        position, velocity = real(time, command, faster, inertia=mass, **concealed)
        runs[run] = {
            "time": time, "force": command, "position": position + rng.normal(0.0, noise, len(time)),
            "velocity": scale * velocity + rng.normal(0.0, 20.0 * noise, len(time)),
        }  # fmt: skip
    units = {"force": "N", "position": "m", "velocity": "m/s"}
    return recording(runs, units, {"position": noise, "velocity": 20.0 * noise}, hold=("force",))
