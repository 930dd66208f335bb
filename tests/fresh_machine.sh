#!/bin/bash
# Runs the README's two commands on a fresh Debian 12 that holds nothing but the Rust toolchain and git.
#
#   tests/fresh_machine.sh [demo|test|both]      (default: both; needs root and debootstrap)
#
# The machine is a folder made by debootstrap, entered by chroot. This machine's Rust toolchain is mounted
# into it read-only, and the committed state of this checkout is cloned into it. The machine is removed at the
# end, also after a failure.
set -euo pipefail
what=${1:-both}
cd "$(dirname "$0")/.."
repository=$PWD
[ "$(id -u)" = 0 ] || { echo "fresh_machine: needs root for debootstrap and chroot" >&2; exit 2; }
command -v debootstrap >/dev/null || { echo "fresh_machine: needs debootstrap (apt-get install debootstrap)" >&2; exit 2; }

machine=$(mktemp -d)
mount_into() {
    mkdir -p "$machine/$2"
    mount --bind "$1" "$machine/$2"
}
clean_up() {
    # Mounts of the tests as well: network namespaces are mounts.
    findmnt --raw --noheadings --output TARGET | { grep "^$machine" || true; } | tac | while read -r path; do
        umount "$path" || umount --lazy "$path"
    done
    rm -rf --one-file-system "$machine"
}
trap clean_up EXIT

# A root is a mount of its own: `ip` insists on it.
mount --bind "$machine" "$machine"
debootstrap --variant=minbase --include=git,ca-certificates bookworm "$machine"
mount_into /proc proc
mount_into /dev dev
toolchain=$(rustc --print sysroot)
mount_into "$toolchain" opt/rust
mount -o remount,ro,bind "$machine/opt/rust"
cp /etc/resolv.conf "$machine/etc/resolv.conf"
# Debian's installer names the loopback; debootstrap alone does not.
printf '127.0.0.1 localhost\n::1 localhost\n' >"$machine/etc/hosts"
# Behind a proxy with an authority of its own, the fresh machine must trust what this one trusts.
cp /etc/ssl/certs/ca-certificates.crt "$machine/etc/ssl/certs/ca-certificates.crt"

git clone --quiet "$repository" "$machine/root/trimaran"
inside() {
    echo "== fresh machine: $*"
    chroot "$machine" /usr/bin/env -i HOME=/root PATH=/opt/rust/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        ${CARGO_BUILD_JOBS:+CARGO_BUILD_JOBS="$CARGO_BUILD_JOBS"} sh -c "cd /root/trimaran && $*"
}
[ "$what" = test ] || inside ./x demo
[ "$what" = demo ] || inside ./x test
echo "fresh_machine: $what passed"
