#!/bin/sh
# The worked case of an animator; README.md beside this file tells it.
#   run.sh [OUT]     writes into the folder OUT (default: out)
set -eu
export LC_ALL=C
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-out}
mkdir -p "$out"
cp "$here/../../cmu/07/07.asf" "$here/../../cmu/07/07_01.amc" "$here/goblin.bvh" "$out"
cd "$out"
mkdir -p original captured

# Exit code 3: done, and somebody should look at it.
findings() {
  [ "$1" = 3 ] || exit "$1"
  echo '   exit code 3: there are findings'
}

echo '1. A walk as a BVH file, and what a suit makes of it: noise, thrown joints, missing rotations.'
posing amc2xyz --asf 07.asf --fps 120 -o walk.csv 07_01.amc
posing xyz2bvh --skeleton 07.asf -o original/walk.bvh walk.csv
awk -f "$here/damage.awk" original/walk.bvh > captured/walk.bvh

echo '2. What is wrong with it?'
posing audit captured/walk.bvh || findings $?

echo '3. Clean it, in its own rotations.'
posing clean captured/walk.bvh -o cleaned/walk.bvh || findings $?

echo '4. How far are its joints from the original?'
for folder in original captured cleaned; do
  posing bvh2xyz -q -o $folder.csv $folder/walk.bvh
done
posing score --damaged captured.csv original.csv cleaned.csv > score.txt
sed -n '3,/^was observed/p' score.txt

echo '5. Give the walk to another rig, and a file that viewers play.'
mkdir -p goblin
posing retarget --to goblin.bvh cleaned/walk.bvh -o goblin/walk.bvh
posing bvh2xyz goblin/walk.bvh | posing xyz2glb --skeleton goblin/walk.bvh -o goblin/walk.glb

echo '6. Draw it.'
posing plot --title 'A walk as captured, and cleaned' --names captured,cleaned --frames 85,151,190,251 -o cleaned.svg captured/walk.bvh cleaned/walk.bvh
posing plot --title 'The cleaned walk on the rig' --names goblin --frames 85,151,190,251 -o goblin.svg goblin/walk.bvh

echo "Watch $PWD/cleaned/walk.bvh.html, and open $PWD/goblin/walk.glb in a viewer."
