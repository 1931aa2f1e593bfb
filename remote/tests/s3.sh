#!/usr/bin/env bash
# Runs the test of object stores against an emulator of S3 (moto, from PyPI, in a temporary environment). Says why it is skipped.
set -euo pipefail
cd "$(dirname "$0")/../.."

# With what `./test.sh` has compiled already.
run() {
    if cargo nextest --version >/dev/null 2>&1; then
        cargo nextest run --workspace --locked --features esvo/remote --run-ignored only --no-capture -E "package(esvo-remote) & binary(s3) & test(=$1)"
    else
        cargo test -q --locked -p esvo-remote --test s3 -- --ignored --exact "$1"
    fi
}
skip() { echo "skipped: $*"; exit 0; }

command -v python3 >/dev/null 2>&1 || skip "no python3 here"
folder=$(mktemp -d)
server=''
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true; rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" >/dev/null 2>&1 || skip "python3 has no venv (Debian: python3-venv)"
"$folder/venv/bin/pip" install -q --disable-pip-version-check 'moto[s3,server]==5.*' >/dev/null 2>&1 ||
    skip "moto, an emulator of S3, cannot be installed"

export AWS_ACCESS_KEY_ID=test AWS_SECRET_ACCESS_KEY=test AWS_REGION=us-east-1 AWS_DEFAULT_REGION=us-east-1 AWS_ALLOW_HTTP=true
export no_proxy=127.0.0.1 NO_PROXY=127.0.0.1
"$folder/venv/bin/moto_server" -H 127.0.0.1 -p 0 >"$folder/log" 2>&1 &
server=$!
port=''
for _ in $(seq 100); do
    port=$(sed -n 's|.*http://127.0.0.1:\([0-9]*\).*|\1|p' "$folder/log" | head -1)
    [ -n "$port" ] && break
    sleep 0.2
done
[ -n "$port" ] || { cat "$folder/log" >&2; skip "the emulator does not start"; }
export AWS_ENDPOINT="http://127.0.0.1:$port"

export ESVO_S3_BUCKET=octrees ESVO_S3_FILE="$folder/octree.esvo"
run write_the_file
cat > "$folder/put.py" <<'PY'
import os, sys, boto3
s3 = boto3.client("s3", endpoint_url=os.environ["AWS_ENDPOINT"])
if sys.argv[1] == "all":
    s3.create_bucket(Bucket=os.environ["ESVO_S3_BUCKET"])
    for name in ("octree.esvo", "replace.esvo"):
        s3.upload_file(os.environ["ESVO_S3_FILE"], os.environ["ESVO_S3_BUCKET"], name)
else:
    body = bytearray(open(os.environ["ESVO_S3_FILE"], "rb").read())
    body[-20] ^= 1
    s3.put_object(Bucket=os.environ["ESVO_S3_BUCKET"], Key="replace.esvo", Body=bytes(body))
PY
"$folder/venv/bin/python" "$folder/put.py" all
export ESVO_S3_REPLACE="$folder/venv/bin/python $folder/put.py replace"
run objects_are_read_by_ranges
