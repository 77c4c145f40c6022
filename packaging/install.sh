#!/bin/sh
# Installs truerate from the files in this folder, without a network, into /opt/truerate (as root) or into --prefix DIR (without root).
set -eu
cd "$(dirname "$0")"
prefix=/opt/truerate
[ "${1:-}" = --prefix ] && prefix=$2
python=${PYTHON:-python3}
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || {
    echo "$python is $("$python" -V 2>&1), but this bundle needs Python 3.11. Set PYTHON=/path/to/python3.11" >&2
    exit 1
}
"$python" -c 'import ensurepip' 2>/dev/null || {
    echo "$python lacks the venv module; on Debian: apt install python3-venv" >&2
    exit 1
}
sha256sum --quiet -c SHA256SUMS
echo "installing into $prefix; this takes about a minute"
"$python" -m venv "$prefix"
"$prefix/bin/python" -m pip install --quiet --no-index --find-links wheels --require-hashes -r requirements.txt
"$prefix/bin/python" -m pip install --quiet --no-index --no-deps wheels/truerate-*.whl
"$prefix/bin/python" -m estimator.kernels
[ -w /usr/local/bin ] && [ "$prefix" = /opt/truerate ] && ln -sf "$prefix/bin/truerate" /usr/local/bin/truerate
"$prefix/bin/truerate" --version
echo "done. Next: $prefix/bin/truerate demo, or a ward: docs/install.md"
