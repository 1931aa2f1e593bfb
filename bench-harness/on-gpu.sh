#!/usr/bin/env bash
# Everything that needs a GPU, from a prebuilt program: no compiler, no network, ten minutes at most.
#
#   bench-harness/on-gpu.sh ESVO [FOLDER]
#
# ESVO is the program, built with its GPU engines (`cargo build --release -p esvo`); FOLDER, by default `results`, gets the records
# and `on-gpu.txt`, which says what was run and how it ended. Scenes are the real meshes where $ESVO_SCENES or ../shared/scenes has
# them, generated stand-ins otherwise. $SECONDS_IN_ALL, by default 570, is the time for all; what does not fit is left out and said.
# $SCENES, by default those of `esvo bench`, are the scenes of the paper's tables.
# Exit code 1 if anything failed or was left out.
set -uo pipefail

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    echo "usage: on-gpu.sh ESVO [FOLDER]" >&2
    exit 2
fi
esvo=$1
folder=${2:-results}
in_all=${SECONDS_IN_ALL:-570}
if ! version=$("$esvo" --version); then
    echo "error: $esvo: does not run; expected a release build of esvo for this system" >&2
    exit 2
fi
mkdir -p "$folder" || exit 2
summary=$folder/on-gpu.txt
failed=0

say() { printf '%s\n' "$*" | tee -a "$summary"; }

: >"$summary"
say "$version"
say "$(uname -sm), $(date -u +%Y-%m-%d)"

# Without a GPU engine there is nothing to measure: benchmarks list what they leave out, and would end well.
cache=$(mktemp -d)
trap 'rm -rf "$cache"' EXIT
engines=0
for engine in wgpu ash; do
    if why=$(timeout --kill-after=5 $((in_all < 60 ? in_all : 60)) "$esvo" bench needs --backends "$engine" --scenes sibenik --levels 3 --views 1 --rounds 1 --size 8x8 --out "$cache" 2>&1 >/dev/null); then
        engines=$((engines + 1))
    else
        say "$engine: $why"
        failed=1
    fi
done
if [ "$engines" -eq 0 ]; then
    say "no GPU engine can be opened. The loader is libvulkan.so.1 (Debian: libvulkan1); VK_DRIVER_FILES names the driver's file if it is in no usual place"
    exit 1
fi

# step NAME LIMIT COMMAND...: runs a command for at most LIMIT seconds, and no longer than there is time in all. Its output goes to
# FOLDER/NAME.txt. The shell's SECONDS are those since it started.
step() {
    local name=$1 limit=$2 left=$((in_all - SECONDS)) start=$SECONDS status
    shift 2
    if [ "$left" -lt 5 ]; then
        say "$name: left out, no time left"
        failed=1
        return
    fi
    [ "$limit" -le "$left" ] || limit=$left
    timeout --kill-after=5 "$limit" "$@" >"$folder/$name.txt" 2>&1 </dev/null
    status=$?
    case $status in
        0) say "$name: done in $((SECONDS - start)) s" ;;
        124 | 137) say "$name: stopped after $limit s" && failed=1 ;;
        *) say "$name: FAILED with exit code $status: $(tail -n 1 "$folder/$name.txt")" && failed=1 ;;
    esac
}

# Table 2 with triangles, after every answer was compared with the reference caster's.
step tables 330 "$esvo" bench ${SCENES:+--scenes "$SCENES"} --out "$folder" --time-limit $((in_all / 5))
# Hard rays, which a GPU may round otherwise: judged by derived bounds.
step stability 150 "$esvo" bench stability --backends wgpu,ash --rays 1M --gpu-rays 1M --out "$folder"
# What kernels save by leaving out what a scene does not need.
step needs 120 "$esvo" bench needs --backends wgpu,ash --scenes sibenik --views 2 --rounds 3 --out "$folder"
# Incoherent rays and shadow rays.
step rays 90 "$esvo" bench rays --seconds 20 --out "$folder"
# Error against run time.
step sweep 100 "$esvo" bench sweep --scenes sibenik --levels 7,8,9 --views 1 --rounds 3 --cache "$cache" --out "$folder"
# Which voxels each method finds, and how fast.
step voxelize 100 "$esvo" bench voxelize --scenes "${SCENES:-sibenik,conference}" --out "$folder"
# Rays through a bit volume: the processor's answers, and how fast; what it takes to send changes; a picture pass by pass.
step shadow 90 "$esvo" bench shadow --voxels 5 --rays 4 --converged 16 --size 160x120 --levels 10 --leak-rays 100000 --no-pictures --out "$folder"
# All of it on one page.
step page 30 "$esvo" bench page "$folder" -o "$folder/page.html"

exit $failed
