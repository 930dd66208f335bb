# For scripts that take figures of documents again. They put each block into $out/NAME.block, and read this.

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
