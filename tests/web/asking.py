"""A dashboard that is asked in this process, by pages and programs, and the ward that it hears."""

import re
from typing import Any

from argon2 import PasswordHasher
from starlette.testclient import TestClient

from bridge.wire.messages import Status
from estimator.config.dashboard import Dashboard, Person
from estimator.web.serve import Server
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.web.talk import WARD, Talk, until

PASSWORD = "correct horse battery"
# Hashes of little effort: the tests are not about how long one takes.
HASHER = PasswordHasher(time_cost=1, memory_cost=64)
PEOPLE = (Person(name="nurse", password=HASHER.hash(PASSWORD)),)
SCRIPT = Person(name="script", password=HASHER.hash("a token of its own"))
BEARER = {"Authorization": f"Bearer nurse.{PASSWORD}"}
URL = "http://127.0.0.1:8090"
LIVE = "ws://127.0.0.1:8090/live"


class Asking:
    """A dashboard that is asked in this process, and the ward it hears."""

    def __init__(self, **settings: Any) -> None:
        broker = MemoryBroker()
        self.talk = Talk(broker)
        self.server = Server(WARD, Dashboard(**{"people": (*PEOPLE, SCRIPT), **settings}))
        self.server.connect(MemoryBus(broker), MemoryBus(broker))
        self.client = TestClient(self.server.app, base_url=URL, follow_redirects=False)

    def hear(self, *said: Any) -> None:
        """Say it, and wait until it has been heard."""
        self.talk(*said)
        names = {one.device for one in said if isinstance(one, Status)}
        stories = self.server.desk.known.stories
        until(lambda: all(name in stories and stories[name].status is not None for name in names))

    def log_in(self) -> str:
        """The CSRF token of a session of the client's."""
        answer = self.client.post("/login", data={"name": "nurse", "password": PASSWORD, "to": "/"})
        assert answer.status_code == 303
        found = re.search(r'name="csrf" value="([^"]+)"', self.client.get("/").text)
        assert found is not None
        return found[1]


def error(answer: Any) -> tuple[int, str]:
    """Status and code of an answer to a program that was refused."""
    return answer.status_code, answer.json()["error"]["code"]
