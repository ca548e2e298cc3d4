#!/bin/sh
# The worked case of a researcher; README.md beside this file tells it.
#   run.sh [OUT]     writes into the folder OUT (default: out)
set -eu
export LC_ALL=C
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-out}
mkdir -p "$out"
cp "$here"/../../cmu/07/07.asf "$here"/../../cmu/07/07_01.amc "$here"/../../cmu/09/09.asf "$here"/../../cmu/09/09_06.amc "$out"
cd "$out"

# The number of a name in what score --json writes, of all coordinates.
number() { awk -v name="\"$1\":" '/"all":/ { inside = 1 } inside && $1 == name { print $2 + 0; exit }' "$2"; }

echo '1. A data set: one person walks (07), another runs (09). Poses with place and heading, and without.'
posing amc2xyz --asf 07.asf --fps 120 -o walk.csv 07_01.amc
posing amc2xyz --asf 09.asf --fps 120 -o run.csv 09_06.amc
posing amc2xyz --asf 07.asf --fps 120 --space body -o walk-poses.csv 07_01.amc
posing amc2xyz --asf 09.asf --fps 120 --space body -o run-poses.csv 09_06.amc

echo '2. A dictionary of the walk, trained in parts, as one trains a large one.'
posing cluster -k 4 --balance --split parts walk-poses.csv
for part in 0 1 2 3; do
  posing ksvd-train -q -n 10 --space body -o parts/$part.npz parts/$part.csv
done
posing dict-concat --prune 0.999 -o dict.npz parts/0.npz parts/1.npz parts/2.npz parts/3.npz

echo '3. A pose model of the walk.'
posing prior-train -o prior.npz walk.csv

echo '4. Which model is best, and tested on what?'
posing evaluate -q --splits frames,subjects --tasks complete --models nearest,gaussian,ksvd:n=40:k=3,multiscale --seeds 1 --frames 100 -o splits walk-poses.csv run-poses.csv > splits.txt
awk -F , '
  $3 == "complete" && $5 == "all" { rms[$1, $4] = $11; if (!seen[$4]++) name[++models] = $4 }
  END {
    printf "tested on"; for (m = 1; m <= models; m++) printf ",%s", name[m]
    printf "\nother frames of the same takes"; for (m = 1; m <= models; m++) printf ",%.2f", rms["frames", name[m]]
    printf "\nanother person in another motion"; for (m = 1; m <= models; m++) printf ",%.2f", rms["subjects", name[m]]
    print ""
  }' splits/results.csv | tee splits.csv
awk -v decades=1 -v dots=1 -v title='Six of 23 joints are seen: error of all 23, by what models are tested on' -v y='RMS error of a coordinate, cm' \
  -f "$here/../chart.awk" splits.csv > splits.svg

echo '5. How well are gaps filled in people that a model has not seen, beside PCHIP?'
posing evaluate takes -q --lengths 0.1,0.3,0.6 --points 8 --gaps 20 --noise 1 -o takes walk.csv run.csv > takes.txt
sed -n '1,/^$/p' takes.txt
awk -F , '
  $1 == "gaps" { rms[$2, $6] = $9; if (!($2 in line)) { line[$2]; seconds[++n] = $2 } }
  END {
    print "seconds,posing,Gaussian,PCHIP,linear"
    for (i = 1; i <= n; i++) { s = seconds[i]; printf "%s,%.3f,%.3f,%.3f,%.3f\n", s, rms[s, "posing"], rms[s, "Gaussian"], rms[s, "PCHIP"], rms[s, "linear"] }
  }' takes/takes.csv > gaps.csv
awk -v decades=1 -v dots=1 -v title='Eight joints are missing at once: error in the gap, by its length' -v y='RMS error of a coordinate, cm' -v x='length of the gap, s' \
  -f "$here/../chart.awk" gaps.csv > gaps.svg

echo '6. The run with 1 cm of noise, restored with three models. RMS error of a coordinate, cm:'
posing corrupt --dense 1cm -o noisy.csv run.csv
posing denoise -q -m dict.npz -o by-dict.csv noisy.csv
posing denoise -q -m prior.npz -o by-prior.csv noisy.csv
posing denoise -q -o by-builtin.csv noisy.csv
for name in noisy by-dict by-prior by-builtin; do
  posing score --json -o $name.json run.csv $name.csv
  printf '   %-12s %.2f\n' $name "$(number rms $name.json)"
done

echo '7. Which poses of the walk are like those of the run?'
posing retrieve -k 3 --every 12 --database walk.csv --picture found.svg -o found.csv run.csv
sed -n 1,4p found.csv

echo "Look at $PWD/splits/report.html and $PWD/takes/report.html."
