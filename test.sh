#!/usr/bin/env bash
# Runs every check of the repository. Installs what the tests need where it can, says what is missing where it cannot.
#
#   ./test.sh          everything that a change must pass
#   ./test.sh quick    format, clippy and tests only
set -euo pipefail
cd "$(dirname "$0")"

case "${1:-all}" in
    all | quick) mode=${1:-all} ;;
    *) echo "usage: ./test.sh [quick]" >&2; exit 2 ;;
esac

step() { printf '\n== %s\n' "$*"; }

# A Vulkan device answers if there is a loader and a driver that it finds; vulkaninfo, where it exists, knows for certain.
vulkan() {
    if command -v vulkaninfo >/dev/null 2>&1; then
        vulkaninfo --summary 2>/dev/null | grep -q 'deviceName'
        return
    fi
    local loader='' driver folder
    if command -v ldconfig >/dev/null 2>&1 || [ -x /sbin/ldconfig ]; then
        PATH="$PATH:/sbin" ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' && loader=1
    fi
    [ -n "$loader" ] || return 1
    local named="${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}"
    if [ -n "$named" ]; then
        local -a files
        IFS=: read -r -a files <<<"$named"
        for driver in "${files[@]}"; do
            [ -e "$driver" ] && return 0
        done
        return 1
    fi
    for folder in /usr/share/vulkan/icd.d /usr/local/share/vulkan/icd.d /etc/vulkan/icd.d "${XDG_DATA_HOME:-$HOME/.local/share}/vulkan/icd.d"; do
        for driver in "$folder"/*.json; do
            [ -e "$driver" ] && return 0
        done
    done
    return 1
}

step "Vulkan device"
if ! vulkan && command -v apt-get >/dev/null 2>&1; then
    root=''
    if [ "$(id -u)" -ne 0 ]; then
        root='sudo -n'
        $root true 2>/dev/null || root='no'
    fi
    if [ "$root" != no ]; then
        echo "no Vulkan device: installing Debian's mesa-vulkan-drivers (a driver that runs on the processor) and the validation layer"
        { $root apt-get update -qq &&
            DEBIAN_FRONTEND=noninteractive $root apt-get install -y -qq --no-install-recommends mesa-vulkan-drivers libvulkan1 vulkan-validationlayers; } ||
            echo "that did not work"
    fi
fi
if vulkan; then
    echo "there is one: the GPU tests must pass"
    export ESVO_REQUIRE_GPU=1
else
    echo "none: the GPU tests are skipped. To run them, install a Vulkan driver (Debian: mesa-vulkan-drivers and libvulkan1)"
fi

step "Chromium"
if command -v chromium >/dev/null 2>&1 || command -v chromium-browser >/dev/null 2>&1 || command -v google-chrome >/dev/null 2>&1; then
    echo "there is one: the tests of the page in a browser must pass"
    export ESVO_REQUIRE_CHROMIUM=1
else
    echo "none: the tests of the page in a browser are skipped. To run them, install Debian's chromium"
fi

# Files for incremental builds take time to write, and a build from nothing that is not built upon has no use for them.
if [ ! -d "${CARGO_TARGET_DIR:-target}/debug" ]; then
    export CARGO_INCREMENTAL=0
fi

step "format"
cargo fmt --all --check

step "clippy"
# The crates of `remote` are compiled anyway, as it is a member; the program without it is checked below, feature by feature.
features='esvo/remote'
cargo clippy --workspace --all-targets --locked --features "$features" -- -D warnings

step "tests"
if cargo nextest --version >/dev/null 2>&1; then
    cargo nextest run --workspace --locked --features "$features"
else
    cargo test --workspace --all-targets --locked --features "$features"
fi

if [ "$mode" = quick ]; then
    step "quick checks passed"
    exit 0
fi

step "documentation tests"
cargo test --workspace --doc --locked

step "documentation"
RUSTDOCFLAGS='-D warnings' cargo doc --workspace --no-deps --locked

step "each feature alone"
cargo check -q --locked -p esvo
cargo check -q --locked -p esvo --no-default-features
cargo check -q --locked -p esvo --no-default-features --features wgpu
cargo check -q --locked -p esvo --no-default-features --features ash
cargo check -q --locked -p esvo-format --no-default-features
cargo check -q --locked -p esvo-core --no-default-features --all-targets

step "object stores"
bash remote/tests/s3.sh

step "Embree"
# The feature is for comparison only; it links a library that is no package of Rust.
if echo 'int main(void) { return 0; }' | cc -x c - -o /dev/null -lembree3 >/dev/null 2>&1; then
    cargo clippy -q --locked -p esvo-cpu --features embree --all-targets -- -D warnings
    cargo test -q --locked -p esvo-cpu --features embree --lib embree_sys
    cargo test -q --locked -p esvo-cpu --features embree --test embree
else
    echo "skipped: no Embree 3 here (Debian: libembree-dev)"
fi

step "other compilers and processors"
# The oldest compiler that Cargo.toml promises, and a processor without AVX, where they are installed.
oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
if command -v rustup >/dev/null 2>&1 && rustup toolchain list | grep -q "^$oldest"; then
    cargo "+$oldest" check -q --locked --workspace --target-dir target/oldest
else
    echo "skipped: no Rust $oldest here (rustup toolchain install $oldest)"
fi
if command -v rustup >/dev/null 2>&1 && rustup target list --installed | grep -q aarch64-unknown-linux-gnu; then
    # Checking links nothing, so that a compiler that does nothing serves where there is none for the C code of zstd.
    if ! command -v aarch64-linux-gnu-gcc >/dev/null 2>&1; then
        export CC_aarch64_unknown_linux_gnu=true AR_aarch64_unknown_linux_gnu=true
    fi
    cargo check -q --locked --target aarch64-unknown-linux-gnu -p esvo-cpu -p esvo-format --no-default-features
else
    echo "skipped: no target aarch64-unknown-linux-gnu here (rustup target add aarch64-unknown-linux-gnu)"
fi

step "second reader, in Python, on every test vector, and its writer"
if command -v python3 >/dev/null 2>&1; then
    # The tests above have made the program: it checks what the package in Python writes.
    program="${CARGO_TARGET_DIR:-target}/debug/esvo"
    [ ! -x "$program" ] || ESVO_PROGRAM=$(realpath "$program")
    ESVO_PROGRAM="${ESVO_PROGRAM:-}" bash spec/v1/python/check.sh
else
    echo "skipped: no python3 here"
fi

step "viewer and reader in JavaScript: types, every test vector, streaming, the page in Chromium"
if ! command -v npm >/dev/null 2>&1 || ! node -e 'process.exit(Number(process.versions.node.split(".")[0]) < 20)' 2>/dev/null; then
    echo "skipped: no node 20 with npm here (Debian: nodejs, npm)"
elif ! (cd backends/web && npm ci --silent --no-audit --no-fund); then
    echo "skipped: the packages for the checks cannot be fetched here"
else
    (cd backends/web && npm run --silent check)
    program="${CARGO_TARGET_DIR:-target}/debug/esvo"
    [ ! -x "$program" ] || program=$(realpath "$program")
    (cd backends/web && ESVO_PROGRAM="$program" npm run --silent test:page)
fi

step "packages"
# Checks every crate as it would be published: unpacked, with nothing around it but the other packages. The versions and profiles are
# those of the workspace, so that what was compiled of the dependencies before serves again.
packages="${CARGO_TARGET_DIR:-target}/packages"
rm -rf "$packages"
cargo package -q --workspace --locked --allow-dirty --no-verify --exclude esvo-examples --target-dir "$packages"
mkdir "$packages/unpacked"
for crate in "$packages"/package/*.crate; do
    tar -xzf "$crate" -C "$packages/unpacked"
done
{
    printf '[workspace]\nresolver = "3"\nmembers = ["*"]\n\n[patch.crates-io]\n'
    for folder in "$packages"/unpacked/*/; do
        folder=$(basename "$folder")
        printf '%s = { path = "%s" }\n' "${folder%-*}" "$folder"
    done
    printf '\n'
    sed -n '/^\[profile/,$p' Cargo.toml
} > "$packages/Cargo.toml"
mv "$packages/Cargo.toml" "$packages/unpacked/Cargo.toml"
cp Cargo.lock "$packages/unpacked/Cargo.lock"
cargo check -q --manifest-path "$packages/unpacked/Cargo.toml" --workspace --target-dir "${CARGO_TARGET_DIR:-target}"

step "licences and advisories of the dependencies"
if cargo deny --version >/dev/null 2>&1; then
    cargo deny --locked --log-level error check licenses bans sources
    # The advisory database is fetched from the network. Without it nothing is known, which is not a failure.
    if ! cargo deny --locked fetch db >/dev/null 2>&1; then
        echo "skipped: the advisory database cannot be fetched here"
    else
        cargo deny --locked --offline check advisories
    fi
else
    echo "skipped: no cargo-deny here (cargo install --locked cargo-deny)"
fi

step "fuzzing, ten seconds each target"
if cargo +nightly --version >/dev/null 2>&1 && cargo fuzz --version >/dev/null 2>&1; then
    fuzz/run.sh "${ESVO_FUZZ_SECONDS:-10}"
else
    echo "skipped: no nightly compiler or no cargo-fuzz. The tests above ran the committed inputs through every target."
    echo "To fuzz: rustup toolchain install nightly && cargo install cargo-fuzz"
fi

step "all passed"
