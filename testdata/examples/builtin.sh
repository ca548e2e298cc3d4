#!/bin/sh
# Learns the built-in model and the prior of rotations from a folder of CMU takes:
# builtin.sh CMU OUT.npz ROTATIONS.npz
# Subject 09 is left out of the model: the demo shows it a person it has not seen.
set -eu
cmu=$1 out=$2 rotations=$3 bin=${POSING_BIN:-}
run() { name=$1; shift; "${bin:+$bin/}$name" "$@"; }
credit="The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for folder in "$cmu"/*/; do
  subject=$(basename "$folder")
  if [ "$subject" = 09 ]; then continue; fi
  # Every fourth frame: at 120 frames a second its neighbors say the same.
  run amc2xyz --asf "$folder/$subject.asf" --fps 120 "$folder/$subject"_*.amc | awk 'NR == 1 || NR % 4 == 2' > "$work/$subject.csv"
done
run prior-train --cells 1,5,20,80 --leaves 30000 --credit "$credit" -o "$out" "$work"/*.csv
run rotations-train --credit "$credit" -o "$rotations" "$cmu"/*/
run model info "$out"
run model info "$rotations"
