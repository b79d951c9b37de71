#!/bin/sh
# Everything on the board of suite v1, from nothing: hours on two cores. Its steps were run one by one, not as this script.
set -e
board=boards/suite-v1

# what the scores are between; `cablebench anchors --protocol suite-v1` alone makes those that are missing
#   cablebench anchors --protocol suite-v1 --replace

# test rigs, nominal sensors of each level; --resume skips what is done
cablebench evaluate --protocol suite-v1 --track test --results "$board" --jobs 2 --resume --controller open-loop
cablebench evaluate --protocol suite-v1 --track test --results "$board" --jobs 2 --resume --controller pid
cablebench evaluate --protocol suite-v1 --track test --results "$board" --jobs 2 --resume --controller feedforward-pid
cablebench evaluate --protocol suite-v1 --track test --results "$board" --jobs 2 --resume --controller oracle

# all other references, with their default gains
cablebench evaluate --protocol suite-v1 --track test --results "$board" --jobs 2 --resume

cablebench anchors --protocol suite-v1 --check "$board"
cablebench leaderboard --board suite-v1 --pack
