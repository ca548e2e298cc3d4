#!/bin/sh
# The worked case of a biomechanist; README.md beside this file tells it.
#   run.sh [OUT]     writes into the folder OUT (default: out)
set -eu
export LC_ALL=C
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-out}
mkdir -p "$out"
cd "$out"
mkdir -p truth captured
cp "$here/gait.c3d" truth

# Exit code 3: done, and somebody should look at it.
findings() {
  [ "$1" = 3 ] || exit "$1"
  echo '   exit code 3: there are findings'
}

# Markers to connect, in pictures.
bones=LFHD-RFHD,LFHD-LBHD,RFHD-RBHD,LBHD-RBHD,C7-LSHO,C7-RSHO,CLAV-LSHO,CLAV-RSHO,CLAV-STRN,C7-T10
bones=$bones,LSHO-LUPA,LUPA-LELB,LELB-LFRM,LFRM-LWRA,LFRM-LWRB,LWRA-LFIN,LWRB-LFIN
bones=$bones,RSHO-RUPA,RUPA-RELB,RELB-RFRM,RFRM-RWRA,RFRM-RWRB,RWRA-RFIN,RWRB-RFIN
bones=$bones,LASI-RASI,LASI-LPSI,RASI-RPSI,LPSI-RPSI
bones=$bones,LASI-LTHI,LTHI-LKNE,LKNE-LTIB,LTIB-LANK,LANK-LHEE,LHEE-LTOE,LANK-LTOE
bones=$bones,RASI-RTHI,RTHI-RKNE,RKNE-RTIB,RTIB-RANK,RANK-RHEE,RHEE-RTOE,RANK-RTOE
# Joints to connect: the skeleton that is solved.
for s in l r; do
  bones=$bones,root-${s}hipjoint,${s}hipjoint-${s}femur,${s}femur-${s}tibia,${s}tibia-${s}foot,${s}foot-${s}toes,${s}toes-${s}toes_end
  bones=$bones,thorax-${s}clavicle,${s}clavicle-${s}humerus,${s}humerus-${s}radius,${s}radius-${s}wrist,${s}wrist-${s}hand,${s}hand-${s}hand_end
done
bones=$bones,root-lowerback,lowerback-upperback,upperback-thorax,thorax-lowerneck,lowerneck-upperneck,upperneck-head,head-head_end

echo '1. A walk with 39 markers, and what a laboratory gets of it: noise, gaps, a lost label, exchanged legs.'
posing c3d2xyz truth/gait.c3d | posing corrupt --dense 0.5mm | awk -f "$here/damage.awk" | posing xyz2c3d -o captured/gait.c3d

echo '2. What is wrong with it?'
posing audit captured/gait.c3d -o audit.html || findings $?
posing audit captured/gait.c3d -q --json -o audit.json || findings $?
sed -n 's/^ *"what": "\(.*\)".*$/   \1/p' audit.json

echo '3. Put labels right.'
posing label captured/gait.c3d -o labeled/gait.c3d || findings $?

echo '4. Fill gaps, replace outliers: for programs that need every marker.'
posing clean labeled/gait.c3d -o cleaned/gait.c3d || findings $?

echo '5. How far are the markers from the truth?'
for folder in truth captured cleaned; do
  posing c3d2xyz -o $folder.csv $folder/gait.c3d
done
posing score -q --damaged captured.csv truth.csv cleaned.csv > score.txt
sed -n '3,/^was observed/p' score.txt

echo '6. Joint centers, and how sure each is. Of what was measured: labeled, not filled.'
posing solve labeled/gait.c3d --joints anatomical --sd -o centers.csv || findings $?
# For comparison, of the undamaged take, the capture as it came, and the filled take.
posing solve truth/gait.c3d -q --joints anatomical -o centers-truth.csv
posing solve captured/gait.c3d -q --joints anatomical -o centers-captured.csv || findings $?
posing solve cleaned/gait.c3d -q --joints anatomical -o centers-cleaned.csv || findings $?

echo '7. The knees. Error of flexion, degrees, against the undamaged take:'
for name in centers centers-truth centers-captured centers-cleaned; do
  awk -f "$here/knee.awk" $name.csv > knee-$name.csv
done
for name in centers-captured centers centers-cleaned; do
  paste -d , knee-centers-truth.csv knee-$name.csv | awk -F , -v name=$name '
    NR > 1 && $5 != "" { for (i = 2; i <= 3; i++) { e = $(i + 3) - $i; e = e < 0 ? -e : e; sum += e * e; n++; if (e > most) most = e } }
    END { printf "   %-18s RMS %.1f, at most %.1f\n", name, sqrt(sum / n), most }'
done
paste -d , knee-centers-truth.csv knee-centers-captured.csv knee-centers.csv | awk -F , -v OFS=, '
  NR == 1 { print "time", "undamaged", "as captured", "labels put right"; next }
  { print $1, $2, $5, $8 }' > knee.csv
awk -v title='Flexion of the left knee' -v x='time, s' -v y=degrees -v colors='#9aa5b1,#d1622b,#1f6fb4' \
  -v bands='1.17:1.83:legs exchanged,1.93:2.33:markers hidden' -f "$here/../chart.awk" knee.csv > knee.svg

echo '8. How good is filling on markers like these, beside a spline?'
posing evaluate takes -q --self --lengths 0.1,0.2,0.4 --points 1,3 --noise 0.05 -o bench truth.csv > bench.txt
sed -n '1,/^$/p' bench.txt

echo '9. All at once: labels, gaps, and the skeleton.'
posing clean captured/gait.c3d -q --solve -o solved/gait.c3d || findings $?

# The figures of a picture have the same points: markers and joints, of which a figure has some.
empty() { sed '1!s/[^,]*//g' "$1"; }
posing bvh2xyz -q solved/gait.bvh | cut -d , -f 3- > joints.csv
cut -d , -f 3- cleaned.csv > markers.csv
empty joints.csv > no-joints.csv
empty markers.csv | paste -d , - joints.csv > solved.csv
for name in captured cleaned; do paste -d , $name.csv no-joints.csv > figure-$name.csv; done
cut -d , -f 1,2 cleaned.csv | paste -d , - solved.csv > figure-solved.csv
posing plot --title 'posing clean gait.c3d --solve' --bones "$bones" --names captured,cleaned,solved --frames 60,80,90,128 \
  -o markers.svg figure-captured.csv figure-cleaned.csv figure-solved.csv
echo "Look at $PWD/audit.html and $PWD/cleaned/gait.c3d.html."
