#!/bin/sh
# The worked case of a gait laboratory; README.md beside this file tells it.
#   run.sh [OUT]     writes into the folder OUT (default: out)
set -eu
export LC_ALL=C
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-out}
mkdir -p "$out"
cd "$out"
cp "$here/static.c3d" "$here/walk.c3d" "$here/norm.json" .

# Exit code 3: done, and somebody should look at it.
findings() {
  [ "$1" = 3 ] || exit "$1"
  echo '   exit code 3: there are findings'
}

echo '1. Is something wrong with the trials?'
posing audit static.c3d walk.c3d -o audit.html || findings $?

echo '2. From the trials to tables, C3D, and the page.'
posing gait --static static.c3d walk.c3d --norm norm.json -o report

echo '3. Events by markers alone, as where there are no plates.'
posing gait --static static.c3d walk.c3d --events markers -o by-markers
events() { awk -F'"' '/"kind": "foot_/ { k = $4 } /"side"/ { s = $4 } /"time_s"/ && k { gsub(/[^0-9.]/, "", $3); print s, k, $3; k = "" }' "$1" | sort; }
for name in report by-markers; do events $name/gait.json > events-$name.txt; done
paste -d ' ' events-report.txt events-by-markers.txt | awk '{ e = 1000 * ($6 - $3); printf "   %-5s %-11s %7.3f s, by markers %+.0f ms\n", $1, $2, $3, e }'

echo '4. A knee is hidden for 0.2 s: the gap is filled, and every angle says what that costs.'
posing c3d2xyz walk.c3d | awk -F, -v OFS=, '
  NR == 1 { for (i = 1; i <= NF; i++) if ($i == "LKNE.x") k = i }
  NR > 1 && $2 >= 4.1 && $2 < 4.3 { $k = $(k + 1) = $(k + 2) = "" } 1' > hidden.csv
mkdir -p hidden
posing xyz2c3d hidden.csv --into walk.c3d -o hidden/walk.c3d
posing gait --static static.c3d hidden/walk.c3d --sd -o hidden/report || findings $?
column() { awk -F, -v name="$2" 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == name) k = i } NR > 1 { print $k }' "$1"; }
column report/walk.csv LKneeAngles.ry > a.txt
column hidden/report/walk.csv LKneeAngles.ry > b.txt
column hidden/report/walk.csv LKneeAngles.ry.sd > c.txt
paste a.txt b.txt c.txt | awk '$3 > 0 { n++; e = $2 - $1; e = e < 0 ? -e : e; if (e > most) most = e; inside += e <= 1.96 * $3; if ($3 > sd) sd = $3 }
  END { printf "   knee varus in %d filled frames: at most %.1f degrees off, the largest deviation that is said is %.1f; %d frames within 1.96 of it\n", n, most, sd, inside }'

echo '5. A norm of your own trials.'
posing gait --static static.c3d walk.c3d --make-norm own.json -o again

echo '6. The knees over the cycle, for a figure.'
awk -F, '
  NR == 1 { for (i = 1; i <= NF; i++) if ($i == "KneeAngles.rx") k = i }
  $1 == "" && $3 == "mean" { flexion[$2, $6] = $k }
  END { print "percent,left,right"; for (p = 0; p <= 100; p++) print p "," flexion["left", p] "," flexion["right", p] }' report/cycles.csv > knee.csv
awk -v title='Knee flexion' -v x='percent of the gait cycle' -v y=degrees -v colors='#c8102e,#1f6fb4' -f "$here/../chart.awk" knee.csv > knee.svg
echo "Look at $PWD/report/index.html."
