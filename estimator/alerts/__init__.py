"""Alerts: what has needed a person for its hold time, once, until it has been well for a while.

`board.py` decides (pure), `outbox.py` gathers what is to be sent and keeps quiet hours (pure), `sender.py` sends by apprise.
"""
