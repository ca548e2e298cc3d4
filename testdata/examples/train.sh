#!/bin/sh
# Trains a dictionary in parts: groups similar poses, trains a dictionary on each group, and joins the dictionaries.
#
#     POSES='my poses.csv' sh train.sh                                # all, one part after another
#     sh train.sh split; sh train.sh part 0; ...; sh train.sh join    # the steps, for schedulers
#
# train.mk, train.parallel.sh and train.slurm run the steps with make, GNU parallel and Slurm: copy this file with them.
# Run it again after a change or a failure: it does what is missing or out of date, and a part that was stopped goes on from
# its checkpoint, which is saved after each iteration.
# shellcheck disable=SC2086 # CLUSTER, TRAIN and JOIN are lists of flags
set -eu
# The poses, and the result.
POSES=${POSES:-poses.csv} DICT=${DICT:-dict.npz}
# The number of parts, their format (csv or npy), and further flags of cluster: equal parts take about equally long.
K=${K:-8} FORMAT=${FORMAT:-csv} CLUSTER=${CLUSTER:---balance}
# The flags of ksvd-train. With --error, a part gets as many atoms as this RMS error (cm) asks for.
TRAIN=${TRAIN:---error 1 --iterations 20}
# The flags of dict-concat: an atom whose coherence with an earlier one is at least this is dropped.
JOIN=${JOIN:---prune 0.999}
# The folders of the parts and of the logs: I.log has the messages of part I, I.jsonl a line per iteration.
PARTS=${PARTS:-parts} LOGS=${LOGS:-logs}
# The threads of a part (the other steps use all), and the command.
THREADS=${THREADS:-1} POSING=${POSING:-posing}

say() { echo "train.sh: $*" >&2; }

# Whether file $1 is missing or older than one of the others.
stale() {
  file=$1
  shift
  [ ! -e "$file" ] || [ -n "$(find -L "$@" -newer "$file")" ]
}

# Writes the flags $2 into file $1 if it has others: what is older than the file is out of date.
keep() { [ "$(cat "$1" 2>/dev/null)" = "$2" ] || printf '%s\n' "$2" >"$1"; }

# Sets the names of part $1, counted from 0, of the tables that follow.
name() {
  if [ ! -e "$2" ] || ! [ "$1" -lt $(($# - 1)) ] 2>/dev/null; then
    say "$PARTS has no part $1: split first"
    exit 2
  fi
  shift $(($1 + 1))
  table=$1 model=${1%."$FORMAT"}.npz log=$LOGS/$(basename "$1" ".$FORMAT")
}

# Whether the $1 tables in the folder are the parts of these poses and flags. Without poses, what is there is taken:
# posing ... | posing cluster -k 8 --split parts && sh train.sh
is_split() {
  [ "$1" = "$K" ] || return 1
  [ -e "$POSES" ] || return 0
  ! stale "$PARTS/split" "$POSES" && [ "$(cat "$PARTS/split")" = "$flags" ]
}

split() {
  mkdir -p "$PARTS" "$LOGS"
  flags="-k $K --to $FORMAT $CLUSTER"
  set -- "$PARTS"/*."$FORMAT"
  [ -e "$1" ] || shift
  if ! is_split $#; then
    # Only a folder that this file has split is emptied.
    [ ! -e "$PARTS/split" ] || rm -f "$PARTS"/*[0-9].* "$PARTS/split"
    printf '%s\n' "$flags" >"$PARTS/split.new"
    "$POSING" cluster -q $flags --split "$PARTS" "$POSES"
    mv "$PARTS/split.new" "$PARTS/split"
  fi
  keep "$PARTS/train" "$TRAIN"
  keep "$PARTS/join" "$JOIN"
}

# Prints the numbers of the parts that are not trained.
todo() {
  i=0
  while [ $i -lt "$K" ]; do
    name $i "$PARTS"/*."$FORMAT"
    ! stale "$model" "$table" "$PARTS/train" || echo $i
    i=$((i + 1))
  done
}

part() {
  name "$1" "$PARTS"/*."$FORMAT"
  stale "$model" "$table" "$PARTS/train" || return 0
  # A checkpoint of other poses or flags would be refused.
  ! stale "$model.checkpoint" "$table" "$PARTS/train" || rm -f "$model.checkpoint"
  trap 'echo "train.sh: stopped by SIGTERM" >>"$log.log"; exit 143' TERM
  code=0
  "$POSING" ksvd-train $TRAIN --threads "$THREADS" --checkpoint "$model.checkpoint" --log "$log.jsonl" -o "$model" "$table" \
    2>>"$log.log" || code=$?
  [ $code -le 128 ] || echo "train.sh: stopped by signal $((code - 128))" >>"$log.log"
  [ $code = 0 ] || say "$table failed: $(tail -n 1 "$log.log") [$log.log]"
  return $code
}

join() {
  parts=$(todo)
  for i in $parts; do
    name "$i" "$PARTS"/*."$FORMAT"
    say "$table is not trained: $(tail -n 1 "$log.log" 2>/dev/null || echo "never begun") [$log.log]"
  done
  [ -z "$parts" ] || exit 1
  i=0
  while [ $i -lt "$K" ]; do
    name $i "$PARTS"/*."$FORMAT"
    set -- "$@" "$model"
    i=$((i + 1))
  done
  stale "$DICT" "$@" "$PARTS/join" || return 0
  code=0
  "$POSING" dict-concat $JOIN -o "$DICT" "$@" 2>"$LOGS/dict.log" || code=$?
  tail -n 1 "$LOGS/dict.log" >&2
  return $code
}

all() {
  split
  for i in $(todo); do
    # The other parts are trained even if one fails: join tells.
    (part "$i") 2>/dev/null || :
  done
  join
}

case ${1-}:$# in
:0) all ;;
split:1 | todo:1 | join:1) "$1" ;;
part:2) part "$2" ;;
*) say 'expected nothing, split, todo, part I or join' && exit 2 ;;
esac
