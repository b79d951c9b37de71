#!/bin/sh
# Everything on the full board (two of its eight tasks), from nothing. On two cores: about an hour and a half.
# The tuned gains in configs/controllers come from boards/quick/commands.sh.
set -e
runs=${RUNS:-runs/board}
board=boards/full
envs="CableHole-Position-Sine PulleyCircuit-Position-Sine"

for env in $envs; do
    for algo in ppo residual-ppo; do
        cablebench train --env "$env" --algo "$algo" --seeds 0:10 --jobs 2 --resume --out "$runs"
        cablebench publish "$runs/$algo-$env"-*/ --out "$board/policies" --overwrite
    done
done

policies=$(printf -- '--policy %s ' "$board"/policies/*.zip)
tuned="--controller mrac-g22-tuned --controller feedforward-pid-tuned --controller pid-tuned"
where="--track nominal --track randomised $(printf -- '--env %s ' $envs)"
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where $tuned
cablebench evaluate --protocol full --results "$board" --jobs 2 --resume $where $policies

cablebench leaderboard --board full --pack
