#!/bin/sh
# Everything on the board of suite v1, from nothing: an hour and more on two cores. Its steps were run one by one, not as this script.
set -e
board=boards/suite-v1

# what the scores are between; `cablebench anchors --protocol suite-v1` makes those that are missing, --replace all of them
cablebench anchors --protocol suite-v1

# test rigs, each level's own sensors; --resume skips what is done
run="cablebench evaluate --protocol suite-v1 --track test --results $board --jobs 2 --resume"
$run --controller open-loop --controller oracle
$run --controller pid-suite --controller scheduled-pid-suite --controller adaptive-inverse-suite --controller lqg-suite
$run --controller camera-jaw-suite --controller grasp-jaw-suite --controller feedforward-pid
$run --controller drive-side-suite --controller sheath-drive-side-suite

# the robust track: one quantity at a time away from the task's own rig
cablebench evaluate --protocol suite-v1 --track robust --results "$board" --jobs 2 --resume --controller pid-suite --controller camera-jaw-suite

cablebench anchors --protocol suite-v1 --check "$board"
cablebench leaderboard --board suite-v1 --pack
