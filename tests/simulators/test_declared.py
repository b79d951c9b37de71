"""What a user states of a simulator, what is refused, and what the simulators of each kind do with it."""

import gymnasium
import numpy as np
import pytest

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis import Recording, diagnose, load_recording
from cable_envs.diagnosis.simulators import (
    Action,
    Attribute,
    Command,
    Declaration,
    ForcePort,
    FunctionSimulator,
    GymSimulator,
    Observation,
    Output,
    SimulatorParameter,
)
from cable_envs.diagnosis.simulators.base import load_simulator
from tests.simulators.rigs import CART, PENDULUM, PERIOD, cart, pendulum, real

MASS = SimulatorParameter("mass", "kg", 2.0, 0.1, 10.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SimulatorParameter("mass", "", 2.0, 0.1, 10.0), "parameter 'mass': its unit is missing"),
        (lambda: SimulatorParameter("mass", "g", 2.0, 0.1, 10.0), "expected an SI unit, kg in the place of g"),
        (lambda: SimulatorParameter("mass", "kg", None, 0.1, 10.0), "nominal must be a finite number, got None"),
        (lambda: SimulatorParameter("mass", "kg", 20.0, 0.1, 10.0), "low <= nominal <= high"),
        (
            lambda: SimulatorParameter("mass", "kg", 2.0, 0.1, 10.0, std=0.0),
            "std must be a positive number or left out",
        ),
        (lambda: Declaration("c", 0.01, (), CART.commands, CART.outputs), "declares no parameters"),
        (lambda: Declaration("c", None, (MASS,), CART.commands, CART.outputs), "period must be positive seconds"),
        (lambda: Declaration("c", 0.01, (MASS, MASS), CART.commands, CART.outputs), "'mass' is declared twice"),
        (
            lambda: Declaration("c", 0.01, (MASS,), CART.commands, CART.outputs, (ForcePort("p", "speed"),)),
            "unknown velocity of port 'p' of simulator 'c': output 'speed'",
        ),
        (
            lambda: Declaration("c", 0.01, (MASS,), CART.commands, CART.outputs, (ForcePort("p", "position"),)),
            "its velocity is in m/s or rad/s, not in m",
        ),
    ],
)
def test_what_is_not_stated_or_cannot_be_meant_is_named(make, message):
    with pytest.raises(ConfigurationError) as error:
        make()
    assert message in str(error.value)


def _records(**more):
    time = np.arange(400) * PERIOD
    force = np.sin(3.0 * time)
    data = {"time": time, "force": force, "position": cart().simulate({"force": force[:-1]})["position"]}
    return Recording.from_arrays("own", data, **{"units": {"force": "N", "position": "m"}, **more})


def test_a_recording_that_does_not_fit_its_simulator_is_refused():
    with pytest.raises(ConfigurationError, match="channel position: its unit must be stated"):
        _records(units={"force": "N"})
    with pytest.raises(ConfigurationError, match="needs its simulator"):
        diagnose(_records())
    with pytest.raises(ConfigurationError, match="channel 'position' is in rad, and 'cart' declares m"):
        diagnose(_records(units={"force": "N", "position": "rad"}), simulator=cart())
    with pytest.raises(ConfigurationError, match="channel 'force' is neither a command nor an output of 'pendulum'"):
        diagnose(_records(), simulator=pendulum())
    with pytest.raises(ConfigurationError, match="parameters of a simulator of your own are declared by it"):
        _records(nominal={"mass": 2.0})
    with pytest.raises(ConfigurationError, match="unknown effect 'coulomb'"):
        diagnose(_records(), simulator=cart(), effects=["coulomb"])
    with pytest.raises(ConfigurationError, match="a rig does not go with a simulator of your own"):
        diagnose(_records(), simulator=cart(), rig={"schema": "cable-rig/1"})
    slow = Declaration("cart", 0.004, CART.parameters, CART.commands, CART.outputs, CART.ports)
    with pytest.raises(ConfigurationError, match=r"a sample every 0.01 s is no whole number of the steps"):
        diagnose(_records(), simulator=FunctionSimulator(slow, cart()._start, cart()._run))


def test_a_recording_of_a_simulator_is_written_and_read(tmp_path):
    there = load_recording(_records(channels={"force": {"hold": "step"}}).write(tmp_path / "rig"))
    assert there.system == "own"
    assert there.channels["position"].si_unit == "m" and there.holds("force")


def test_a_simulator_that_fails_at_its_nominal_parameters_is_said_to():
    def run(state, commands, forces, parameters):
        raise OverflowError("the solver gave up")

    with pytest.raises(ConfigurationError, match=r"'cart' fails at its nominal parameters: OverflowError: the solver"):
        diagnose(_records(), simulator=FunctionSimulator(CART, cart()._start, run))

    def nothing(state, commands, forces, parameters):
        state, outputs = cart()._run(state, commands, forces, parameters)
        return state, {name: np.full_like(series, np.nan) for name, series in outputs.items()}

    with pytest.raises(ConfigurationError, match=r"force at port 'slide'|fails at its nominal parameters"):
        diagnose(_records(), simulator=FunctionSimulator(CART, cart()._start, nothing))

    def lacking(state, commands, forces, parameters):
        state, outputs = cart()._run(state, commands, forces, parameters)
        return state, {"position": outputs["position"]}

    with pytest.raises(ConfigurationError, match="run of simulator 'cart' gives no output 'velocity'"):
        diagnose(_records(), simulator=FunctionSimulator(CART, cart()._start, lacking))


def test_functions_that_cannot_be_shared_among_workers_are_refused():
    def run(*given):
        return cart()._run(*given)

    with pytest.raises(ConfigurationError, match="cannot be given to several workers"):
        diagnose(_records(), simulator=FunctionSimulator(CART, cart()._start, run, workers=2))


def _rig(effects):
    return {"schema": "cable-simulator/1", "simulator": "cart", "parameters": {"mass": 2.0, "damping": 1.2},
            "effects": effects}  # fmt: skip


@pytest.mark.parametrize(
    ("effects", "concealed", "tolerance"),
    [
        ({"coulomb_friction": {"slide.level": 1.5}}, {"coulomb": 1.5}, 2e-5),
        ({"actuator_lag": {"force.time": 0.02}}, {"lag": 0.02}, 1e-4),  # even over steps of 10 ms
        ({"command_delay": {"force.time": 0.025}}, {"delay": 0.025}, 1e-4),
    ],
)
def test_a_corrected_simulator_moves_as_reality_does(effects, concealed, tolerance):
    """Against SciPy's solver with located events, over a way of metres."""
    time = np.arange(400) * PERIOD
    force = 10.0 * np.sin(2.0 * np.pi * 0.7 * time + 0.3)

    def faster(x, v, push):
        return (push - 1.2 * v) / 2.0

    position, _ = real(time, force, faster, inertia=2.0, **concealed)
    seen = cart().corrected(_rig(effects)).simulate({"force": force[:-1]})
    assert np.max(np.abs(seen["position"] - position)) < tolerance * np.ptp(position)
    plain = cart().corrected(_rig({})).simulate({"force": force[:-1]})
    assert np.max(np.abs(plain["position"] - position)) > 100.0 * tolerance * np.ptp(position)


def test_laws_of_commands_and_sensors_are_their_equations():
    force = np.linspace(-10.0, 10.0, 401)
    both = {"command_dead_band": {"force.width": 4.0}, "command_saturation": {"force.limit": 6.0}}
    acts = np.clip(np.maximum(force - 2.0, 0.0) + np.minimum(force + 2.0, 0.0), -6.0, 6.0)
    seen = cart().corrected(_rig(both)).simulate({"force": force})
    plain = cart().corrected(_rig({})).simulate({"force": acts})
    assert np.allclose(seen["position"], plain["position"], rtol=0.0, atol=1e-12)
    sagging = cart().corrected(_rig({"supply_droop": {"force.droop": 0.2}})).simulate({"force": force})
    less = cart().corrected(_rig({})).simulate({"force": force * (1.0 - 0.2 * np.abs(force) / 20.0)})
    assert np.allclose(sagging["position"], less["position"], rtol=0.0, atol=1e-12)
    shown = cart().corrected(_rig({"sensor_scale": {"position": 1.1}, "sensor_bias": {"position": 0.3},
                                   "sensor_drift": {"position": 0.01}})).simulate({"force": acts})  # fmt: skip
    time = PERIOD * np.arange(402)
    assert np.allclose(shown["position"], 1.1 * plain["position"] + 0.3 + 0.01 * time, rtol=0.0, atol=1e-12)
    stepped = cart().corrected(_rig({"sensor_step": {"position": 0.05}})).simulate({"force": acts})["position"]
    assert (
        np.allclose(stepped / 0.05, np.round(stepped / 0.05)) and np.max(np.abs(stepped - plain["position"])) <= 0.025
    )


def test_forces_at_a_port_are_their_equations():
    """A spring and drag, against the same simulator with both written into it."""
    time = np.arange(400) * PERIOD
    force = 10.0 * np.sin(2.0 * np.pi * 0.7 * time)

    def faster(x, v, push):
        return (push - 1.2 * v - 8.0 * x - 0.5 * v * abs(v)) / 2.0

    position, _ = real(time, force, faster)
    rig = _rig({"position_dependent_load": {"slide.stiffness": 8.0}, "quadratic_drag": {"slide.coefficient": 0.5}})
    seen = cart().corrected(rig).simulate({"force": force[:-1]})["position"]
    assert np.max(np.abs(seen - position)) < 1e-4 * np.ptp(position)  # steps of 10 ms


class Swing(gymnasium.Env):
    """A pendulum that takes torques as actions; its state is an attribute."""

    action_space = gymnasium.spaces.Box(-10.0, 10.0, (1,), np.float64)
    observation_space = gymnasium.spaces.Box(-100.0, 100.0, (2,), np.float64)

    def __init__(self):
        self.inertia, self.mass, self.damping, self.state = 0.1, 0.4, 0.05, np.zeros(2)
        self.whole = pendulum()

    def reset(self, *, seed=None, options=None):
        self.state = np.zeros(2)
        return self.state.copy(), {}

    def step(self, action):
        names = {"inertia": self.inertia, "mass": self.mass, "damping": self.damping}
        columns = {name: np.array([value]) for name, value in names.items()}
        zero = {"pivot": np.zeros((1, 1))}
        given = (self.state[:, None], {"torque": np.asarray(action).reshape(1, 1)}, zero, columns)
        self.state = self.whole._run(*given)[0][:, 0]
        return self.state.copy(), 0.0, False, abs(self.state[0]) > 50.0, {}


def swing(**more):
    places = {
        "parameters": {p.name: Attribute(p.name) for p in PENDULUM.parameters}, "commands": {"torque": Action(0)},
        "outputs": {"angle": Observation(0), "speed": lambda env: env.state[1]}, "forces": {"pivot": Action(0)},
        "starts": {"angle": Attribute("state", 0), "speed": Attribute("state", 1)},
    }  # fmt: skip
    return GymSimulator(PENDULUM, Swing, **{**places, **more})


def test_an_environment_moves_as_the_same_pendulum_and_takes_physics_at_its_ports():
    torque = 0.5 * np.sin(0.05 * np.arange(200))
    given = ({"torque": torque}, {"mass": 0.45}, {"angle": 0.2, "speed": -0.1})
    assert np.allclose(swing().simulate(*given)["angle"], pendulum().simulate(*given)["angle"], rtol=0.0, atol=1e-12)
    rig = {
        "schema": "cable-simulator/1",
        "simulator": "pendulum",
        "effects": {"coulomb_friction": {"pivot.level": 0.05}},
    }
    seen = [one.corrected(rig).simulate(*given)["angle"] for one in (swing(), pendulum())]
    assert np.allclose(*seen, rtol=0.0, atol=1e-9)
    with pytest.raises(ConfigurationError, match="commands: 'torque' is declared and needs Action, got None"):
        swing(commands={})
    with pytest.raises(ConfigurationError, match="its episode ended"):
        swing().simulate({"torque": np.full(3000, 9.0)})


def test_a_simulator_is_loaded_from_a_file(tmp_path):
    file = tmp_path / "my_cart_of_tests.py"
    file.write_text("from tests.simulators.rigs import cart as make\nthing = 1\n")
    assert load_simulator(f"{file}:make").declaration == CART
    with pytest.raises(ConfigurationError, match="has no 'maker'; did you mean 'make'"):
        load_simulator(f"{file}:maker")
    with pytest.raises(ConfigurationError, match="'thing' gives a int, expected a Simulator"):
        load_simulator(f"{file}:thing")
    with pytest.raises(ConfigurationError, match=r"expected FILE.py:NAME"):
        load_simulator(str(file))


def test_another_augmented_file_is_refused():
    with pytest.raises(ConfigurationError, match="belongs to simulator 'cart', not to 'pendulum'"):
        pendulum().corrected(_rig({}))
    with pytest.raises(ConfigurationError, match=r"expected an augmented\.yaml of schema"):
        pendulum().corrected({"schema": "cable-rig/1"})


def test_a_command_without_a_port_still_has_its_effects():
    alone = Declaration("cart", PERIOD, CART.parameters, (Command("force", "N"),), (Output("position", "m"),))
    from cable_envs.diagnosis.simulators.asking import NO_PORT, NO_SUPPLY, Sizes, candidates
    from cable_envs.diagnosis.systems.question import Request

    asked, _ = candidates(alone, Sizes({}, {"force": 10.0}, {"position": 1.0}, 5.0), {}, Request())
    names = {h.name for h in asked.asked}
    assert {"actuator_lag.force", "command_saturation.force", "sensor_delay.position"} <= names
    assert asked.not_asked["coulomb_friction"] == NO_PORT and asked.not_asked["supply_droop.force"] == NO_SUPPLY
