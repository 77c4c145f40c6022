#!/bin/sh
set -e
if [ -d /run/systemd/system ]; then systemctl daemon-reload || true; fi
if [ "$1" = purge ]; then
    # Recordings and the store contain patients' data: only an administrator deletes them.
    rm -rf /var/cache/truerate
    echo "kept: /etc/truerate (ward, certificates) and /var/lib/truerate (store, recordings, backups)"
fi
