#!/bin/sh
# A machine for services: systemd as process 1 of its own namespaces, on top of this machine's files.
#
#   machine.sh GROUP     runs it until standard input ends
#
# GROUP is a cgroup (version 2), which is made, and removed in the end. Nothing that happens in the machine
# changes this one: what it writes lies in memory, and is gone with it.
set -eu

# Process 1. It joins the cgroup first, so that the cgroup is the root of its own cgroup namespace.
inside() {
    ip link set lo up
    mount -t tmpfs run /run
    mkdir /run/layers
    for folder in etc usr var; do
        mkdir "/run/layers/$folder" "/run/layers/$folder.work"
        layers="lowerdir=/$folder,upperdir=/run/layers/$folder,workdir=/run/layers/$folder.work"
        mount -t overlay -o "$layers" overlay "/$folder"
    done
    mount -t tmpfs tmp /tmp
    mount -t tmpfs tmp /var/tmp
    # Of this machine's own services none starts but the journal. Nothing of its kernel is set or written to.
    rm -rf /etc/systemd/system/* /etc/systemd/system-generators /usr/lib/systemd/system-generators
    rm -rf /etc/fstab /var/log/journal
    find /usr/lib/systemd/system -path '*.wants/*' ! -name 'systemd-journald*' -delete
    tr -d - </proc/sys/kernel/random/uuid >/etc/machine-id
    mount --bind /dev/null /dev/kmsg
    for folder in /proc/sys /sys /; do
        [ "$folder" = / ] || mount --bind "$folder" "$folder"
        mount -o remount,bind,ro "$folder"
    done
    mount -t cgroup2 cgroup2 /sys/fs/cgroup
    # As on any machine with systemd, which hands credentials over in mounts of its children.
    mount --make-rshared /
    exec env -i container=docker PATH="$PATH" \
        /lib/systemd/systemd --unit=basic.target --log-target=journal --show-status=no
}

if [ "$1" = inside ]; then
    inside
elif [ "$1" = join ]; then
    echo 0 >"$2/cgroup.procs"
    exec unshare --cgroup "$0" inside
fi

mkdir "$1"
# Killed together with process 1, unshare complains of a signal that it cannot pass on.
unshare --pid --fork --kill-child --mount --mount-proc --uts --ipc --net "$0" join "$1" </dev/null 2>&1 |
    grep --line-buffered -v sigprocmask >&2 &
cat >/dev/null
# With process 1 ends all that it has started, and then grep.
echo 1 >"$1/cgroup.kill"
wait $! || true
find "$1" -depth -type d -exec rmdir {} +
