"""The picture of a diagnosis in README: a recording, and its prediction without and with the effects that were named.

Run ``python docs/pictures/diagnosis.py`` (about a minute); it writes diagnosis.svg beside itself. The recording is the
one of examples/diagnose_and_retrain.py: a cable circuit whose drive lags and whose coupling has backlash, played by an
independent simulator. The record shown is the one that was held out: no parameter was fitted to it.
"""

import importlib.util
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import gymnasium as gym
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from cable_envs.diagnosis import diagnose
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.drawing.compact_svg import compact_svg
from cable_envs.sim.registered import setup_of
from cablebench.export.concealed import write_concealed

HERE = Path(__file__).parent
FILE = HERE / "diagnosis.svg"
SHOWN = (4.0, 14.0)
"""s of the record."""


def example() -> ModuleType:
    """examples/diagnose_and_retrain.py."""
    spec = importlib.util.spec_from_file_location("retrain", HERE.parents[1] / "examples" / "diagnose_and_retrain.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def predicted(env_id: str, rig: Any, times: np.ndarray, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and angles of the output, in s and rad, that a simulator of ``rig`` answers to the recorded commands."""
    env = gym.make(env_id, rig=rig, plant="chain", duration=float(np.floor(times[-1])), disable_env_checker=True)
    env.reset(seed=0)
    setup, found, done = env.unwrapped.setup, [], False
    while not done:
        command = np.interp(len(found) * setup.control_period, times, commands)
        action = 2.0 * (command - setup.low) / (setup.high - setup.low) - 1.0
        *_, done, info = env.step(np.array([action], np.float32))
        found.append((info["time"], info["output_angle"]))
    env.close()
    seconds, angles = np.array(found).T
    return seconds, angles


def draw(recording: Recording, env_id: str, rigs: dict[str, Any], file: Path) -> None:
    """Angle and error of the held-out record, by simulator."""
    record = next(r for r in recording.records if r.use == "heldout")
    time, angle = record.time, record.data["output_angle"]
    inside = (time >= SHOWN[0]) & (time <= SHOWN[1])
    mpl.rcParams.update({"svg.hashsalt": "diagnosis", "svg.fonttype": "none", "font.size": 9})
    figure, (above, below) = plt.subplots(2, 1, figsize=(8.2, 3.9), sharex=True, height_ratios=(3, 2))
    above.plot(time[inside][::5], angle[inside][::5], ".", color="#888888", ms=4, label="recording")
    for (name, rig), colour in zip(rigs.items(), ("#d1495b", "#00798c"), strict=True):
        seconds, found = predicted(env_id, rig, time, record.data["drive_angle_command"])
        part = (seconds >= SHOWN[0]) & (seconds <= SHOWN[1])
        error = 1e3 * (np.interp(seconds, time, angle) - found)
        label = f"{name}: {np.sqrt(np.mean(error[part] ** 2)):.1f} mrad RMS"
        above.plot(seconds[part][::4], found[part][::4], color=colour, lw=1.3, label=label)
        below.plot(seconds[part][::4], error[part][::4], color=colour, lw=1.0)
    above.set_ylabel("jaw angle [rad]")
    below.set_ylabel("error [mrad]")
    below.set_xlabel("time [s]")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})
    file.write_text(compact_svg(file.read_text(encoding="utf-8")) + "\n", encoding="utf-8")
    plt.close(figure)


def main(folder: Path) -> None:
    """Write `FILE`; ``folder`` keeps recording and answer, and is used again where it holds them."""
    made = example()
    if not (folder / "recording").exists():
        write_concealed(setup_of(made.ENV_ID, made.HIDDEN), made.MOTIONS, made.NOMINAL, folder / "recording", 25.0, 0)
    if not (folder / "answer" / "augmented.yaml").exists():
        diagnose(folder / "recording").write(folder / "answer")
    rigs = {"simulator as it was": made.NOMINAL, "with the named effects": str(folder / "answer" / "augmented.yaml")}
    draw(load_recording(folder / "recording"), made.ENV_ID, rigs, FILE)
    print(f"wrote {FILE}: {FILE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with TemporaryDirectory() as kept:
            main(Path(kept))
