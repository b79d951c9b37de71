#!/bin/sh
# Everything on the board of suite v1, from nothing: by estimate eight hours on two cores. Its steps were run one by one, not as this script.
set -e
board=boards/suite-v1

# what the scores are between; `cablebench anchors --protocol suite-v1` makes those that are missing, --replace all of them
cablebench anchors --protocol suite-v1 --rounds 5

# test rigs, each level's own sensors; --resume skips what is done
run="cablebench evaluate --protocol suite-v1 --track test --results $board --jobs 2 --resume"
$run --controller open-loop --controller oracle
$run --controller pid-suite --controller scheduled-pid-suite --controller adaptive-inverse-suite --controller lqg-suite
$run --controller camera-jaw-suite --controller grasp-jaw-suite --controller feedforward-pid
$run --controller drive-side-suite --controller sheath-drive-side-suite
$run --controller suite-references

# PPO for each task with three seeds, PPO that corrects a reference, and the other algorithms on every ranked task with
# one seed, and ten seeds of two of them on one task of each mechanism; policies are not kept. Minutes of an idle core for
# each training: PPO 0.7, TD3 1.5, SAC and recurrent PPO 2, TQC and CrossQ 4
tasks=$(sed -n 's/.*cable_envs\/\([A-Za-z-]*\)-v1.*/\1/p' configs/protocols/suite-v1.yaml)
train() {
  name="runs/suite/$1-$2-$3"
  [ -f "$name/policy.zip" ] || cablebench train --env "$2" --algo "$1" --seed "$3" --steps 1200000 -o split=train --out "$name"
  $run --policy "$name"
}
for one in $tasks; do for seed in 0 1 2; do train suite-ppo "$one" "$seed"; done; done
ranked=$(sed -n 's/^  - cable_envs\/\([A-Za-z-]*\)-v1.*/\1/p' configs/protocols/suite-v1.yaml)
for one in $ranked CableHole-Track-Hard CableHole-Sine-Hard; do train suite-residual-ppo "$one" 0; done
for algo in suite-sac suite-recurrent-ppo suite-td3 suite-tqc suite-crossq; do
  for one in $ranked; do train "$algo" "$one" 0; done
done
for seed in 1 2 3 4 5 6 7 8 9; do
  for one in CableHole-Step-Hard PulleyCircuit-Track-Hard TendonSheath-Track-Medium; do train suite-residual-ppo "$one" "$seed"; done
  for one in CableHole-Step-Hard TendonSheath-Track-Medium; do train suite-ppo "$one" "$seed"; done
  train suite-sac PulleyCircuit-Track-Hard "$seed"
done

# the robust track: one quantity at a time away from the task's own rig; kept of pid-suite, lqg-suite and the seeds 1 and 2 of suite-ppo are the rows of the ranked tasks
robust="cablebench evaluate --protocol suite-v1 --track robust --results $board --jobs 2 --resume"
$robust --controller suite-references
$robust $(printf ' --env %s' $ranked) --controller pid-suite --controller lqg-suite
for one in $tasks; do
  $robust --env "$one" $(printf " --policy runs/suite/suite-ppo-$one-%s" 0 1 2)
done

# learnt from data sets alone (docs/offline.md); needs d3rlpy
for one in CableHole-Track-Medium PulleyCircuit-Track-Medium; do
  cablebench datasets --env "$one" --episodes 20 --out datasets
done
python examples/offline_d3rlpy.py --task CableHole-Track-Medium --datasets datasets --steps 30000 --out learnt
python examples/offline_d3rlpy.py --task PulleyCircuit-Track-Medium --datasets datasets --steps 30000 --out learnt --learner bc-reference --learner bc-expert
for one in learnt/*.yaml; do
  task=$(basename "$one" .yaml | sed -E 's/^(bc-expert|bc-reference|iql|td3bc)-//')
  $run --env "$task" --policy "$one"
done

cablebench anchors --protocol suite-v1 --check "$board"
cablebench leaderboard --board suite-v1 --policies runs --traces --pack
