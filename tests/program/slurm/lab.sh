#!/bin/bash
# A Slurm cluster of three nodes, n0 to n2, in namespaces of its own, and a shell within it.
#
#   lab.sh FOLDER     runs command lines from standard input in the folder, until that ends
#
# After the output of each line comes a line `lab: CODE`. The shell is process 1 of its namespace: with it ends all
# that it has started.
set -eu
if [ "$1" != inside ]; then
    exec unshare --pid --fork --kill-child --mount --mount-proc --net --uts --ipc "$0" inside "$1"
fi
cd "$2"
hostname lab
ip link set lo up
# With loopback addresses alone, Slurm finds nothing to listen on.
ip address add 192.0.2.1/32 dev lo
echo "127.0.0.1 localhost lab n0 n1 n2" >hosts
mount --bind hosts /etc/hosts

lab=$PWD/lab
mkdir -p "$lab/state"
# Services of one machine, without users, accounts and limits of memory. A job that is ended has 10 s.
cat >"$lab/slurm.conf" <<CONF
ClusterName=lab
SlurmctldHost=lab(127.0.0.1)
SlurmUser=root
AuthType=auth/none
CredType=cred/none
StateSaveLocation=$lab/state
SlurmdSpoolDir=$lab/spool-%n
TmpFS=/tmp
SlurmctldPidFile=$lab/slurmctld.pid
SlurmdPidFile=$lab/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SchedulerParameters=bf_interval=1
KillWait=10
ReturnToService=2
MailProg=/bin/true
GresTypes=gpu
NodeName=n[0-2] NodeHostname=lab NodeAddr=127.0.0.1 Port=[26900-26902] CPUs=4 Gres=gpu:fake:4
PartitionName=lab Nodes=ALL Default=YES OverSubscribe=FORCE:4 State=UP
CONF
# Devices that no program takes for a graphics card.
for device in null zero full random; do
    echo "NodeName=n[0-2] Name=gpu Type=fake File=/dev/$device"
done >"$lab/gres.conf"
export SLURM_CONF=$lab/slurm.conf

slurmctld -D -c >"$lab/slurmctld.log" 2>&1 &
controller=$!
for node in n0 n1 n2; do
    slurmd -D -N "$node" >"$lab/$node.log" 2>&1 &
done
until [ "$(sinfo --noheader --Node --states=idle 2>/dev/null | wc -l)" = 3 ]; do
    kill -0 "$controller"
    sleep 0.1
done

# The numbers of the processes of a role, one a line.
processes() {
    for process in /proc/[0-9]*; do
        [ "$(cat "$process/comm" 2>/dev/null)" = trimaran ] || continue
        ! tr '\0' ' ' <"$process/cmdline" | grep -q " role $1 " || echo "${process#/proc/}"
    done
}

echo "lab: 0"
while IFS= read -r line; do
    code=0
    (eval "$line") </dev/null 2>&1 || code=$?
    printf '\nlab: %s\n' "$code"
done
