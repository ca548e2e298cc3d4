#!/bin/sh
# Trains a dictionary in parts with GNU parallel, by the steps of train.sh, which has the other variables, too:
#
#     POSES='my poses.csv' sh train.parallel.sh
#     SSHLOGIN=8/node1,8/node2 sh train.parallel.sh     # 8 parts at a time on each of two machines
#
# Other machines need this folder and these two files at the same paths (a shared file system), posing on the PATH of a command
# that ssh runs (or POSING with a full path), and a login without a password. Run it again after a change or a failure.
set -eu
# How many parts are trained at a time (a number, or a share of the processors), and on which machines; : is this one.
JOBS=${JOBS:-100%} SSHLOGIN=${SSHLOGIN:-:}
LOGS=${LOGS:-logs}
steps=$(cd "$(dirname "$0")" && pwd)/train.sh

sh "$steps" split
# The files say which parts are to be trained. --resume would skip one whose table or flags have changed.
parts=$(sh "$steps" todo)
[ -z "$parts" ] || echo "$parts" | parallel --quote --jobs "$JOBS" --sshlogin "$SSHLOGIN" --workdir . \
  --joblog "$LOGS/parallel.tsv" --env FORMAT --env TRAIN --env PARTS --env LOGS --env THREADS --env POSING \
  sh "$steps" part {} || [ $? -le 101 ]
sh "$steps" join
