#!/bin/sh
# Makes gait.c3d: 39 markers on the skin of a body of testdata/bodies that walks as CMU's take 07_01, 60 frames a second.
#   capture.sh OUT.c3d     half a minute
set -eu
export LC_ALL=C
here=$(cd "$(dirname "$0")" && pwd)
data=$here/../..
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
posing body-train -q --units cm --poses "$data/bodies/poses.npz" --shapes "$data/bodies/people.npz" \
  --parts "$data/bodies/parts.csv" --joints "$data/bodies/joints.csv" -o "$work/body.npz"
posing amc2xyz --asf "$data/cmu/07/07.asf" --fps 120 "$data/cmu/07/07_01.amc" |
  posing trim -q --resample 60 -o "$work/walk.csv"
posing body-synth -q -m "$work/body.npz" --pose "$work/walk.csv" --mesh-format obj -o "$work/frames/"

# landmarks.csv says which vertex is under which marker: a row of the table for each mesh.
awk '
FNR == 1 { files++ }
files == 1 { if (FNR > 1) { split($0, part, ","); name[++markers] = part[1]; vertex[markers] = part[2] } next }
FNR == 1 { finish(); vertices = 0 }
$1 == "v" { at[vertices++] = $2 "," $3 "," $4 }
END { finish() }
function finish(  m) {
  if (!vertices) { printf "time"; for (m = 1; m <= markers; m++) printf ",%s.x,%s.y,%s.z", name[m], name[m], name[m] }
  else { printf "%.6f", frames / 60; frames++; for (m = 1; m <= markers; m++) printf ",%s", at[vertex[m]] }
  print ""
}' "$here/landmarks.csv" "$work"/frames/*.obj | posing xyz2c3d -o "$1"
