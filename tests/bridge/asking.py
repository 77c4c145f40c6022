"""Asking a health server."""

import http.client


def get(port: int, path: str) -> tuple[int, str]:
    """The code and the text of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()
