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
# The poses, and the result.
POSES=${POSES:-poses.csv} DICT=${DICT:-dict.npz}
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

say() { echo "train.sh: $*" >&2; }
last_line() { tail -n 1 "$1" 2>/dev/null || echo 'no message'; }

# Whether file $1 is missing or older than one of the others.
stale() {
  file=$1
  shift
  [ ! -e "$file" ] || [ -n "$(find -L "$@" -newer "$file")" ]
}

# Writes the flags $2 into file $1 if it has others: what is older than the file is out of date.
keep() { [ -e "$1" ] && [ "$(cat "$1")" = "$2" ] || printf '%s\n' "$2" >"$1"; }

# The names of the parts, a line each. Other files in the folder do not count.
# shellcheck disable=SC2012 # these names have digits only
names() { ls "$PARTS" | sed -n "s/^\([0-9][0-9]*\)\.$FORMAT\$/\1/p"; }

# Splits the poses, or takes the tables that are there: posing ... | posing cluster -k 8 --split parts && sh train.sh
# PARTS/split says what they are a split of: tables of other poses or flags are neither taken nor written over.
split() {
  mkdir -p "$PARTS" "$LOGS"
  count=$(names | wc -l) asked=given
  if [ -e "$PARTS/split" ]; then found=$(cat "$PARTS/split"); elif [ "$count" -gt 0 ]; then found=given; else found=; fi
  if [ "$found" != given ]; then
    [ -e "$POSES" ] || { say "$POSES: no such file"; exit 2; }
    asked="$(cksum <"$POSES") -k $K --to $FORMAT $CLUSTER"
  fi
  if [ "$count" -gt 0 ] && [ "$found" != "$asked" ]; then
    say "$PARTS is a split of other poses, or by other flags ($found; now $asked): remove it, or set PARTS to another folder"
    exit 2
  fi
  if [ "$found" = given ] && [ "$count" -ne "$K" ]; then
    say "$PARTS has $((count)) tables, but K is $K"
    exit 2
  fi
  keep "$PARTS/split" "$asked"
  keep "$PARTS/count" "$K"
  keep "$PARTS/train" "$TRAIN"
  keep "$PARTS/join" "$JOIN"
  [ "$count" -ne "$K" ] || return 0
  code=0
  "$POSING" cluster -q -k "$K" --to "$FORMAT" $CLUSTER ${THREADS:+--threads "$THREADS"} --split "$PARTS" "$POSES" \
    2>"$LOGS/split.log" || code=$?
  cat "$LOGS/split.log" >&2
  return $code
}

# Checks that all parts are there.
check_split() {
  if [ ! -e "$PARTS/count" ] || [ "$(names | wc -l)" -ne "$(cat "$PARTS/count")" ]; then
    say "$PARTS is not split: $(last_line "$LOGS/split.log")"
    exit 1
  fi
}

# Whether part $1 is not trained.
missing() { stale "$PARTS/$1.npz" "$PARTS/$1.$FORMAT" "$PARTS/train"; }

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
  name=$(names | sed -n "$(($1 + 1))p")
  [ -n "$name" ] || { say "$PARTS has no part $1"; exit 2; }
  missing "$name" || return 0
  table=$PARTS/$name.$FORMAT model=$PARTS/$name.npz log=$LOGS/$name.log
  # A checkpoint of other poses or flags would be refused.
  ! stale "$model.checkpoint" "$table" "$PARTS/train" || rm -f "$model.checkpoint"
  trap 'echo "train.sh: stopped by SIGTERM" >>"$log"; exit 143' TERM
  code=0 TRAIN=$(cat "$PARTS/train")
  "$POSING" ksvd-train $TRAIN --threads "${THREADS:-1}" --checkpoint "$model.checkpoint" \
    --log "$LOGS/$name.jsonl" -o "$model" "$table" 2>>"$log" || code=$?
  [ $code -le 128 ] || echo "train.sh: stopped by signal $((code - 128))" >>"$log"
  [ $code = 0 ] || say "$table failed: $(last_line "$log") [$log]"
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
  if ! stale "$PARTS/joined" "$@" "$PARTS/join" && [ "$(cksum <"$DICT")" = "$(cat "$PARTS/joined")" ]; then
    return 0
  fi
  JOIN=$(cat "$PARTS/join")
  "$POSING" dict-concat $JOIN ${THREADS:+--threads "$THREADS"} -o "$DICT" "$@" 2>"$LOGS/dict.log" || code=$?
  last_line "$LOGS/dict.log" >&2
  [ $code != 0 ] || cksum <"$DICT" >"$PARTS/joined"
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
