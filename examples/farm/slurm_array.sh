#!/bin/bash
# Tracks shots on Slurm, one task of an array each, at most four at a time:
#
#     sbatch --array=0-19%4 slurm_array.sh 'shots/*.toml' results
#
# Task N tracks the N-th of the shots by name, from 0. The same job sent again does what is not done yet.
#SBATCH --job-name=kfmocap
#SBATCH --cpus-per-task=2
#SBATCH --mem=2G
#SBATCH --requeue
#SBATCH --output=kfmocap-%A_%a.log

shots=${1:?the shots: a pattern in quotes} out=${2:?the folder for the results}

# The process itself gets the signal by which Slurm ends a task, and leaves nothing half-written.
exec "${KFMOCAP:-kfmocap}" batch "$shots" --out "$out" --task "$SLURM_ARRAY_TASK_ID" --jobs 1 --no-blender
