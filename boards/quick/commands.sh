#!/bin/sh
# Everything on the quick board, from nothing: two hours and more on two cores. Its steps were run one by one, not as this script.
set -e
runs=${RUNS:-runs/board}
board=boards/quick
hole="--env CableHole-Position-Step --env CableHole-Position-Sine --env CableHole-Tension-Step --env CableHole-Tension-Sine"
circuit="--env PulleyCircuit-Position-Step --env PulleyCircuit-Position-Sine --env PulleyCircuit-Torque-Step --env PulleyCircuit-Torque-Sine"

# gains, by as many trials as the protocol grants to an agent's settings
for pair in "mrac-g22:$hole" "feedforward-pid:$circuit" "pid:$hole $circuit"; do
    name=${pair%%:*}
    episodes=4; [ "$name" = feedforward-pid ] && episodes=12
    cablebench tune --controller "$name" ${pair#*:} --trials 40 --episodes $episodes --study "$runs/$name.db" --out "configs/controllers/$name-tuned.yaml"
done

# agents
for env in $(echo "$hole $circuit" | sed 's/--env//g'); do
    for algo in ppo residual-ppo sac; do
        cablebench train --env "$env" --algo "$algo" --seeds 0:3 --jobs 2 --resume --out "$runs"
    done
done
cablebench publish "$runs"/*/ --out "$board/policies" --overwrite

# episodes; --resume skips what is done
policies=$(printf -- '--policy %s ' "$board"/policies/*.zip)
tuned="--controller mrac-g22-tuned --controller feedforward-pid-tuned --controller pid-tuned"
cablebench evaluate --protocol quick --results "$board" --jobs 2 --resume
cablebench evaluate --protocol quick --results "$board" --jobs 2 --resume $tuned
cablebench evaluate --protocol quick --results "$board" --jobs 2 --resume $policies

# one quantity at a time away from nominal, on one task of each plant, first training seeds
stress="--track stress --env CableHole-Position-Sine --env PulleyCircuit-Position-Sine"
first=$(printf -- '--policy %s ' "$board"/policies/*-CableHole-Position-Sine-0.zip "$board"/policies/*-PulleyCircuit-Position-Sine-0.zip)
cablebench evaluate --protocol quick --results "$board" --jobs 2 --resume $stress
cablebench evaluate --protocol quick --results "$board" --jobs 2 --resume $stress $first

# a planner that knows the nominal simulator, on one task (4 to 8 minutes; it answers within the 10 ms limit in 2 to 6 ms)
cablebench submit examples/mppi_on_measurements.py --trust --publish

cablebench leaderboard --board quick --pack
