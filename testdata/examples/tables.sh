#!/bin/sh
# Lai et al.'s Tables 1 to 4 again: tables.sh [--quick] CMU OUT writes a report of each run and OUT/tables.html beside them.
# Goes on where it was stopped. MODELS, SEEDS and FRAMES may be set; --quick: less of everything, in a few minutes.
set -eu
bin=${POSING_BIN:-}
run() { name=$1; shift; "${bin:+$bin/}$name" "$@"; }
quick=
if [ "${1:-}" = --quick ]; then quick=1; shift; fi
cmu=${1:-} out=${2:-tables}
if [ ! -d "$cmu" ]; then
  echo 'make tables: the CMU takes are not there: make tables CMU=path, a folder NN/ a subject with NN.asf and NN_*.amc' >&2
  exit 2
fi

# The models of Lai et al., their own with either pursuit, and the default one, as it answers and by poses alone; SIK for single subjects, as in Lai et al.
models=${MODELS:-multiscale+treated,multiscale,ksvd,ksvd-omp,mfa,gaussian,lpca,clustered,pca}
# Every n-th frame: of single subjects, and of all together.
if [ "$quick" ]; then
  subjects='07 02' every=6 every_all=60 seeds=${SEEDS:-1} frames=${FRAMES:-100} sweep=
else
  subjects='07 01 02 13 14 35 49' every=1 every_all=4 seeds=${SEEDS:-2} frames=${FRAMES:-400}
  sweep=,ksvd:n=64,ksvd:n=125,ksvd:n=250,ksvd:n=500,ksvd:n=1000,ksvd:k=1,ksvd:k=2,ksvd:k=5,ksvd:k=8
fi

# thin N: the head of a table and every N-th frame of it.
thin() { awk -v n="$1" 'NR == 1 || NR % n == 2 % n'; }
poses=$out/poses
mkdir -p "$poses"
for folder in "$cmu"/*/; do
  subject=$(basename "$folder")
  run amc2xyz -q --space body --asf "$folder/$subject.asf" --fps 120 -o "$poses/whole.csv" "$folder/$subject"_*.amc
  thin "$every_all" < "$poses/whole.csv" > "$poses/all-$subject.csv"
  # Subject 01 has more than all the other single ones together.
  step=$every; if [ "$subject" = 01 ] && [ "$every" = 1 ]; then step=2; fi
  thin "$step" < "$poses/whole.csv" > "$poses/$subject.csv"
done
rm -f "$poses/whole.csv"

runs=
# one NAME MODELS TABLES...: a run of evaluate, with all splits that its takes allow.
one() {
  to=$1 named=$2; shift 2
  echo "make tables: $to" >&2
  run evaluate --models "$named" --seeds "$seeds" --frames "$frames" -o "$out/$to" "$@" > "$out/$to.txt"
  runs="$runs --paper $out/$to"
}
for subject in $subjects; do
  [ -f "$poses/$subject.csv" ] || continue
  # Error against sparsity and size, for Lai et al.'s first subject.
  more=; if [ "$subject" = 07 ]; then more=$sweep; fi
  one "$subject" "$models,sik$more" "$poses/$subject.csv"
done
seeds=1
one all "$models" "$poses"/all-*.csv
# Paths of the runs have no spaces where OUT has none.
# shellcheck disable=SC2086
run evaluate $runs -o "$out"
echo "Look at $out/tables.html (any browser), and at the report.html of each run beside it." >&2
