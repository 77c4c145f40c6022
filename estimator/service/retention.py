"""How long boots and the points of a bias history are kept, and how densely. Pure.

A point a minute is some 500,000 a year and device; so are the boots of a device that starts anew every minute. What a temperature
law is learnt from is never thinned.
"""

from collections.abc import Sequence

HOUR_NS, DAY_NS = 3600 * 10**9, 86400 * 10**9
#: from so old on, the last one of so long is kept; after the last, none
STEPS_NS = ((7 * DAY_NS, HOUR_NS), (90 * DAY_NS, DAY_NS))
YEAR_NS = 365 * DAY_NS
END_NS = 5 * YEAR_NS
#: so many boots of a device are all kept, the latest; of those before, as of points that are a week old
RECENT_BOOTS = 100
#: as many days are all kept
ALL_DAYS = STEPS_NS[0][0] // DAY_NS


def superfluous(times_ns: Sequence[int], now_ns: int, spared: int = 0) -> list[int]:
    """Which of one boot's points, rising in time, need not be kept: their places. The first `spared` are, as is the last."""
    buckets = [_bucket(time_ns, now_ns) for time_ns in times_ns]

    def surpassed(i: int) -> bool:
        return i + 1 < len(buckets) and buckets[i] == buckets[i + 1] and times_ns[i] < times_ns[i + 1]

    return [
        i
        for i, time_ns in enumerate(times_ns)
        if i >= spared and (now_ns - time_ns > END_NS or (buckets[i] is not None and surpassed(i)))
    ]


def old_boots(times_ns: Sequence[int], now_ns: int) -> list[int]:
    """Which boots of a device, begun at these rising times, need not be kept: their places."""
    old = times_ns[:-RECENT_BOOTS]
    aged = [_bucket(time_ns, max(now_ns, time_ns + STEPS_NS[0][0] + 1)) for time_ns in old]
    return [
        i for i, time_ns in enumerate(old) if now_ns - time_ns > END_NS or (i + 1 < len(old) and aged[i] == aged[i + 1])
    ]


def _bucket(time_ns: int, now_ns: int) -> tuple[int, int] | None:
    """Of which only the last is kept; None: every one is."""
    widths = [width for age_ns, width in STEPS_NS if now_ns - time_ns > age_ns]
    return (widths[-1], time_ns // widths[-1]) if widths else None
