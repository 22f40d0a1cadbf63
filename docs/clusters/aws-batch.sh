#!/bin/sh
# Builds scans in S3 to one .esker file by array jobs of AWS Batch:
#
#     JOBS=64 QUEUE=my-queue DEFINITION=esker docs/clusters/aws-batch.sh s3://bucket/work OUT SCAN...
#
# aws-batch.json is the job definition, registered once with
# `aws batch register-job-definition --cli-input-json file://docs/clusters/aws-batch.json`. Its role
# reads the scans, and reads and writes the place; the program is built with the feature `remote`.
# The plan is made here. OUT is an address, such as s3://bucket/town.esker.
set -eu
place=$1
out=$2
shift 2
: "${ESKER:=esker}" "${JOBS:=8}" "${QUEUE:?}" "${DEFINITION:=esker}"

"$ESKER" job plan "$@" --to "$place" --jobs "$JOBS"

# submit STEP DEPENDS-ON ARRAY WORD...: prints the id of the job.
submit() {
    step=$1 after=$2 array=$3
    shift 3
    words=$(printf ',"%s"' "$@")
    aws batch submit-job --job-name "esker-$step" --job-queue "$QUEUE" \
        --job-definition "$DEFINITION" ${after:+--depends-on "jobId=$after"} \
        ${array:+--array-properties "size=$array"} --query jobId --output text \
        --container-overrides "{\"command\": [\"job\",\"$step\",\"--to\",\"$place\"$words]}"
}
# An array has at least two jobs.
array=$([ "$JOBS" -gt 1 ] && echo "$JOBS" || true)
index=$([ "$JOBS" -gt 1 ] || echo --job=0)
take=$(submit take "" "$array" --memory=2GiB --threads=1 --scratch=/scratch $index)
cut=$(submit cut "$take" "" --memory=2GiB --threads=1)
build=$(submit build "$cut" "$array" --memory=2GiB --threads=1 --scratch=/scratch $index)
submit join "$build" "" --memory=2GiB "--out=$out"
