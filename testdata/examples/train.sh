#!/bin/sh
# Trains a dictionary in parts: groups similar poses, trains a dictionary on each group, and joins the dictionaries.
#
#     POSES='my poses.csv' sh train.sh                                # all, one part after another
#     sh train.sh split; sh train.sh part 0; ...; sh train.sh join    # the steps, for schedulers
#
# train.mk, train.parallel.sh and train.slurm run the steps with make, GNU parallel and Slurm: copy this file with them.
# Run it again after a failure, or with other flags for training: it does what is missing or out of date, and a part that was
# stopped goes on from its checkpoint, which is saved after each iteration. One run at a time in a folder.
# shellcheck disable=SC2086 # CLUSTER, TRAIN and JOIN are lists of flags
set -eu
# The poses (poses.csv), and the result. Without POSES, tables that are in PARTS are taken:
# posing ... | posing cluster -k 8 --split parts && sh train.sh
POSES=${POSES:-} DICT=${DICT:-dict.npz}
# The number of parts, their format (csv or npy), and further flags of cluster: equal parts take about equally long.
K=${K:-8} FORMAT=${FORMAT:-csv} CLUSTER=${CLUSTER---balance}
# The flags of ksvd-train. With --error, a part gets as many atoms as this RMS error (cm) asks for.
TRAIN=${TRAIN:---error 1 --iterations 20}
# The flags of dict-concat: an atom whose coherence with an earlier one is at least this is dropped.
JOIN=${JOIN---prune 0.999}
# The folders of the parts and of the logs: I.log has the messages of part I, I.jsonl a line per iteration.
PARTS=${PARTS:-parts} LOGS=${LOGS:-logs}
# The threads of each step: one for a part, all for the others, if empty. The command.
THREADS=${THREADS:-} POSING=${POSING:-posing}

# What the tables and models were made of: digests and flags.
STATE=$PARTS/state

say() { echo "train.sh: $*" >&2; }
refuse() {
  echo "$*" >"$LOGS/split.log"
  say "$*"
  exit 2
}
last_line() { tail -n 1 "$1" 2>/dev/null || echo 'no message'; }

# The names of the tables of parts, of both formats; of this format, without their endings. Other files do not count.
# shellcheck disable=SC2010,SC2012 # these names have digits only
tables() { ls "$PARTS" 2>/dev/null | grep -E '^[0-9]+\.(csv|npy)$' || :; }
names() { tables | sed -n "s/\.$FORMAT\$//p"; }

# Splits the poses. Tables of other poses or flags are neither taken nor written over.
split() {
  mkdir -p "$LOGS"
  case $K in 0* | *[!0-9]*) refuse "K=$K: expected a number from 1" ;; esac
  if [ ! -d "$STATE" ] && [ "$(ls -A "$PARTS" 2>/dev/null)" != "$(tables)" ]; then
    refuse "$PARTS holds other files: set PARTS to another folder"
  fi
  mkdir -p "$STATE"
  rm -f "$STATE/ready"
  count=$(($(tables | wc -l))) found=
  if [ -e "$STATE/split" ]; then found=$(cat "$STATE/split"); elif [ "$count" -gt 0 ]; then found=given; fi
  if [ -z "$POSES" ] && [ "$found" = given ]; then
    asked=given
    [ "$count" -eq "$K" ] || refuse "$PARTS has $count tables: set K=$count"
    say "taking the $count tables in $PARTS"
  else
    POSES=${POSES:-poses.csv}
    [ -e "$POSES" ] || refuse "$POSES: no such file"
    asked="$(cksum <"$POSES") -k $K --to $FORMAT $CLUSTER"
    [ "$count" = 0 ] || [ "$found" = "$asked" ] ||
      refuse "$PARTS is a split of other poses or by other flags ($found; now $asked): set PARTS to another folder, or remove it with its models"
  fi
  echo "$asked" >"$STATE/split"
  if [ -e "$STATE/count" ] && [ "$count" -gt 0 ]; then
    [ "$count" -eq "$K" ] || refuse "$PARTS has $count of $K tables: restore the others, or remove the folder"
  elif [ "$asked" != given ]; then
    cluster
  fi
  echo "$K" >"$STATE/count"
  printf '%s\n' "$TRAIN" >"$STATE/train"
  printf '%s\n' "$JOIN" >"$STATE/join"
  : >"$STATE/ready"
}

# Each run writes into a folder of its own first, so that a cluster that outlives a killed run publishes nothing.
cluster() {
  rm -rf "$STATE"/new.*
  code=0
  "$POSING" cluster -q -k "$K" --to "$FORMAT" $CLUSTER ${THREADS:+--threads "$THREADS"} --split "$STATE/new.$$" "$POSES" \
    2>"$LOGS/split.log" || code=$?
  cat "$LOGS/split.log" >&2
  [ $code = 0 ] || exit $code
  mv "$STATE/new.$$"/* "$PARTS"
  rmdir "$STATE/new.$$"
}

check_split() {
  [ -e "$STATE/ready" ] || { say "$PARTS is not split: $(last_line "$LOGS/split.log")"; exit 1; }
  [ "$(names | wc -l)" -eq "$(cat "$STATE/count")" ] || { say "$PARTS has not all tables: restore them, or remove the folder"; exit 1; }
}

# The digest of what part $1 is trained from, and whether its model is not that.
inputs() { cat "$STATE/train" "$PARTS/$1.$FORMAT" | cksum; }
model() { cksum 2>/dev/null <"$PARTS/$1.npz" || :; }
missing() { [ "$(inputs "$1") $(model "$1")" != "$(cat "$STATE/$1.of" 2>/dev/null)" ]; }

# Prints the numbers, from 0, of the parts that are not trained.
todo() {
  check_split
  i=0
  for name in $(names); do
    ! missing "$name" || echo $i
    i=$((i + 1))
  done
}

# Trains part number $1.
part() {
  check_split
  case $1 in '' | *[!0-9]*) name= ;; *) name=$(names | sed -n "$(($1 + 1))p") ;; esac
  [ -n "$name" ] || { say "$PARTS has no part $1"; exit 2; }
  missing "$name" || return 0
  mkdir -p "$LOGS"
  table=$PARTS/$name.$FORMAT model=$PARTS/$name.npz log=$LOGS/$name.log inputs=$(inputs "$name")
  # A checkpoint of other poses or flags would be refused.
  [ "$(cat "$STATE/$name.begun" 2>/dev/null)" = "$inputs" ] || rm -f "$model.checkpoint"
  echo "$inputs" >"$STATE/$name.begun"
  trap 'echo "train.sh: stopped by SIGTERM" >>"$log"; exit 143' TERM
  code=0 TRAIN=$(cat "$STATE/train")
  "$POSING" ksvd-train $TRAIN --threads "${THREADS:-1}" --checkpoint "$model.checkpoint" \
    --log "$LOGS/$name.jsonl" -o "$model" "$table" 2>>"$log" || code=$?
  [ $code -le 128 ] || echo "train.sh: stopped by signal $((code - 128))" >>"$log"
  if [ $code = 0 ]; then
    echo "$inputs $(model "$name")" >"$STATE/$name.of"
  else
    say "$table failed: $(last_line "$log") [$log]"
  fi
  return $code
}

join() {
  check_split
  code=0
  for name in $(names); do
    set -- "$@" "$PARTS/$name.npz"
    missing "$name" || continue
    say "$PARTS/$name.$FORMAT is not trained: $(last_line "$LOGS/$name.log") [$LOGS/$name.log]"
    code=1
  done
  [ $code = 0 ] || exit $code
  # The dictionary that is there may be that of other parts.
  inputs=$(cat "$STATE/join" "$STATE"/*.of | cksum)
  if [ -e "$DICT" ] && [ "$inputs $(cksum <"$DICT")" = "$(cat "$STATE/joined" 2>/dev/null)" ]; then
    return 0
  fi
  JOIN=$(cat "$STATE/join")
  "$POSING" dict-concat $JOIN ${THREADS:+--threads "$THREADS"} -o "$DICT" "$@" 2>"$LOGS/dict.log" || code=$?
  last_line "$LOGS/dict.log" >&2
  [ $code != 0 ] || echo "$inputs $(cksum <"$DICT")" >"$STATE/joined"
  return $code
}

all() {
  split
  for i in $(todo); do
    # The other parts are trained even if one fails: join names it.
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
