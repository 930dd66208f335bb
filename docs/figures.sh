#!/bin/sh
# Takes the figures of docs/networks.md and docs/comparison.md again, and some of docs/measurements.md, and
# writes them between the marks there.
#
#   docs/figures.sh               those of stated models: three minutes of one core, after the program is built
#   docs/figures.sh city.scene    and those of a walk through a scene, which is recorded first: half an hour more, and a Vulkan device
#   docs/figures.sh compare NAME.scene..   only those of docs/comparison.md that it has marks and images for,
#                                 with the flags in COMPARE: twenty minutes a scene with those of its page
#   docs/figures.sh error NAME.scene   only those of docs/comparison.md of speed against error: four minutes
#   docs/figures.sh sizes         those of tankers of 1 to 600 million triangles, and their figure: 15 minutes,
#                                 12 GB of memory, and the packages gnuplot and time
#
# Nothing in the first ones depends on the machine or on what else it does: the same program gives the same
# figures. A walk's ids are the same on any machine, too; when culling finds them is not. TRIMARAN names the
# program; without it, it is built.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
what=${1:-}
if [ "$what" = compare ] || [ "$what" = error ]; then
    shift
    scenes=$(realpath "$@")
else
    scene=${1:+$([ "$what" = sizes ] || realpath "$1")}
fi
cd "$here/.."
if [ -z "${TRIMARAN:-}" ]; then
    cargo build --release --bin trimaran
    TRIMARAN=${CARGO_TARGET_DIR:-target}/release/trimaran
fi
out=$(mktemp -d)
trap 'rm -r "$out"' EXIT
# place FILE: its marks get what was taken; a mark of what was not keeps what it has.
place() {
    awk -v out="$out" '
        /^<!-- figures: / {
            print
            name = out "/" $3 ".block"
            taken = (getline line < name) > 0
            if (taken) { do print line; while ((getline line < name) > 0); close(name) }
            next
        }
        /^<!-- end of figures -->/ { taken = 0 }
        !taken
    ' "$1" > "$out/page"
    cat "$out/page" > "$1"
}

# begin BLOCK: what follows is for the marks of that name.
begin() {
    block=$out/$1.block
    : > "$block"
    echo "$1" >&2
}

# says COMMAND..: the command of the figures that follow, broken before flags.
says() {
    {
        printf '```sh\n'
        echo "trimaran $*" | awk '{
            count = split($0, part, / --/); line = part[1]
            for (place = 2; place <= count; place++) {
                if (length(line part[place]) > 96) { print line " \\"; line = "   " }
                line = line " --" part[place]
            }
            print line
        }'
        printf '```\n'
    } >> "$block"
}

# quietly ARGS..: a run of the simulator; its figures lie in $out/runs.csv then.
quietly() {
    "$TRIMARAN" sim "$@" --out "$out" > /dev/null
}

# sim ARGS..: the same, and the block has its command.
sim() {
    says sim "$@"
    quietly "$@"
}

# Functions for every awk below: figures of three digits, columns by name.
lib='
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
    # COLUMN, COLUMN/COLUMN or late%.
    function value(name,   parts) {
        if (name == "late%") return sprintf("%.1f %%", 100 * $at["late_at_30"] / $at["frames"])
        if (split(name, parts, "/") == 2) return figure($at[parts[1]] / $at[parts[2]])
        return cell($at[name])
    }
    function columns(spec, names, titles,   count, list, place) {
        count = split(spec, list, " ")
        for (place = 1; place <= count; place++) {
            names[place] = titles[place] = list[place]
            sub(/=.*/, "", names[place]); sub(/^[^=]*=/, "", titles[place]); gsub(/_/, " ", titles[place])
        }
        return count
    }
    function add(title) { head = head " " title " |"; rule = rule "---|" }
    NR == 1 { for (place = 1; place <= NF; place++) at[$place] = place; next }
'

# table 'COLUMN=TITLE' ..: what the last run found, a row a run.
table() {
    awk -F, -v spec="$*" "$lib"'
        NR == 2 {
            count = columns(spec, name, title)
            head = "|"; rule = "|"
            for (place = 1; place <= count; place++) add(title[place])
            print head; print rule
        }
        {
            row = "|"
            for (place = 1; place <= count; place++) row = row " " value(name[place]) " |"
            print row
        }
    ' "$out/runs.csv" >> "$block"
}

# across COLUMN 'KEYS' 'VALUES' 'OTHERS': a row for each value of the keys, and in it a group of values for
# each value of COLUMN; the others are those of the first one.
across() {
    awk -F, -v over="$1" -v keys="$2" -v values="$3" -v others="${4:-}" "$lib"'
        NR == 2 { count = columns(keys, key, key_title); many = columns(values, name, title); more = columns(others, other, other_title) }
        {
            row = "|"
            for (place = 1; place <= count; place++) row = row " " value(key[place]) " |"
            group = $at[over]
            if (!(row in seen)) { seen[row] = 1; rows[++length_of_rows] = row }
            if (!(group in known)) { known[group] = 1; groups[++length_of_groups] = group }
            for (place = 1; place <= many; place++) held[row, group, place] = value(name[place])
            if (group == groups[1]) for (place = 1; place <= more; place++) rest[row, place] = value(other[place])
        }
        END {
            head = "|"; rule = "|"
            for (place = 1; place <= count; place++) add(key_title[place])
            for (place = 1; place <= many; place++) for (g = 1; g <= length_of_groups; g++) add(groups[g] title[place])
            for (place = 1; place <= more; place++) add(other_title[place])
            print head; print rule
            for (r = 1; r <= length_of_rows; r++) {
                row = rows[r]
                for (place = 1; place <= many; place++) for (g = 1; g <= length_of_groups; g++) row = row " " held[rows[r], groups[g], place] " |"
                for (place = 1; place <= more; place++) row = row " " rest[rows[r], place] " |"
                print row
            }
        }
    ' "$out/runs.csv" >> "$block"
}

# plain: a mean without its interval.
plain='{ gsub(/ \([^)]*\)/, "") } { gsub(/ *\| */, "|") }'

# by_size MILLIONS: a row of a tanker of so many million triangles, and its point in the figure.
by_size() {
    scene=$out/tanker.scene
    "$TRIMARAN" generate tanker --triangles "${1}000000" -o "$scene" > /dev/null
    first=$(command time -f '%e s|%M' "$TRIMARAN" run "$scene" --frames 1 --audit-every 0 --size 512x512 \
        --out "$out/walk" 2>&1 > /dev/null | tail -n 1)
    "$TRIMARAN" compare "$scene" --epsilon 2 --frames 40 --paths 5 --audit-every 20 --size 512x512 --curve --live \
        --no-coherence --systems independent-1,frustum --out "$out/compared" > /dev/null
    "$TRIMARAN" info --json "$scene" > "$out/info"
    awk -F'|' -v millions="$1" -v first="$first" -v bytes="$(stat -c %s "$scene")" \
        -v objects="$(sed -n 's/^ *"objects": *\([0-9]*\).*/\1/p' "$out/info" | sed ':a;s/\B[0-9]\{3\}\>/,&/;ta')" \
        -v points="$out/points" "$plain"'
        /^<!-- / { of = $0 }
        of ~ /speed/ && $2 ~ /^(independent-1|frustum)$/ { or[$2] = $3; hc[$2] = $4; rvg[$2] = $5; fps[$2] = $6 }
        of ~ /drawn/ && $2 ~ /^(independent-1|frustum)$/ { shown[$2] = $3; drawn[$2] = $6 }
        END {
            split(first, at, "|"); us = "independent-1"
            printf "| %s M | %s | %.0f MB | %s | %s | %s | %s | %s | %s | %s | %s | %s | %.0f MB |\n", millions, objects, \
                bytes / 1e6, drawn[us], shown[us], or[us], hc[us], rvg[us], fps[us], drawn["frustum"], fps["frustum"], \
                at[1], at[2] / 1024
            print millions, fps[us], fps["frustum"] >> points
        }' "$out/compared/tables.md" >> "$block"
}

if [ "$what" = sizes ]; then
    begin sizes
    echo "| triangles | objects | file | triangles drawn | objects drawn | OR ms | HC ms | RVG ms | MODEL frames/s \
| \`frustum\`: triangles | frames/s | first picture | memory |" >> "$block"
    echo "|---|---|---|---|---|---|---|---|---|---|---|---|---|" >> "$block"
    for millions in ${SIZES:-1 10 82 600}; do
        by_size "$millions"
    done
    gnuplot -e "set terminal svg size 640,360 font 'sans-serif,12'; set output 'docs/images/sizes.svg'; \
        set logscale x; set yrange [0:*]; set xlabel 'million triangles'; set ylabel 'frames a second'; set key center right; \
        plot '$out/points' using 1:2 with linespoints pt 7 lw 2 title 'independent-1', \
             '$out/points' using 1:3 with linespoints pt 6 lw 2 title 'frustum'"
    place docs/comparison.md
    exit
fi

if [ "$what" = compare ]; then
    for scene in $scenes; do
        name=$(basename "$scene" .scene)
        # shellcheck disable=SC2086 # words to be split
        "$TRIMARAN" compare "$scene" ${COMPARE:---epsilon 10 --frames 60 --audit-every 1 --size 512x512} \
            --out "$out/compared" > /dev/null
        for kind in speed drawn popping curve; do
            begin "$name-$kind"
            awk -v kind="$kind" '/^<!-- / { here = index($2, kind) == 1; next } here && NF' \
                "$out/compared/tables.md" >> "$block"
        done
        for figure in "$out"/compared/figures/*.svg; do
            image=docs/images/$name-$(basename "$figure")
            [ ! -e "$image" ] || cp "$figure" "$image"
        done
    done
    place docs/comparison.md
    exit
fi

if [ "$what" = error ]; then
    set -- --epsilon 10 --curve 0.5,2,10,20 --paths 3 --frames 40 --audit-every 1 --size 512x512 --live \
        --no-coherence
    "$TRIMARAN" compare "$scenes" "$@" --out "$out/compared" > /dev/null
    begin error
    says compare "$(basename "$scenes")" "$@"
    for figure in ms-flip ms-deviation ms-popping triangles-flip triangles-deviation triangles-popping; do
        cp "$out/compared/figures/$figure.svg" "docs/images/error-$figure.svg"
    done
    place docs/comparison.md
    exit
fi

latency='network=network link=link p50_ms=p50 p95_ms=p95 p99_ms=p99 p999_ms=p99.9 frames_per_second=frames/s late%=late incomplete=gaps bytes=bytes_a_frame'
parts='link=link batch=b bytes=all ids=ids messages=messages transport=transport transport_headers=tcp/udp ip_headers=IP link_layer=link_layer packets=packets'

begin lossy
sim --network wifi,wan-20ms,wan-80ms,lte --link tcp,quic,udp,udp-deadline --frames 2000 --seed 1,2,3,4,5
table $latency
begin satellite
sim --network satellite --link tcp,quic,udp,udp-deadline --udp-deadline-ms 50,400 --frames 2000 --seed 1,2,3,4,5
table $latency

begin cullers
sim --network wan-80ms --link tcp,udp --cullers 1,2,4,8 --frames 2000
table link=link p50_ms=p50 p95_ms=p95 p99_ms=p99 frames_per_second=frames/s bytes=bytes_a_frame

begin batches
sim --network fast-ethernet --link tcp,quic,udp --frames 300 --batch 1,10,30,100,300,1000,4000
across link batch=ids_a_batch 'p50_ms=_p50 bytes=_bytes'

begin formulas
sim --schedule switch --network gigabit --link tcp,quic,udp --frames 200 --nodes 100,1000,4000 --batch 1,10,100,1000
across link 'nodes=n batch=b' 'bytes=' 'corrected=corrected,_h_=_50 corrected_as_measured=corrected,_h_of_tcp paper=paper'
begin split
sim --schedule switch --network gigabit --link tcp,quic,udp --frames 200 --nodes 4000 --batch 10,100,1000
table $parts acknowledgements=acks
begin repeated
sim --network wifi --link tcp,quic,udp --udp-repair 15,0 --frames 1000 --nodes 4000 --batch 1000 --seed 1,2,3
table link=link bytes=all ids=ids messages=messages transport=transport transport_headers=tcp/udp ip_headers=IP link_layer=link_layer packets=packets repetitions=repeated

if [ -n "$scene" ]; then
    trace=$out/city.trace
    times='--or-ms 5 --hc-ms 5 --rvg-ms 5'
    seeds=1,2,3,4,5,6,7,8,9,10
    recording='--frames 120 --batch 16 --size 512x512'
    "$TRIMARAN" run "$scene" --record "$trace" $recording --audit-every 0 --out "$out/walk" > /dev/null

    begin walk
    says run city.scene --record city.trace $recording
    says sim --trace city.trace $times --network fast-ethernet --link tcp,quic,udp --batch 10,100,1000 --frames 1000
    quietly --trace "$trace" $times --network fast-ethernet --link tcp,quic,udp --batch 10,100,1000 --frames 1000
    table $parts corrected=corrected paper=paper
    begin coding
    says sim --trace city.trace $times --network fast-ethernet --link tcp,quic,udp --coding plain --frames 1000 "# and changes"
    for coding in plain changes; do
        quietly --trace "$trace" $times --network fast-ethernet --link tcp,quic,udp --coding $coding --frames 1000
        mv "$out/runs.csv" "$out/$coding.csv"
    done
    { cat "$out/plain.csv"; sed 1d "$out/changes.csv"; } > "$out/runs.csv"
    across coding link=link 'bytes=:_all ids=:_ids'

    begin wrong
    wrong="$times --network wifi --link tcp,quic,udp,udp-deadline --udp-deadline-ms 2,5,10,20 --frames 360 --seed $seeds"
    says run city.scene --record city.trace $recording
    says sim --trace city.trace --scene city.scene $wrong
    quietly --trace "$trace" --scene "$scene" $wrong
    table link=link p50_ms=p50 p99_ms=p99 p99_ms_deviation=± p999_ms=p99.9 incomplete=gaps bytes=bytes_a_frame
    echo >> "$block"
    table link=link frames_wrong=frames_wrong wrong_pixels=pixels_wrong wrong_pixels_deviation=± \
        worst_pixels=most_in_one needless_triangles=needless_triangles needless_triangles_deviation=±
fi

place docs/networks.md
