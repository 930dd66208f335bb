#!/bin/sh
# A walk started by Open MPI: a display on one host, a culler on each of the others.
#
#   ./walk.sh plant.scene walk show one,two --frames 400
#
# The scene and the folder of the report are on a file system that all hosts have. Further arguments are flags
# of `trimaran role display`. The exit code is not 0 unless the walk came to its end. After a lost host run it
# again: the walk goes on. The links are not encrypted: see examples/slurm/walk.sbatch for keys.
set -eu
usage="usage: walk.sh X.scene OUT DISPLAY-HOST CULLER-HOST,.. [flags of trimaran role display]"
scene=${1:?$usage} out=${2:?$usage} display=${3:?$usage} cullers=${4:?$usage}
shift 4
port=${PORT:-7400}
count=$(echo "$cullers" | tr ',' '\n' | wc -l)

# Asked to stop, mpirun waits for so many seconds, asks the processes, waits again and kills what is left. Its
# default of 1 s is too short for the display's report. A lost culler ends nothing else: the shell around it
# ends with 0 in any case.
exec mpirun --mca odls_base_sigkill_timeout "${GRACE_S:-6}" \
    --host "$display" -n 1 trimaran role display --scene "$scene" --out "$out" --resumable \
    --listen "tcp://0.0.0.0:$port" --await "$count" --join-timeout 120 "$@" : \
    --host "$cullers" -n "$count" sh -c '"$@" || true' culler trimaran role culler --scene "$scene" \
    --displays "tcp://$display:$port" --for-one-session --join-timeout 120
