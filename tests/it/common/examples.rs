//! The files that the examples of the help texts and the recipes of README.md name, and a shell
//! that runs them.

use std::path::Path;
use std::process::{Command, Output};

/// Makes the files that the examples name: from a take of CMU, by the commands themselves.
pub const SETUP: &str = r#"
set -euo pipefail
cp "$TAKES"/07/07.asf "$TAKES"/07/07_01.amc .
posing amc2xyz --asf 07.asf --fps 120 -o truth.csv 07_01.amc
posing corrupt --gaps 2 --length 0.1 --points 2 truth.csv > walk.csv
posing corrupt --dense 1cm truth.csv > noisy.csv
cp walk.csv damaged.csv; cp walk.csv gaps.csv
posing complete walk.csv > restored.csv
cp restored.csv completed.csv
posing denoise noisy.csv > denoised.csv
posing amc2xyz --asf 07.asf --fps 120 --space body -o poses.npy 07_01.amc
posing amc2xyz --asf 07.asf --fps 120 --space body -o poses.csv 07_01.amc
awk 'NR % 7 == 1' poses.csv > other.csv
posing ksvd-train -q -n 20 --iterations 2 -o dict.npz poses.csv
posing ksvd-train -q --space body -n 20 --iterations 2 -o mine.npz poses.csv
for name in model walk run part-0 part-1; do cp dict.npz $name.npz; done
# Two takes a table: the walk's first half and the run's, each cut in parts.
cp "$TAKES"/09/09.asf "$TAKES"/09/09_06.amc .
posing amc2xyz --asf 09.asf --fps 120 --space body -o run.csv 09_06.amc
cut_takes() { awk -F, -v OFS=, -v s="$1" 'NR > 1 { $1 = s "_0" 1 + (NR > 60) } NR == 1 || NR % 8 < 4' "$2"; }
for s in 01 02 07; do cut_takes $s poses.csv > $s.csv; done
cut_takes 09 run.csv > my-takes.csv
cp truth.csv mine.csv
# The walk by another system, which began later.
cp truth.csv mocap.csv; awk 'NR == 1 || NR > 40' noisy.csv > video.csv
posing amc2xyz --asf 09.asf --fps 120 09_06.amc | tail -n +2 | cat truth.csv - > two-people.csv
awk -F, -v OFS=, 'NR > 160 { $1 = "rest" } 1' truth.csv > two-takes.csv
# Two people side by side.
awk -F, -v OFS=, 'NR == 1 { for (i = 3; i <= NF; i++) { a = a ",Ann:" $i; b = b ",Ben:" $i } print $1, $2 a b; next } { a = ""; for (i = 3; i <= NF; i++) a = a "," $i; print $1, $2 a a }' truth.csv > both.csv
# Labeled pairs of the frames of poses.csv.
{ echo a_take,a_frame,b_take,b_frame,label; for k in $(seq 30); do echo "07_01,$k,07_01,$((k + 100)),1"; echo "07_01,$k,07_01,$((k + 60)),0"; done; } > pairs.csv
posing rdsr-train -q --unlabelled 100 --pairs pairs.csv -o metric.npz poses.csv
for joint in Hip=root Chest=thorax Neck=lowerneck Head=head LShoulder=lclavicle LElbow=lhumerus LHand=lwrist LHip=lhipjoint LKnee=lfemur \
  LFoot=ltibia RShoulder=rclavicle RElbow=rhumerus RHand=rwrist RHip=rhipjoint RKnee=rfemur RFoot=rtibia; do
  echo "${joint%=*} = \"${joint#*=}\""
done > joints.toml
# Four takes of each of two actions.
awk -F, -v OFS=, 'NR == 1 || NR % 4 == 0 { if (NR > 1) { k = int(n[$1] / 9); n[$1] += 1; $1 = $1 "_" (k > 3 ? 3 : k) } print }' two-people.csv > takes.csv
{ echo take,class,subject; for k in 0 1 2 3; do echo "07_01_$k,walk,$k"; echo "09_06_$k,run,$k"; done; echo 07_01,walk,07; } > classes.csv
# Small bodies, markers on some that the model has not seen, and a scan of one.
cp "$BODIES"/*.npz "$BODIES"/*.csv .
posing body-train -q --units cm --poses poses.npz --shapes people.npz --parts parts.csv --joints joints.csv -o body.npz
mkdir poses; posing body-synth -q -m body.npz --shape 0 -o poses/0.obj; posing body-synth -q -m body.npz --shape 1 -o poses/1.obj
posing body-fit -q -m body.npz --on on.csv -o fits.npz --rotations rotations.csv markers.csv
posing body-synth -q -m body.npz --shape 0 -o scan.ply; posing body-synth -q -m body.npz --shape 1 -o template.ply
awk 'BEGIN { print "vertex,x,y,z" } $1 == "v" { if (v++ % 150 == 0) print v - 1 "," $2 "," $3 "," $4 }' poses/0.obj > points.csv
gunzip -c "$TAKES"/../examples/animator/walk.fbx.gz > walk.fbx
# A laboratory's trials.
cp "$TAKES"/../examples/gait/*.c3d "$TAKES"/../examples/gait/norm.json .
# The walk as files of markers.
posing xyz2c3d -q -o gait.c3d walk.csv; cp gait.c3d old.c3d
sed '1{s/lhipjoint/LFWT/g;s/rhipjoint/RFWT/g;s/lfemur/LKNE/g;s/rfemur/RKNE/g;s/ltibia/LANK/g;s/rtibia/RANK/g;s/lclavicle/LSHO/g;s/rclavicle/RSHO/g;s/lowerneck/C7/g
  s/,head/,LBHD/g;s/lfoot/LMT5/g;s/rfoot/RMT5/g;s/lwrist/LFIN/g;s/rwrist/RFIN/g;s/lhumerus/LELB/g;s/rhumerus/RELB/g}' \
  walk.csv | posing xyz2c3d -q -o markers.c3d
awk -F, -v OFS=, 'NR == 1 { for (i = 3; i <= NF; i++) { split($i, part, "."); $i = "*" int((i - 3) / 3) "." part[2] } } 1' \
  walk.csv | posing xyz2c3d -q -o raw.c3d
posing xyz2trc -q -o gait.trc walk.csv
mkdir captures markers raw; cp raw.c3d raw/walk.c3d; cp markers.c3d raw/static.c3d; cp gait.trc walk.csv captures/; cp markers.c3d markers/
printf '%s\n' 'Format Version,1.23,Export Frame Rate,120,Length Units,Meters' '' ',Type,Marker,Marker,Marker' ',Name,A,A,A' ',,Position,Position,Position' \
  'Frame,Time (Seconds),X,Y,Z' > motive.csv
for t in $(seq 0 99); do echo "$t,,0.$((100 + t)),1,2"; done >> motive.csv
printf '%s\n' Trajectories 100 ',,Ann:A,,' 'Frame,Sub Frame,X,Y,Z' ',,mm,mm,mm' '1,0,1,2,3' '2,0,2,3,4' > nexus.csv
printf '%s\n' A_x,A_y,A_z,A_error 1,2,3,.1 2,3,4,.1 > anipose.csv
mkdir openpose; for t in 0 1; do
  printf '{"people":[{"pose_keypoints_3d":[%s0,0,0,0]}]}' "$(seq -s, 96)," > openpose/walk_00000000000${t}_keypoints.json
done
printf '[{"pose_world_landmarks":[%s{"x":0,"y":-0.6,"z":0}]}]' "$(seq 32 | sed 's/.*/{"x":0.1,"y":-0.&,"z":0},/')" > mediapipe.json
printf '%s\n' knee 'nRows=2' 'nColumns=2' 'inDegrees=yes' endheader 'time\tknee_angle' '0\t10' '0.01\t11' | sed 's/\\t/\t/' > angles.mot
printf 'NO_OF_FRAMES\t1\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\tA\n1\t0\t1\t2\t3\n' > qualisys.tsv
printf 'tables = ["my-takes.csv"]\nmodels = ["pca"]\nseeds = 1\nsplits = ["takes"]\nframes = 20\n' > bench.toml
posing evaluate -q --splits takes --seeds 1 --frames 20 --models pca --cells 1/1 -o cells/1 01.csv 02.csv 07.csv
"#;

/// Examples of minutes, typed with a smaller number.
pub const SMALLER: &[(&str, &str)] = &[
    ("-k 2000 --branch 10", "-k 20 --branch 4"),
    ("-n 1000", "-n 20"),
    (
        "evaluate --splits takes -o",
        "evaluate --splits takes --seeds 1 --frames 20 --models pca -o",
    ),
    (
        "evaluate --splits frames,takes -o",
        "evaluate --splits frames,takes --seeds 1 --frames 20 --models pca -o",
    ),
    (
        "evaluate --splits takes --seeds 5",
        "evaluate --splits takes --seeds 1 --frames 20 --models pca",
    ),
    (
        "sparse,ksvd:n=500:k=5,ksvd-omp --tasks",
        "sparse:n=20,ksvd:n=20:k=5 --seeds 1 --frames 20 --tasks",
    ),
    ("evaluate metric", "evaluate metric --short --pairs 10"),
    (
        "evaluate takes -o",
        "evaluate takes --gaps 1 --lengths 0.1 --points 1 --noise 1 -o",
    ),
    (
        "evaluate --splits takes -m mine.npz",
        "evaluate --splits takes --seeds 1 --frames 20 --models gaussian -m mine.npz",
    ),
];

/// What the examples of BVH read, where the commands that write it are there.
pub const BVH: &str = "
set -e
posing xyz2bvh -o walk.bvh truth.csv
cp walk.bvh old.bvh; cp walk.bvh from-blender.bvh; cp walk.bvh hero.bvh; cp walk.bvh rig.bvh
sed '1 s/\\.\\([xyz]\\)/_\\1/g' truth.csv > a.csv
mkdir motions; cp walk.bvh motions/
posing prior-train -q --motion -o motion.npz motions/*.bvh
awk 'NR == 1 || NR % 40 == 2' truth.csv > keys.csv; posing xyz2bvh -q -o keys.bvh keys.csv
mkdir -p cmu/07 cmu/09; cp 07.asf 07_01.amc cmu/07; cp 09.asf 09_06.amc cmu/09
posing rotations-train -q -o rotations.npz cmu/*/
sed -E '1 s/\\<l(hipjoint|femur|tibia|foot|clavicle|humerus|radius)/left_\\1/g
  1 s/\\<r(hipjoint|femur|tibia|foot|clavicle|humerus|radius)/right_\\1/g
  1 s/hipjoint/hip/g; 1 s/femur/knee/g; 1 s/tibia/ankle/g; 1 s/foot/foot_index/g
  1 s/clavicle/shoulder/g; 1 s/humerus/elbow/g; 1 s/radius/wrist/g' truth.csv > keypoints.csv
";

/// Runs a script where the commands are on the PATH.
pub fn bash(script: &str, folder: &Path) -> Output {
    let bin = crate::common::bin();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    let (takes, bodies) = (data.join("cmu"), data.join("bodies"));
    Command::new("bash")
        .args(["-o", "pipefail", "-c", script])
        .current_dir(folder)
        .env("PATH", path)
        .env("TAKES", takes)
        .env("BODIES", bodies)
        // Else help wraps its examples.
        .env("COLUMNS", "1000")
        // `posing help` would open a pager.
        .env("MANPAGER", "cat")
        .output()
        .unwrap()
}

/// Runs a script that must succeed; its standard output.
pub fn must(script: &str, folder: &Path) -> String {
    let out = bash(script, folder);
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{script}\n{}\n{said}", out.status);
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Runs a server until it has printed its address, then ends it.
pub fn until_ready(line: &str) -> String {
    let line = line.replace("--port 8000", "--port 0");
    format!(
        "unset DISPLAY WAYLAND_DISPLAY; rm -f address
        {line} > address & server=$!
        until grep -q token address; do kill -0 $server || exit 1; sleep 0.1; done
        kill $server; wait $server"
    )
}
