#!/bin/sh
# Builds scans to one .esker file by arrays of a Slurm cluster:
#
#     JOBS=64 docs/clusters/slurm.sh PLACE OUT SCAN... [options of `esker job plan`]
#
# PLACE is a folder that all nodes see. The program is `esker` of the PATH, or $ESKER. The script
# ends when the file is there, or with an error; run it again to go on where it stopped.
set -eu
place=$1
out=$2
shift 2
: "${ESKER:=esker}" "${JOBS:=8}" "${THREADS:=1}" "${MEMORY:=2GiB}" "${LIMIT:=3G}" "${SCRATCH:=/tmp}"

"$ESKER" job plan "$@" --to "$place" --jobs "$JOBS"

how="--to '$place' --memory $MEMORY --threads $THREADS --scratch '$SCRATCH' --progress none"
submit() {
    step=$1
    shift
    sbatch --parsable --kill-on-invalid-dep=yes --job-name="esker-$step" \
        --cpus-per-task="$THREADS" --mem="$LIMIT" "$@"
}
last=$((JOBS - 1))
take=$(submit take --array="0-$last" --output="$place/log-take-%a.txt" --wrap "'$ESKER' job take $how")
cut=$(submit cut --dependency="afterok:$take" --output="$place/log-cut.txt" --wrap "'$ESKER' job cut $how")
build=$(submit build --array="0-$last" --dependency="afterok:$cut" \
    --output="$place/log-build-%a.txt" --wrap "'$ESKER' job build $how")
submit join --wait --dependency="afterok:$build" --output="$place/log-join.txt" \
    --wrap "'$ESKER' job join $how -o '$out'" || {
    "$ESKER" job status --to "$place"
    exit 1
}
