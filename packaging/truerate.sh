#!/bin/sh
# If the user of the services runs this command, it uses the compiled kernels of the services.
[ -O /var/cache/truerate ] && export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-/var/cache/truerate}"
exec /opt/truerate/bin/truerate "$@"
