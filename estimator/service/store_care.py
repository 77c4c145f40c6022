"""Maintenance of the store, once a second: stores the epoch, starts backups and the deletion of old rows."""

import logging
from collections import Counter
from collections.abc import Callable

from estimator.database import StoreError
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter

log = logging.getLogger(__name__)

#: interval of thinning a device's past, and of checking whether a backup is due, s
THIN_S, BACKUP_S = 86400.0, 3600.0


class StoreCare:
    """Regular maintenance of a store: stores the epoch, starts backups and the deletion of old rows.

    now_ns: the host's clock, ns since the Unix epoch. clerk: the store's thread.
    """

    def __init__(self, store: Store, now_ns: Callable[[], int], clerk: StoreWriter) -> None:
        self._store, self._now_ns, self._clerk = store, now_ns, clerk
        self._epoch = store.epoch()  # the highest epoch stored
        self._next_backup = self._next_thin = float("-inf")
        self._to_thin: list[str] = []
        self._thinned = Counter[str]()  # rows deleted of the devices thinned since the last log line
        self._looks = False

    def tend(self, now: float, epoch: int) -> None:
        """Start the maintenance that is due; call it once a second.

        now: monotonic time, s. epoch: highest known epoch (ownership number, which rises with each takeover).
        Whether a backup is due is checked every BACKUP_S seconds. Old rows are deleted every THIN_S seconds.
        """
        database = self._store.database
        if not self._looks:  # a disk that hangs is looked at once
            self._looks = True
            self._clerk.look_up(self._look)
        if epoch != self._epoch or (database.trouble and self._clerk.idle):  # only a write shows recovery
            self._epoch = epoch
            self._clerk.do(lambda: self._store.save_epoch(epoch), self._stored)
        if now >= self._next_backup:
            self._next_backup = now + BACKUP_S
            self._clerk.look_up(database.back_up_if_due)
        if now >= self._next_thin:
            self._next_thin = now + THIN_S
            self._clerk.look_up(self._store.devices, self._to_thin.extend)
        if self._to_thin:
            device, now_ns = self._to_thin.pop(), self._now_ns()
            self._clerk.do(lambda: self._thinned.update(self._store.thin(device, now_ns)))
        elif self._thinned and self._clerk.idle:
            rows = ", ".join(f"{table} {n}" for table, n in sorted(self._thinned.items()))
            log.info("old entries of the store were deleted: %s", rows)
            self._thinned.clear()

    def _stored(self, error: StoreError | None) -> None:
        if error is not None:
            self._epoch = -1  # to be written again in a second

    def _look(self) -> None:
        try:
            self._store.database.look()
        finally:
            self._looks = False
