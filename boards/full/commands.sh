#!/bin/sh
# Everything on the full board (two of its eight tasks), from nothing. Its steps were run one by one, not as this script.
# The tuned gains in configs/controllers come from boards/quick/commands.sh.
set -e
runs=${RUNS:-runs/board}
board=boards/full
envs="CableHole-Position-Sine PulleyCircuit-Position-Sine"

for env in $envs; do
    cablebench train --env "$env" --algo ppo --seeds 0:10 --jobs 2 --resume --out "$runs"
    cablebench publish "$runs/ppo-$env"-*/ --out "$board/policies" --overwrite
done

policies=$(printf -- '--policy %s ' "$board"/policies/*.zip)
tuned="--controller mrac-g22-tuned --controller feedforward-pid-tuned --controller pid-tuned"
where="--track nominal --track randomised $(printf -- '--env %s ' $envs)"
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where $tuned
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where $policies

cablebench leaderboard --board full --pack
