#!/bin/sh
# Runs train.slurm and evaluate.slurm of testdata/examples on a Slurm cluster of two nodes, which it starts on this machine and
# stops again: POSING_BIN=target/release sh tests/slurm/run.sh. Needs root, Slurm and munge; about two minutes.
# shellcheck disable=SC2317 # functions that trap and check call
set -eu
here=$(cd "$(dirname "$0")/../.." && pwd)
PATH=$PATH:/usr/sbin:/sbin
for tool in munged slurmctld slurmd sbatch; do
  command -v $tool >/dev/null || { echo 'skipped: Slurm is not installed (Debian: slurm-wlm, munge)'; exit 0; }
done
[ "$(id -u)" = 0 ] || { echo 'skipped: starting a Slurm cluster needs root'; exit 0; }
PATH=$(cd "${POSING_BIN:-$here/target/release}" && pwd):$PATH
command -v posing >/dev/null

# The cluster: its files and sockets are in one folder, and only its own processes are stopped.
base=$(mktemp -d) host=$(uname -n)
host=${host%%.*}
chmod 755 "$base"
# Every command of Slurm below means this cluster.
export SLURM_CONF="$base/slurm.conf"
pids=
stop() {
  # A job outlives its daemon: it is ended first.
  if scancel --user root 2>/dev/null; then settle 10 || :; fi
  # shellcheck disable=SC2086
  [ -z "$pids" ] || kill $pids 2>/dev/null || :
  wait
  rm -rf "$base"
}
# Waits until no job is left, at most $1 seconds.
settle() {
  end=$(($(date +%s) + ${1:-120}))
  while [ -n "$(squeue -h)" ]; do
    [ "$(date +%s)" -lt "$end" ] || return 1
    sleep 0.2
  done
}
trap stop EXIT
trap 'exit 1' INT TERM HUP
# Waits until a command succeeds, at most 20 seconds.
await() {
  for _ in $(seq 200); do
    ! "$@" >/dev/null 2>&1 || return 0
    sleep 0.1
  done
  echo "never: $*"
  return 1
}
start() {
  "$@" >"$base/$1-$#.out" 2>&1 &
  pids="$! $pids"
}
port=$((20000 + $$ % 9000 * 4))
cat >"$SLURM_CONF" <<END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmctldPort=$port
AuthType=auth/munge
# A requeued job waits for the end of its credential, 120 seconds as a rule.
AuthInfo=socket=$base/munge.socket,cred_expire=5
StateSaveLocation=$base/state
SlurmdSpoolDir=$base/spool-%n
SlurmctldPidFile=$base/slurmctld.pid
SlurmdPidFile=$base/slurmd-%n.pid
SlurmctldLogFile=$base/slurmctld.log
SlurmdLogFile=$base/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,sched_min_interval=100000,bf_interval=1
SlurmdParameters=config_overrides
MailProg=/bin/true
MpiDefault=none
ReturnToService=2
KillWait=2
MinJobAge=600
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=1 RealMemory=8000
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=1 RealMemory=8000
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
mkdir "$base/state" "$base/spool-n1" "$base/spool-n2"
dd if=/dev/urandom of="$base/munge.key" bs=1024 count=1 2>/dev/null
chmod 600 "$base/munge.key"
start munged --foreground --force --key-file="$base/munge.key" --socket="$base/munge.socket" --pid-file="$base/munged.pid" \
  --seed-file="$base/munged.seed"
await test -S "$base/munge.socket"
start slurmctld -D -i
start slurmd -D -N n1
start slurmd -D -N n2
idle() { [ "$(sinfo -h -o '%T %D')" = 'idle 2' ]; }
await idle || { tail -n 5 "$base"/*.log "$base"/*.out; exit 1; }

examples=$here/testdata/examples cmu=$here/testdata/cmu bad=0
# Runs a test, which is a function: $1 says what it shows.
check() {
  began=$(date +%s)
  if "$2" >"$base/check" 2>&1; then echo "ok: $1 ($(($(date +%s) - began)) s)"; return; fi
  echo "FAILED: $1"
  bad=1
  tail -n 20 "$base/check" logs/slurm-*.out 2>/dev/null || :
}
# A folder with poses, and the split of folder $2.
folder() {
  mkdir "$base/$1"
  cd "$base/$1"
  cp -p "$base/poses.csv" 'my poses.csv'
  [ $# = 1 ] || { cp -Rp "$base/$2/parts" . && rm -f parts/*.npz parts/state/*.of; }
}
same() { cmp dict.npz "$base/one after another/dict.npz"; }
written() { stat -c '%n %y' "$@"; }
# The process that trains part $1 in this folder.
trainer() {
  for pid in $(pgrep -x ksvd-train); do
    [ "$(readlink "/proc/$pid/cwd")" = "$PWD" ] || continue
    if tr '\0' '\n' <"/proc/$pid/cmdline" | grep -qx "parts/$1.csv"; then echo "$pid"; return; fi
  done
  return 1
}
submit() { sh "$examples/train.slurm"; }
train() { submit && settle; }

unset CLUSTER DICT FORMAT JOIN PARTS LOGS POSING THREADS JOBS SSHLOGIN BENCH EVALUATE_STEP
export POSES='my poses.csv' K=4 TRAIN='-n 8 --iterations 1000'
posing amc2xyz -q --space body --asf "$cmu/07/07.asf" --fps 120 -o "$base/poses.csv" "$cmu/07/07_01.amc"

folder 'one after another'
posing cluster -q -k $K --balance --split parts "$POSES"
for part in parts/?.csv; do
  # shellcheck disable=SC2086 # a list of flags
  posing ksvd-train -q $TRAIN -o "${part%.csv}.npz" "$part"
done
posing dict-concat -q --prune 0.999 -o dict.npz parts/?.npz

folder 'by make'
cp "$examples/train.mk" "$examples/train.sh" .
by_make() { make -f train.mk -j2 "POSES=$POSES" "K=$K" "TRAIN=$TRAIN" && same; }
check 'train.mk gives the same bytes as the commands one after another' by_make

if command -v parallel >/dev/null; then
  folder 'by parallel'
  by_parallel() { JOBS=2 sh "$examples/train.parallel.sh" && same; }
  check 'train.parallel.sh gives the same bytes' by_parallel
else
  echo 'skipped: GNU parallel is not installed'
fi

folder 'by Slurm'
by_slurm() { train && same; }
check 'train.slurm gives the same bytes' by_slurm
written parts/*.npz dict.npz >"$base/written"
# Submitted twice at once, too: the second run waits for the first.
again() { submit && train && written parts/*.npz dict.npz | cmp - "$base/written"; }
check 'run again, it trains no part again' again

folder killed 'by Slurm'
killed() { submit && await test -e parts/1.npz.checkpoint && kill -9 "$(trainer 1)" && settle && grep resuming logs/1.log && same; }
check 'a part that is killed goes on from its checkpoint, and gives the same bytes' killed

folder requeued 'by Slurm'
requeued() {
  submit && await test -e parts/1.npz.checkpoint && scontrol requeue "$(squeue -h -r -t R -o %F_%K | grep _1)" &&
    settle && grep resuming logs/1.log && same
}
check 'so does one that Slurm queues again' requeued

folder 'killed with its shell' 'by Slurm'
killed_whole() {
  submit && await test -e parts/1.npz.checkpoint && scancel --full --signal=KILL "$(squeue -h -r -t R -o %F_%K | grep _1)" &&
    settle && grep '^train.sh: parts/1.csv is not trained' logs/slurm-*.out && [ ! -e dict.npz ] && train &&
    grep resuming logs/1.log && same
}
check 'a task that is killed with its shell is named; submitted again, it goes on, and gives the same bytes' killed_whole

folder 'always killed' 'by Slurm'
printf '#!/bin/sh\ncase "$*" in *parts/1.csv*) kill -9 $$ ;; esac\nexec posing "$@"\n' >posing
chmod +x posing
always_killed() {
  POSING=./posing train && grep '^train.sh: parts/1.csv is not trained: train.sh: stopped by signal 9' logs/slurm-*.out &&
    [ "$(grep -c 'signal 9' logs/1.log)" = 4 ] && [ -e parts/3.npz ] && [ ! -e dict.npz ] && train && same
}
check 'one that is always killed is queued again three times, and no more' always_killed

folder 'not split'
echo nonsense >'my poses.csv'
not_split() { train && grep '^train.sh: parts is not split: cluster: my poses.csv:1' logs/slurm-*.out && [ ! -e parts/0.npz ]; }
check 'poses that cannot be split end all jobs, and the join says why' not_split

folder damaged 'by Slurm'
echo nonsense >parts/3.csv
damaged() {
  train && grep '^train.sh: parts/3.csv is not trained: ksvd-train: parts/3.csv:1' logs/slurm-*.out &&
    [ ! -e dict.npz ] && [ ! -e parts/3.npz ]
}
check 'a damaged part is named with its error, and there is no dictionary' damaged
written parts/[012].npz >"$base/written"
cp "$base/by Slurm/parts/3.csv" parts/3.csv
repaired() { train && same && written parts/[012].npz | cmp - "$base/written"; }
check 'when it is repaired, only this part is trained, and the bytes are the same' repaired

folder evaluation
# A table of eight takes.
awk -F, -v OFS=, 'NR > 1 { $1 = $1 "_" int((NR - 2) / 40) } 1' "$POSES" >'my takes.csv'
evaluate() { "$@" --models pca,ksvd:n=20 --splits takes,frames --tasks dense,complete --seeds 2 --frames 30 'my takes.csv'; }
evaluate posing evaluate -q -o one >/dev/null
export TASKS=8
same_results() { cmp one/results.csv "$1/results.csv" && cmp one/results.json "$1/results.json"; }
evaluated() { BENCH='by Slurm' evaluate sh "$examples/evaluate.slurm" && settle && same_results 'by Slurm'; }
check 'evaluate.slurm in 8 tasks gives the same bytes of results.csv and results.json as one machine' evaluated
printf '#!/bin/sh\ncase "$*" in *--cells\\ 3/8*) echo "no license" >&2; exit 1 ;; esac\nexec posing "$@"\n' >posing
chmod +x posing
failed() {
  POSING=./posing BENCH=failed evaluate sh "$examples/evaluate.slurm" && settle &&
    grep '^evaluate.slurm: task 3 failed: no license' failed/logs/*.out && [ ! -e failed/results.csv ] && BENCH=failed evaluate sh "$examples/evaluate.slurm" && settle && same_results failed
}
check 'a task that fails is named, and there is no report; submitted again, it gives the same bytes' failed

exit $bad
