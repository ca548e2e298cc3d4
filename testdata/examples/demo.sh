#!/bin/sh
# What posing does, on a real take: demo.sh FOLDER writes tables, a BVH file and a page to look at into FOLDER.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
out=${1:-demo} bin=${POSING_BIN:-}
run() { name=$1; shift; "${bin:+$bin/}$name" "$@"; }
credit='The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217.'
skeleton=$here/cmu/07/07.asf
mkdir -p "$out"

# A walk as it was captured, damaged on purpose (1 cm of noise on every coordinate, 8 gaps of 0.4 s in 3 points each), and
# restored by the built-in model: first the noise goes, then the gaps are filled.
run amc2xyz --asf "$skeleton" --fps 120 -o "$out/truth.csv" "$here/cmu/07/07_01.amc"
run corrupt --dense 1cm --gaps 8 --length 0.4 --points 3 --seed 1 -o "$out/damaged.csv" "$out/truth.csv"
run denoise -o "$out/denoised.csv" "$out/damaged.csv"
run complete --status -o "$out/restored.csv" "$out/denoised.csv"
run xyz2bvh --skeleton "$skeleton" -o "$out/restored.bvh" "$out/restored.csv"

# One row of the table of scores, from what score prints.
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

run plot --title 'A walk: truth, damaged, restored' --names truth,damaged,restored \
  --note 'CMU take 07_01, damaged on purpose (1 cm of noise, 8 gaps of 0.4 s in 3 points each), restored by denoise, then complete. The built-in model learnt from every fourth frame of CMU takes, this one among them: the figures below do not tell how it does on motion it has not seen.' \
  --table "$out/scores.csv" --caption 'Coordinates left missing, RMS error (cm) in the gaps and elsewhere, RMS acceleration (cm/s²)' --credit "$credit" \
  -o "$out/demo.html" "$out/truth.csv" "$out/damaged.csv" "$out/restored.csv"

awk -F, 'BEGIN { printf "\n%-10s %14s %18s %16s %18s\n%-10s %14s %18s %16s %18s\n", "", "coordinates", "RMS error (cm)", "RMS error (cm)", "RMS acceleration",
    "", "still missing", "where missing", "where noisy", "(cm/s^2)" }
  NR > 1 { sub("–", "-", $3); sub("–", "-", $4); printf "%-10s %14s %18s %16s %18s\n", $1, $2, $3, $4, $5 }' "$out/scores.csv"
echo '
The built-in model has seen every fourth frame of this take: no measure of how it does on motion it has not seen.
'
echo "Look at     $out/demo.html   (any browser: it plays truth, damaged and restored side by side)"
echo "Open        $out/restored.bvh   in Blender or any other tool that reads BVH"
echo "The tables  $out/truth.csv, damaged.csv, restored.csv"
