#!/bin/sh
set -e
if [ "$1" = configure ]; then
    systemd-sysusers truerate.conf || adduser --system --group --quiet --home /var/lib/truerate --no-create-home truerate
    systemd-tmpfiles --create truerate.conf || install -d -o truerate -g truerate -m 0750 /var/lib/truerate
    # The numerical kernels are compiled here, so no service compiles them at its first start.
    (cd / && runuser -u truerate -- env NUMBA_CACHE_DIR=/var/cache/truerate /opt/truerate/bin/python3 -m estimator.kernels) || true
    if [ -d /run/systemd/system ]; then
        systemctl daemon-reload || true
        udevadm control --reload || true
        if [ -n "$2" ]; then systemctl try-restart 'truerate-*.service' || true; fi
    fi
    [ -e /etc/truerate/ward.toml ] || echo "truerate is installed. Next: sudo truerate init WARD (/usr/share/doc/truerate/install.md)."
fi
