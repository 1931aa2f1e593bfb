#!/usr/bin/env bash
# Whether `esvo bench compare` can be trusted on this machine, as it is: three times in a row, and three times while another process
# loads one core, two runs of the same program must pass, and a run whose engine is slowed by 10 % must fail.
#
#   bench-harness/compare-for-real.sh ESVO [MATRIX] > results/<machine>/compare.md
#
# ESVO is a release build; MATRIX is matrices/guard.toml by default. $TIMES, by default 3, is how often. Prints Markdown. Exit code 1 if a
# verdict was not the expected one.
set -uo pipefail

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    echo "usage: compare-for-real.sh ESVO [MATRIX]" >&2
    exit 2
fi
esvo=$1
matrix=${2:-$(dirname "$0")/matrices/guard.toml}
times=${TIMES:-3}
if ! version=$("$esvo" --version); then
    echo "error: $esvo: does not run; expected a release build of esvo for this system" >&2
    exit 2
fi
work=$(mktemp -d) || exit 2
load=''
end() {
    [ -z "$load" ] || kill "$load" 2>/dev/null
    rm -rf "$work"
}
trap end EXIT
wrong=0

# What else takes time: load average, and the programs that use more than a tenth of a core, without this script's own.
others() {
    local names
    names=$(top -b -n 2 -d 1 2>/dev/null | awk '/^ *PID/ { n++; next } n == 2 && $9 > 10 { print $12 }' |
        grep -Ev '^(top|esvo.*)$' | sort | uniq -c | awk '{ printf "%s%s %s", sep, $1, $2; sep = ", " }')
    printf '%s; %s' "$(cut -d' ' -f1 /proc/loadavg)" "${names:-nothing}"
}

# measure NAME OPTIONS...: a run; its record is $work/NAME.json.
measure() {
    local name=$1
    shift
    "$esvo" bench --matrix "$matrix" --out "$work/$name" "$@" >"$work/$name.txt" 2>&1 </dev/null || {
        echo "error: $esvo bench: $(tail -n 1 "$work/$name.txt")" >&2
        exit 2
    }
    cp "$work/$name"/*/*/report.json "$work/$name.json"
}

# judge WHAT EXPECTED AFTER: compares with the first run and prints a row.
judge() {
    local status verdict expected
    "$esvo" bench compare "$work/first.json" "$work/$3.json" --all >"$work/compare.txt" 2>/dev/null
    status=$?
    [ $status -eq 0 ] && verdict=passes || verdict=fails
    [ "$2" -eq 0 ] && expected=passes || expected=fails
    [ $status -eq "$2" ] || { wrong=1 && verdict="**$verdict**, expected: $expected"; }
    local ratios machine
    ratios=$("$esvo" bench compare "$work/first.json" "$work/$3.json" --json 2>/dev/null | awk -F'[:,]' '
        /"ratio":/ { r = $2 + 0; if (!n || r < low) low = r; if (r > high) high = r; n++ }
        END { printf "%.3f to %.3f", low, high }')
    machine=$("$esvo" bench compare "$work/first.json" "$work/$3.json" --json 2>/dev/null | awk -F'[:,]' '
        /"machine":/ && $2 + 0 > 0 { s += $2; n++ } END { if (n) printf "%.3f", s / n; else printf "-" }')
    echo "| $round | $1 | $verdict | $ratios | $machine | $before |"
    if [ "$verdict" != passes ] && [ "$verdict" != fails ]; then
        cp "$work/compare.txt" "$work/unexpected-$condition-$round-$3.txt"
    fi
}

echo "# esvo bench compare, for real"
echo
echo "\`bench-harness/compare-for-real.sh\`, $(basename "$matrix"), $(echo "$version" | head -n 2 | paste -sd ' ' | tr -s ' ')"
echo "on $(uname -sm), $(nproc) threads, $(date -u +%Y-%m-%d). Each row compares a run with the first of its three. \"slowed\" has \`--slow cpu=10\`."
echo "Ratios are those of all cells; \"machine\" is how much longer the calibration casts took. The last column has the load average and the"
echo "programs that used more than a tenth of a core just before the run."
for condition in quiet loaded; do
    echo
    if [ $condition = quiet ]; then
        echo "## Nothing started by the script"
    else
        echo "## While \`yes\` loads one core"
        yes >/dev/null &
        load=$!
    fi
    echo
    echo "| | second run | verdict | ratios | machine | what else ran |"
    echo "|--:|:--|:--|--:|--:|:--|"
    for round in $(seq "$times"); do
        measure first
        before=$(others)
        measure again
        judge "the same program" 0 again
        before=$(others)
        measure slowed --slow cpu=10
        judge "slowed by 10 %" 1 slowed
        rm -r "$work/first" "$work/again" "$work/slowed"
    done
done
for file in "$work"/unexpected-*.txt; do
    [ -e "$file" ] || continue
    printf '\n```\n%s\n```\n' "$(sed "s|$work/||g" "$file")"
done
exit $wrong
