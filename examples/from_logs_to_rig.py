"""From three logs to a corrected rig: what does the simulator of this joint leave out?

The sample rig is the joint of an instrument on a bench. Its folder has three small logs (time, command of the drive,
torque at the drive, counts of the encoder at the output): one to fit, one of another motion that no fit sees, and one
at rest. A file says what the columns mean and what is believed of the rig. One effect is in the logs and not in the
simulator. This example looks at the logs, asks what is missing, and asks the corrected rig the same.

    python examples/from_logs_to_rig.py --out sample      # some seconds; sample/left.png is the figure

The same by the command line:

    cablebench new sample joint
    cablebench diagnose joint --out joint-answer
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

from cable_envs.diagnosis import diagnose, load_recording
from cablebench.skeletons import skeleton


def logs(folder: Path) -> None:
    """Copy the sample rig to ``folder`` and say what is in its logs."""
    for path, text in skeleton("sample", "joint")[0].items():
        file = folder / Path(path).name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    for record in load_recording(folder).records:
        angle, torque = record.data["output_angle"], record.data["drive_torque"]
        print(
            f"{record.name:12s} {record.use:8s} {len(record.time)} rows, {record.time[-1]:.0f} s, output "
            f"{angle.min():.3f} to {angle.max():.3f} rad, torque {torque.min():.3f} to {torque.max():.3f} N m"
        )


def ask(folder: Path):
    """What the simulator lacks, how sure that is, and what the answer predicts better on the log that no fit saw."""
    found = diagnose(folder)
    print(found.verdict)
    for effect in found.effects:
        print(f"  {effect.name}, {effect.confidence:.0%} sure")
        for name, p in effect.parameters.items():
            print(f"    {name} = {p.value:.4g} {p.unit}, 95 %: {p.low:.4g} to {p.high:.4g}")
    for channel, error in found.fit.items():
        held = error["heldout_rmse"]
        print(f"  {channel}: RMS error {held['refit']:.2g} without it, {held['augmented']:.2g} with it {error['unit']}")
    return found


def draw(found):
    """What is left of the log that no fit saw, without and with the answer."""
    traces = [trace for trace in found.traces if trace.use == "heldout"]
    figure, axes = plt.subplots(len(traces), 1, sharex=True, figsize=(7.0, 4.2), layout="constrained")
    for ax, trace in zip(axes, traces, strict=True):
        for series, label in ((trace.refit, "refitted simulator"), (trace.augmented, "corrected rig")):
            ax.plot(trace.time, trace.measured - series, linewidth=0.7, label=label)
        ax.set_ylabel(f"{trace.channel.replace('_', ' ')}\nresidual [{trace.unit}]")
    axes[0].legend(ncols=2, loc="lower left")
    axes[-1].set_xlabel("time of the log [s]")
    return figure


def again(folder: Path, found) -> None:
    """Ask the corrected rig, ``found.rig``, the same question: nothing more is missing."""
    print("with the corrected rig:", diagnose(folder, rig=found.rig).verdict)


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("sample"), help="folder for the logs and the figure")
    folder = parser.parse_args(arguments).out
    logs(folder)
    found = ask(folder)
    draw(found).savefig(folder / "left.png")
    again(folder, found)


if __name__ == "__main__":
    main()
