#!/bin/sh
# Bakes the job of this folder under Slurm: sh slurm.sh [options of sbatch].
# RELUME is the program, by default `relume`. Run it again for parts that failed: what is done is not done again.
set -eu
cd -- "$(dirname -- "$0")"
relume=${RELUME:-relume}
parts=$(sbatch --parsable --requeue --job-name=relume --array=1-@PARTS@ "$@" \
    --wrap "exec $relume work . --part \$SLURM_ARRAY_TASK_ID --threads \${SLURM_CPUS_ON_NODE:-0}")
sbatch --parsable --job-name=relume-collect --dependency="afterany:${parts%%;*}" "$@" \
    --wrap "exec $relume collect ."
