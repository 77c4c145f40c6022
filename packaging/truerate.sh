#!/bin/sh
# The user of the services finds their compiled kernels, also when a person types the command.
[ -O /var/cache/truerate ] && export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-/var/cache/truerate}"
exec /opt/truerate/bin/truerate "$@"
