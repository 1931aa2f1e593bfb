#!/usr/bin/env bash
# Tests the Python package: installs it into a virtual environment of its own, reads every test vector, and reads what the
# package writes. Where ESVO_PROGRAM is the path of the program esvo, that checks the written files, too.
#
# Needs python3 with the modules venv and ensurepip (Debian: python3-venv), and pip must reach a package index. Where node
# and npm are, the reader is also compared with the parser that the Kaitai Struct compiler makes of esvo.ksy. All files go
# into a temporary folder, which is removed at the end.
set -euo pipefail
cd "$(dirname "$0")"

# Without the packages there is nothing to run. That is no fault of the reader, but CI must not pass over it.
missing() {
    echo "the tests of the Python reader are left out: $1"
    [ "${CI:-}" != true ] && exit 0
    exit 1
}
command -v python3 >/dev/null 2>&1 || missing "there is no python3"
python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))' 2>/dev/null ||
    missing "python3 is older than 3.9 or lacks the modules venv and ensurepip (Debian: python3-venv)"

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
export PYTHONDONTWRITEBYTECODE=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
python3 -m venv "$work/venv" || missing "python3 cannot make a virtual environment"
python="$work/venv/bin/python"
log="$work/pip.log"
"$python" -m pip install --quiet '.[test]' >"$log" 2>&1 || {
    cat "$log"
    missing "pip cannot install the package or what it needs"
}

# The Kaitai parser is one more check: the tests say what they skip without it.
kaitai() {
    command -v node >/dev/null 2>&1 && command -v npm >/dev/null 2>&1 || return 1
    "$python" -m pip install --quiet 'kaitaistruct==0.11' &&
        npm install --prefix "$work/node" --no-audit --no-fund --silent kaitai-struct-compiler@0.11.0 yaml@2 || return 1
}
if kaitai >"$log" 2>&1; then
    mkdir "$work/parser"
    NODE_PATH="$work/node/node_modules" node tests/compile.js ../esvo.ksy "$work/parser" python
    export ESVO_KAITAI="$work/parser"
else
    cat "$log"
fi
"$python" -m pytest -q -rs -p no:cacheprovider --basetemp "$work/pytest" tests
