#!/usr/bin/env bash
# Compiles esvo.ksy and lets the Python reader that is built on it read every test vector.
#
# Needs node, npm and python3. Packages go into the folder build/ beside this script; it can be deleted at any time.
set -euo pipefail
cd "$(dirname "$0")"
mkdir -p build/parser

# Without the packages there is nothing to run. That is no fault of the vectors, but CI must not pass over it.
missing() {
    echo "the second reader is left out: $1 cannot be installed here"
    [ "${CI:-}" != true ] && exit 0
    exit 1
}
if [ ! -d build/node_modules/kaitai-struct-compiler ] || [ ! -d build/node_modules/yaml ]; then
    npm install --prefix build --no-audit --no-fund --silent kaitai-struct-compiler@0.11.0 yaml@2 ||
        missing 'the npm package kaitai-struct-compiler'
fi
if ! build/venv/bin/python -c 'import kaitaistruct, zstandard' 2>/dev/null; then
    rm -rf build/venv
    python3 -m venv build/venv
    build/venv/bin/python -m pip install --quiet --disable-pip-version-check 'kaitaistruct==0.11' 'zstandard>=0.22,<1' ||
        missing 'the Python package kaitaistruct'
fi
export NODE_PATH="$PWD/build/node_modules"
node compile.js ../esvo.ksy build/parser python
PYTHONDONTWRITEBYTECODE=1 PYTHONPATH="build/parser" build/venv/bin/python check_vectors.py ../vectors
