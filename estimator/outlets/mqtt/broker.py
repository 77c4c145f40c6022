"""Connection to an MQTT broker by paho-mqtt, which reconnects by itself."""

import logging
import ssl
import threading
from typing import Any, NamedTuple, Self

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from bridge.bus.contract import BusError
from bridge.runtime import os_errors
from bridge.toml.loader import ConfigError
from bridge.transport import url

#: seconds to wait for a broker's first answer; for a reconnection: at first, and at most
_ANSWER_S, _AGAIN_S, _LONGEST_S = 10.0, 1, 30
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_log = logging.getLogger(__name__)


class Address(NamedTuple):
    """Address of an MQTT broker, parsed from its URL: host, port number, user and TLS settings.

    ca: file of the certificate authority; empty for the system's authorities. cert, key: files of the client
    certificate; empty for none. All are PEM files.
    """

    host: str
    port: int
    user: str
    tls: bool
    ca: str = ""
    cert: str = ""
    key: str = ""

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def address_of(text: str, example: str) -> Address:
    """Parse a broker's URL, such as mqtts://USER@HOST:PORT?ca=FILE.

    example: a URL shown in error messages. Raises ConfigError if the URL is invalid.
    """
    scheme, mark, rest = text.partition("://")
    if not mark or scheme not in _PORTS:
        raise ConfigError(f"the broker's address is {text!r}: write for example mqtt://127.0.0.1, or {example}")
    try:
        rest, files = url.options(rest, ("ca", "cert", "key"), example)
        user, _, place = rest.rstrip("/").rpartition("@")
        if ":" in user:
            raise ValueError(
                "the broker's address holds a password: put the password into a file, and name the file with --password-file"
            )
        if not place.rpartition("]")[2].count(":"):
            place = f"{place}:{_PORTS[scheme]}"
        host, port = url.host_port(place, example)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if files and scheme == "mqtt":
        raise ConfigError(f"TLS is needed for {', '.join(files)}: write mqtts:// in place of mqtt://")
    return Address(host, port, user, scheme == "mqtts", **files)


class Broker:
    """Session with an MQTT broker, as a context manager. Raises BusError if the first connection fails.

    password: that of the user in `address`; None for none.
    presence: topic that contains `online`, or `offline` after the session has ended (MQTT will message).
    A lost connection is retried for ever. Messages in the meantime are not sent, but counted.
    """

    def __init__(self, address: Address, password: str | None, presence: str) -> None:
        self._address, self._presence = address, presence
        self._answer: ReasonCode | None = None
        self._answered = threading.Event()
        self._back = False
        self._left_out = 0
        self._client = client = Client(CallbackAPIVersion.VERSION2)
        client.on_connect, client.on_disconnect = self._connected, self._disconnected
        client.reconnect_delay_set(_AGAIN_S, _LONGEST_S)
        client.will_set(presence, "offline", qos=1, retain=True)
        if address.user or password is not None:
            client.username_pw_set(address.user, password)
        if address.tls:
            try:
                client.tls_set(address.ca or None, address.cert or None, address.key or None)
            except (OSError, ValueError) as error:
                why = os_errors.sentence(error) if isinstance(error, OSError) else str(error)
                files = ", ".join(one for one in address[4:] if one)
                raise ConfigError(f"the certificates {files} cannot be used: {why}; give PEM files") from None

    def __enter__(self) -> Self:
        address = self._address
        try:
            self._client.connect(address.host, address.port)
        except ssl.SSLCertVerificationError as error:
            raise BusError(
                f"broker {address} shows a certificate that is not trusted ({error.verify_message}): name its authority"
                " with ?ca=FILE, and write the broker's host as it stands in the certificate"
            ) from None
        except OSError as error:
            if address.tls and isinstance(error, ssl.SSLError | ConnectionResetError):
                raise BusError(
                    f"broker {address} does not speak TLS on this port: use mqtt://, or the broker's TLS port"
                ) from None
            raise BusError(
                f"broker {address}: {os_errors.why(error)}; check the address, and that the broker is running"
            ) from None
        self._client.loop_start()
        self._answered.wait(_ANSWER_S)
        if self._answer is None or self._answer.is_failure:
            self._client.loop_stop()
            raise BusError(self._refused())
        return self

    def __exit__(self, *_: object) -> None:
        if self._client.is_connected():
            self._client.publish(self._presence, "offline", qos=1, retain=True).wait_for_publish(2.0)
        self._client.disconnect()
        self._client.loop_stop()

    def came_back(self) -> bool:
        """Return whether the client has reconnected since the last call.

        The broker may then have lost retained messages.
        """
        back, self._back = self._back, False
        return back

    def publish(self, topic: str, payload: bytes, *, keep: bool = False) -> bool:
        """Send a message, and return whether it was sent; False while there is no connection.

        keep: whether the broker keeps it for later subscribers.
        """
        if not self._client.is_connected():
            self._left_out += 1
            return False
        return self._client.publish(topic, payload, qos=int(keep), retain=keep).rc is MQTTErrorCode.MQTT_ERR_SUCCESS

    def _refused(self) -> str:
        address, answer = self._address, self._answer
        if answer is None:
            return f"broker {address} does not answer: check the port, and whether it needs mqtts://"
        if answer.value in {134, 135}:  # bad user name or password, not authorized
            return (
                f"broker {address} refuses user {address.user or '(none)'}: check USER in the URL and --password-file"
            )
        return f"broker {address} refuses the connection: {str(answer).lower()}; look into the broker's log"

    # Called by paho, on its thread.
    def _connected(
        self, _client: Client, _data: Any, _flags: ConnectFlags, code: ReasonCode, _properties: Properties | None
    ) -> None:
        first, self._answer = self._answer is None, code
        self._answered.set()
        if code.is_failure:
            if not first:
                _log.warning("%s; trying again", self._refused())
            return
        self._client.publish(self._presence, "online", qos=1, retain=True)
        self._back = True
        if not first:
            left_out, self._left_out = self._left_out, 0
            _log.info("broker %s is back; %d messages were left out", self._address, left_out)

    def _disconnected(
        self, _client: Client, _data: Any, _flags: DisconnectFlags, code: ReasonCode, _properties: Properties | None
    ) -> None:
        if self._answer is not None and not self._answer.is_failure and code.is_failure:
            _log.warning("broker %s is lost (%s): trying again", self._address, str(code).lower())
