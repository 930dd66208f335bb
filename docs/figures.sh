#!/bin/sh
# Takes the figures of docs/networks.md and docs/bandwidth.md again and prints their tables as Markdown.
#
#   docs/figures.sh                          those of stated models
#   docs/figures.sh walk.trace walk.scene    and those of a walk, recorded with `trimaran run walk.scene --record walk.trace`
#
# Nothing in them depends on the machine or on what else it does: the same program gives the same figures. TRIMARAN names the
# program, ./target/release/trimaran if it is not set.
set -eu
cd "$(dirname "$0")/.."
program=${TRIMARAN:-target/release/trimaran}
out=$(mktemp -d)
trap 'rm -r "$out"' EXIT

# sim ARGS..: a run of the simulator; its figures lie in $out/runs.csv then.
sim() {
    echo
    printf '```sh\ntrimaran sim'; printf ' %s' "$@"; printf '\n```\n'
    "$program" sim "$@" --out "$out" > /dev/null
}

# table 'COLUMN=TITLE' ..: what the last run found, a row a run. COLUMN is one of runs.csv, or COLUMN/COLUMN, or late%.
table() {
    awk -F, -v spec="$*" '
        function cell(text) { return text ~ /^-?[0-9.]+(e-?[0-9]+)?$/ ? figure(text + 0) : text }
        # Integers with commas, others with three digits that count.
        function figure(value,   text) {
            if (value >= 1000) {
                text = sprintf("%d", value + 0.5)
                while (match(text, /[0-9][0-9][0-9][0-9](,|$)/)) {
                    text = substr(text, 1, RSTART) "," substr(text, RSTART + 1)
                }
                return text
            }
            if (value == int(value)) return value ""
            return sprintf(value >= 100 ? "%.0f" : value >= 10 ? "%.1f" : value >= 1 ? "%.2f" : "%.3f", value)
        }
        function value(name,   parts) {
            if (name == "late%") return sprintf("%.1f %%", 100 * $at["late_at_30"] / $at["frames"])
            if (split(name, parts, "/") == 2) return figure($at[parts[1]] / $at[parts[2]])
            return cell($at[name])
        }
        NR == 1 {
            for (place = 1; place <= NF; place++) at[$place] = place
            columns = split(spec, column, " ")
            head = "|"; rule = "|"
            for (place = 1; place <= columns; place++) {
                split(column[place], pair, "=")
                name[place] = pair[1]; title = pair[2]; gsub(/_/, " ", title)
                head = head " " title " |"; rule = rule "---|"
            }
            print ""; print head; print rule
            next
        }
        {
            row = "|"
            for (place = 1; place <= columns; place++) row = row " " value(name[place]) " |"
            print row
        }
    ' "$out/runs.csv"
}

latency='network=network link=link p50_ms=p50 p95_ms=p95 p99_ms=p99 p999_ms=p99.9 frames_per_second=frames/s late%=late incomplete=gaps bytes=bytes_a_frame'
bytes='link=link nodes=n batch=b bytes=all ids=ids messages=messages transport=transport transport_headers=tcp/udp ip_headers=ip link_layer=link_layer packets=packets acknowledgements=acks corrected=added corrected_as_measured=added,_h_as_is paper=paper'

echo "## Which transport for which network"
sim --network fast-ethernet,gigabit,10g --link tcp,quic,udp --frames 2000
table $latency
sim --network wifi,wan-20ms,wan-80ms,lte,satellite --link tcp,quic,udp,udp-deadline --frames 2000 --seed 1,2,3,4,5
table $latency

echo; echo "## Batches"
sim --network fast-ethernet --link tcp,quic,udp --frames 300 --batch 1,10,30,100,300,1000,4000
table link=link batch=b network_ms=network waiting_ms=waiting p50_ms=latency_p50 p99_ms=p99 bytes=bytes_a_frame

echo; echo "## Bandwidth"
sim --network gigabit --link tcp,quic,udp --frames 200 --nodes 100,1000,4000 --batch 1,10,100,1000
table $bytes
sim --network wifi --link tcp,quic,udp --frames 1000 --nodes 4000 --batch 1000 --seed 1,2,3
table $bytes repetitions=repeated
sim --network gigabit --link tcp,quic,udp --frames 200 --nodes 4000 --batch 1000
table link=link handshake=handshake,_once keepalive=keepalive packets=packets header=h

[ $# -eq 2 ] || exit 0
# Of the walk only its ids and when they were found: the machine that recorded it may have no GPU.
times="--or-ms 5 --hc-ms 5 --rvg-ms 5"
echo; echo "## A walk"
sim --trace "$1" $times --network fast-ethernet,wifi --link tcp,quic,udp --batch 10,100,1000 --frames 1000
table network=network $bytes
sim --trace "$1" $times --network fast-ethernet --link tcp,quic,udp --coding plain --frames 1000
table $bytes
sim --trace "$1" $times --network fast-ethernet --link tcp,quic,udp --coding changes --frames 1000
table $bytes

echo; echo "## Late or wrong"
sim --trace "$1" --scene "$2" $times --network wifi --link tcp,quic,udp,udp-deadline --udp-deadline-ms 2,5,10 --frames 360
table link=link p50_ms=p50 p99_ms=p99 p999_ms=p99.9 incomplete=gaps frames_wrong=frames_wrong \
    wrong_pixels=wrong_pixels_a_frame worst_pixels=worst needless_triangles=needless_triangles_a_frame bytes=bytes_a_frame
