#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --now truerate.target truerate-backup.timer 'truerate-*.service' || true
fi
find /opt/truerate -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true
