"""Care of the store, once a second: failures are counted, the epoch is stored, backups and thinning are started."""

import logging
from collections import Counter
from collections.abc import Callable

from bridge.wire.refusal import Tally
from estimator.database import StoreError
from estimator.service.store import Store
from estimator.service.store_writer import StoreWriter

log = logging.getLogger(__name__)

#: interval of thinning a device's past, and of checking whether a backup is due, s
THIN_S, BACKUP_S = 86400.0, 3600.0


class StoreCare:
    """Regular work on a store: count failures, store the epoch, start backups and thinning.

    now_ns: the host's clock. clerk: the store's thread. highest(): the highest known epoch. write: queues a write.
    """

    def __init__(
        self,
        store: Store,
        counts: Tally,
        now_ns: Callable[[], int],
        clerk: StoreWriter,
        highest: Callable[[], int],
        write: Callable[[Callable[[], None]], None],
    ) -> None:
        self._store, self._counts, self._now_ns, self._clerk = store, counts, now_ns, clerk
        self._highest, self._write = highest, write
        self._counted = Counter[str]()  # how many of the store's own counts are in `counts` already
        self._epoch = 0  # the highest epoch stored
        self._next_backup = self._next_thin = float("-inf")
        self._to_thin: list[str] = []
        self._thinned = Counter[str]()  # rows deleted of the devices thinned since the last log line
        self._looked = True

    def stored_epoch(self) -> int:
        """Read the highest ownership epoch stored before this estimator started; 0 if none."""
        self._epoch = self._store.epoch()
        return self._epoch

    def tend(self, now: float) -> None:
        """Do or start the regular work whose time has come at `now`, monotonic s; call it once a second.

        Backups are due every BACKUP_S, thinning of old rows every THIN_S.
        """
        database = self._store.database
        for what, n in (("store failed", database.failures), ("damage in the store", len(database.notes))):
            if n > self._counted[what]:
                self._counts.add(what, n - self._counted[what])
                self._counted[what] = n
        if self._looked:  # the previous look has finished
            self._looked = False
            self._clerk.look_up(database.look, self._has_looked)
        epoch = self._highest()
        if epoch != self._epoch or (database.trouble and self._clerk.idle):  # only a write shows recovery
            self._epoch = epoch
            self._write(lambda: self._store.save_epoch(epoch))
        if now >= self._next_backup:
            self._next_backup = now + BACKUP_S
            self._clerk.look_up(database.back_up_if_due)
        if now >= self._next_thin:
            self._next_thin = now + THIN_S
            self._clerk.look_up(lambda: self._to_thin.extend(self._store.devices()))
        if self._to_thin:
            device, now_ns = self._to_thin.pop(), self._now_ns()
            self._write(lambda: self._thinned.update(self._store.thin(device, now_ns)))
        elif self._thinned and self._clerk.idle:
            rows = ", ".join(f"{table} {n}" for table, n in sorted(self._thinned.items()))
            log.info("old entries of the store were deleted: %s", rows)
            self._thinned.clear()

    def _has_looked(self, _: StoreError | None) -> None:
        self._looked = True
