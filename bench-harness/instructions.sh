#!/usr/bin/env bash
# Instructions of each piece of reading, writing and casting octrees, which other programs on the machine do not change: counted by
# valgrind, as the difference between doing the piece twice and four times. Prints a table in Markdown.
#
#   bench-harness/instructions.sh
#
# Needs valgrind (Debian: valgrind), which knows AVX2 but not AVX-512.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v valgrind >/dev/null 2>&1; then
    echo "error: no valgrind here: install it (Debian: valgrind)" >&2
    exit 1
fi
cargo build --quiet --release --locked -p esvo-cpu --example pieces
pieces=${CARGO_TARGET_DIR:-target}/release/examples/pieces
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# Instructions of the whole program when it does a piece so many times.
count() {
    valgrind --tool=callgrind --callgrind-out-file="$folder/out" "$pieces" "$1" "$2" >/dev/null 2>"$folder/log" ||
        { cat "$folder/log" >&2; return 1; }
    awk '/^(summary|totals):/ { print $2; exit }' "$folder/out"
}

list=$("$pieces")
echo "| piece | unit | instructions per unit |"
echo "|:--|:--|--:|"
while IFS=$'\t' read -r number units name unit; do
    twice=$(count "$number" 2)
    four=$(count "$number" 4)
    awk -v n="$name" -v u="$unit" -v d=$((four - twice)) -v units="$units" 'BEGIN { printf "| %s | %s | %.1f |\n", n, u, d / (2 * units) }'
done <<<"$list"
