"""Background copy of finished files to a bucket: one thread that uploads new files and repeats failed uploads."""

import logging
import threading
from collections.abc import Callable, Iterable
from pathlib import Path

from bridge.bucket.bucket import Bucket, BucketError
from bridge.reasons.codes import Code

log = logging.getLogger(__name__)

#: interval of looking for finished files, s; longest wait for the last files at the end, s
LOOK_S, LAST_S = 60.0, 10.0


class Mirror:
    """Thread that copies finished files to one folder of a bucket and repeats failed copies. Starts when constructed.

    Objects in the bucket are never replaced. If an object and the local file of the same name differ in size, `fault`
    reports the difference.
    folder: folder of the bucket, within the ward's folder. files: returns the paths of the finished local files.
    name: returns the object name for a path; every path needs a different name.
    look_s: seconds between two searches for new files.
    """

    def __init__(
        self,
        bucket: Bucket,
        folder: str,
        files: Callable[[], Iterable[Path]],
        name: Callable[[Path], str] = lambda path: path.name,
        look_s: float = LOOK_S,
    ) -> None:
        #: why the latest copy failed; None when all finished files are in the bucket
        self.fault: BucketError | None = None
        self._bucket, self._folder, self._files, self._name, self._look_s = bucket, folder, files, name, look_s
        #: sizes of the objects, by name, as far as known
        self._there, self._stop = dict[str, int](), threading.Event()
        self._thread = threading.Thread(target=self._run, name="bucket", daemon=True)
        self._thread.start()

    def has(self, path: Path) -> bool:
        """Return True if the bucket is known to hold this file: an object with the file's name and its size in bytes.

        Raises OSError if the local file is missing.
        """
        return self._there.get(self._name(path)) == path.stat().st_size

    def close(self) -> None:
        """Copy the files that are finished now, then end the thread; waits at most LAST_S (10) seconds.

        Files not copied by then are copied after the next start of the program.
        """
        self._stop.set()
        self._thread.join(LAST_S)

    def _run(self) -> None:
        ended = False
        while not ended:
            ended, fault = self._stop.is_set(), self._copied()
            if (fault is None) != (self.fault is None):
                log.warning("%s", fault or f"bucket {self._bucket.name} has all copies again")
            self.fault = fault
            self._stop.wait(self._look_s)

    def _copied(self) -> BucketError | None:
        """Copy the files that the bucket does not have; returns why one is not there."""
        fault = None
        try:
            here = {path: f"{self._folder}/{self._name(path)}" for path in self._files()}
            if not all(map(self.has, here)):
                self._there = {name: size for _, name, size in self._bucket.copies(self._folder)}
            for path, place in here.items():
                if self._name(path) not in self._there:
                    log.info("copying %s (%.1f MB) to bucket %s", path, path.stat().st_size / 1e6, self._bucket.name)
                    self._bucket.upload(path, place)
                    self._there[self._name(path)] = path.stat().st_size
                elif not self.has(path):
                    fault = BucketError(Code.BUCKET_HAS_ANOTHER(bucket=self._bucket.name, file=place))
        except OSError as error:
            return error if isinstance(error, BucketError) else fault  # a file expired while it was looked at
        return fault
