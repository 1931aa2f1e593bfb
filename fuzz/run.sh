#!/usr/bin/env bash
# Fuzzes every target for SECONDS (default 60), starting from the test vectors and the seeds: ./run.sh [SECONDS] [TARGET...]
#
# Needs a nightly compiler and cargo-fuzz (cargo install cargo-fuzz). Stops with exit code 1 at the first failure and leaves
# the input in artifacts/. After the fix, add the input to seeds/TARGET: the tests run all seeds with the stable compiler.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-60}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(open sealed values oct split)
for target in "${targets[@]}"; do
    mkdir -p "corpus/$target"
    case $target in
        oct | values) seeds=("seeds/$target") ;;
        *) seeds=("seeds/$target" ../spec/v1/vectors/valid ../spec/v1/vectors/invalid) ;;
    esac
    length=40000
    [ "$target" = values ] && length=80
    cargo +nightly fuzz run "$target" "corpus/$target" "${seeds[@]}" -- \
        -max_total_time="$seconds" -max_len="$length" -len_control=0 -timeout=10 -rss_limit_mb=1024 -print_final_stats=1
done
