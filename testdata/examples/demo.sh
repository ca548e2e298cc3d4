#!/bin/sh
# Restores a damaged run: demo.sh FOLDER writes tables, a BVH file and an HTML page into FOLDER.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
out=${1:-demo} bin=${POSING_BIN:-}
run() { name=$1; shift; "${bin:+$bin/}$name" "$@"; }
credit='The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217.'
skeleton=$here/cmu/09/09.asf
mkdir -p "$out"

# A captured run, damaged (1 cm of noise on every coordinate, 4 gaps of 0.2 s in 3 points each) and restored with the
# built-in model, which has seen no take of this person: denoise removes the noise, complete fills the gaps.
run amc2xyz --asf "$skeleton" --fps 120 -o "$out/truth.csv" "$here/cmu/09/09_06.amc"
run corrupt --dense 1cm --gaps 4 --length 0.2 --points 3 --seed 1 -o "$out/damaged.csv" "$out/truth.csv"
run denoise --status -o "$out/denoised.csv" "$out/damaged.csv"
run complete --status -o "$out/restored.csv" "$out/denoised.csv"
run xyz2bvh --skeleton "$skeleton" -o "$out/restored.bvh" "$out/restored.csv"

# One row of the table of scores, from the output of score.
row() {
  run score --damaged "$out/damaged.csv" "$out/truth.csv" "$out/$1.csv" | awk -v name="$1" '
    function told(rms) { return rms == "-" ? "–" : sprintf("%.2f", rms) }
    $1 == "all" { still = NF > 6 ? $7 : 0 }
    $1 == "was" && $2 == "missing" { missing = told($5) }
    $1 == "was" && $2 == "observed" { noisy = told($5) }
    $1 == "accelerations," { trembling = sprintf("%.0f", $4) }
    END { printf "%s,%s,%s,%s,%s\n", name, still, missing, noisy, trembling }'
}
{
  echo ',left,in gaps,elsewhere,accel.'
  row truth
  row damaged
  row restored
} > "$out/scores.csv"

run plot --title 'A run: truth, damaged, restored' --names truth,damaged,restored \
  --note 'CMU take 09_06 with 1 cm of noise and 4 gaps of 0.2 s in 3 points each, restored by denoise, then complete. The built-in model has seen no take of this person.' \
  --table "$out/scores.csv" --caption 'Coordinates left missing, RMS error (cm) in the gaps and elsewhere, RMS acceleration (cm/s²)' --credit "$credit" \
  -o "$out/demo.html" "$out/truth.csv" "$out/damaged.csv" "$out/restored.csv"

awk -F, 'BEGIN { printf "\n%-10s %14s %18s %16s %18s\n%-10s %14s %18s %16s %18s\n", "", "coordinates", "RMS error (cm)", "RMS error (cm)", "RMS acceleration",
    "", "still missing", "where missing", "where noisy", "(cm/s^2)" }
  NR > 1 { sub("–", "-", $3); sub("–", "-", $4); printf "%-10s %14s %18s %16s %18s\n", $1, $2, $3, $4, $5 }' "$out/scores.csv"
echo '
The built-in model has seen no take of this person.
'
echo "Watch       $out/demo.html   (in any browser: truth, damaged and restored side by side)"
echo "Open        $out/restored.bvh   in Blender or any other tool that reads BVH"
echo "The tables  $out/truth.csv, damaged.csv, restored.csv"
