#!/bin/sh
# Takes the tables and figures of docs/comparison.md again: all systems on each scene.
#
#   docs/compare.sh NAME.scene..      a quarter of an hour a scene, on a machine that does nothing else
#
# A scene's name is that of its blocks in the document. FLAGS are those of `trimaran compare`; TRIMARAN names
# the program, and without it, it is built. The pages lie in out/compare/NAME/compare.html then.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
scenes=$(realpath "$@")
cd "$here/.."
if [ -z "${TRIMARAN:-}" ]; then
    cargo build --release --bin trimaran
    TRIMARAN=${CARGO_TARGET_DIR:-target}/release/trimaran
fi
out=$(mktemp -d)
trap 'rm -r "$out"' EXIT
. docs/place.sh
flags=${FLAGS:---frames 40 --audit-every 8 --curve 0.5,2,10,20 --live 20,60}

for scene in $scenes; do
    name=$(basename "$scene" .scene)
    page=out/compare/$name
    # shellcheck disable=SC2086 # words to be split
    "$TRIMARAN" compare "$scene" $flags --out "$page" > "$out/said"
    printf '```sh\ntrimaran compare %s.scene %s\n```\n' "$name" "$flags" > "$out/$name-command.block"
    # Each table begins with a comment that names it.
    awk -v out="$out/$name" '
        /^<!-- / { file = out "-" substr($2, 1, length($2) - 1) ".block"; next }
        NF { print > file }
    ' "$page/tables.md"
    mkdir -p "docs/images/compare/$name"
    cp "$page"/figures/*.svg "docs/images/compare/$name"
done
place docs/comparison.md
