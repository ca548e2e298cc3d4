#!/bin/sh
#SBATCH --job-name=posing-train
#SBATCH --array=0-7
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --requeue
# Learns one part of parts/*.csv an array task; a task that is requeued goes on from its checkpoint. Then, once:
#
#     posing cluster -k 8 --split parts poses.csv
#     job=$(sbatch --parsable slurm.sh)
#     sbatch --dependency=afterok:$job --wrap 'posing dict-concat --prune 0.999 -o dict.npz parts/*.npz'
set -eu
set -- parts/*.csv
shift "${SLURM_ARRAY_TASK_ID:?run me with sbatch}"
[ $# -gt 0 ] && [ -e "$1" ] || { echo "slurm.sh: no part $SLURM_ARRAY_TASK_ID" >&2; exit 2; }
part=$1 model=${1%.csv}.npz
"${POSING:-posing}" ksvd-train -n "${ATOMS:-200}" --threads "${SLURM_CPUS_PER_TASK:-1}" \
  --checkpoint "$model.checkpoint" --log "${model%.npz}.jsonl" -o "$model" "$part"
rm -f "$model.checkpoint"
