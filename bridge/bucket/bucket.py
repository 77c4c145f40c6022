"""S3 client: lists, uploads and downloads objects in a ward's folder of a bucket of S3-compatible storage.

Access keys come from the environment or from a separate file, never from the ward file.
"""

import configparser
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path

from msgspec import Struct

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence
from bridge.toml.loader import ConfigError

#: keys, as variables of the environment, or in lower case in a `credentials_file`
KEYS = "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"
#: RETRY: time for which a request is repeated before it fails. REQUEST: longest time of one request, of at most 5 MB
RETRY, REQUEST = timedelta(seconds=30), timedelta(minutes=2)
#: causes within obstore's errors: the storage's answer (XML), a certificate that is not trusted, or the system's words
_CAUSE = re.compile(r'(?s).*?(?:<Code>(\w+)</Code>|InvalidCertificate\(\s*(\w+)|(?:message|error): "([^"]+)")|([^\n]*)')


class S3(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [s3] of the ward file: a bucket of S3-compatible storage to which finished backups and recordings are copied.

    truerate deletes nothing in the bucket. Raises ValueError for an endpoint that is neither HTTPS nor on this machine.
    """

    #: address of the storage, for example `https://s3.hospital.example`
    endpoint: str
    #: name of the bucket, or of a folder in it: `ward-3` or `backups/ward-3`
    bucket: str
    #: file with the keys, as `aws configure` writes it, mode 0600; default: AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY
    credentials_file: str = ""
    #: copy the backups of the estimator's store
    backups: bool = True
    #: copy finished recordings
    recordings: bool = True

    def __post_init__(self) -> None:
        if not re.fullmatch(r"https://[^/]+/?|http://127\.0\.0\.1(:\d+)?/?", self.endpoint):
            raise ValueError(
                f"endpoint is {self.endpoint!r}: use https://HOST, or http://127.0.0.1:PORT on this machine"
            )

    def keys(self) -> list[str]:
        """Return [access key, secret key] of the storage.

        The keys come from `credentials_file`. A key that the file lacks comes from the environment variable
        AWS_ACCESS_KEY_ID or AWS_SECRET_ACCESS_KEY.
        Raises ConfigError if a key is missing or the file is unreadable, or if other users can read or change the file.
        """
        file, told = self.credentials_file, configparser.ConfigParser(interpolation=None)
        try:
            if file and Path(file).stat().st_mode & 0o026:
                raise ConfigError(f"[s3] credentials_file {file}: other users can read or change it: chmod 600 {file}")
            told.read_string(Path(file).read_text("utf-8") if file else "[default]")
            return [told["default"].get(key) or os.environ[key] for key in KEYS]
        except (OSError, KeyError, configparser.Error, UnicodeDecodeError) as error:
            where = f"credentials_file {file}" if file else "the environment"
            raise ConfigError(f"[s3]: {' and '.join(KEYS)} not found in {where} ({error}): add both") from None


class BucketError(OSError):
    """Error of a failed request to a bucket.

    sentence: the reason as a code with parameters, which can be shown in any supported language.
    """

    def __init__(self, sentence: Sentence) -> None:
        super().__init__(english(sentence))
        self.sentence = sentence


class Bucket:
    """Client for a ward's folder in a bucket of S3-compatible storage: lists, uploads and downloads objects.

    settings: the table [s3] of the ward file. ward: id of the ward, which is the name of the folder. Object names are
    relative to the ward's folder. Methods raise BucketError if a request fails. The constructor raises ConfigError if
    the package obstore or the access keys are missing.
    """

    def __init__(self, settings: S3, ward: str) -> None:
        self.name, (access, secret) = settings.bucket, settings.keys()
        try:
            from obstore import exceptions, store  # noqa: PLC0415 - optional
        except ImportError:
            raise ConfigError("[s3] needs the package obstore: pip install 'truerate[s3]'") from None
        self._faults = exceptions.BaseError, OSError, ValueError
        self._store = store.S3Store.from_url(
            f"s3://{settings.bucket}/{ward}",
            endpoint=settings.endpoint,
            access_key_id=access,
            secret_access_key=secret,
            client_options={"allow_http": settings.endpoint.startswith("http:"), "timeout": REQUEST},
            retry_config={"max_retries": 8, "retry_timeout": RETRY},
        )

    def copies(self, folder: str) -> list[tuple[datetime, str, int]]:
        """List the objects of a folder, newest first, as tuples (time, name, size).

        time: last change, a datetime by the storage's clock. name: relative to the folder. size: bytes.
        Raises BucketError if the request fails.
        """
        with self._translated():
            found = self._store.list(folder).collect()
        made = [(one["last_modified"], one["path"].removeprefix(f"{folder}/"), one["size"]) for one in found]
        return sorted(made, reverse=True)

    def upload(self, path: Path, name: str) -> None:
        """Upload a local file as the object `name`, in parts of 5 MB. After a failure, the bucket has no partial object.

        Raises BucketError if the request fails or the file cannot be read.
        """
        with self._translated():
            self._store.put(name, path, max_concurrency=2)

    def download(self, name: str, to: Path, progress: Callable[[int, int], None]) -> None:
        """Download the object `name` into the local file `to`; an existing file is overwritten.

        progress(done, total): called after each part with the bytes written so far and the size of the object in bytes.
        Raises BucketError if the request fails or the file cannot be written.
        """
        with self._translated(), to.open("wb") as file:
            for chunk in (found := self._store.get(name)).stream():
                file.write(chunk)
                progress(file.tell(), found.meta["size"])

    @contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except self._faults as error:
            cause = next(_CAUSE.finditer(str(error)))  # the last group fits everything
            raise BucketError(Code.BUCKET_FAILS(bucket=self.name, error=cause[cause.lastindex or 0])) from error
