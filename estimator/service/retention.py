"""Retention of a device's past: SQL conditions that select old rows. `Store.thin` deletes them.

One point of bias history a minute makes some 500,000 rows a year for each device. A device that reboots every minute
makes as many boots.
"""

# ruff: noqa: S608 - our own words

#: number of boots that teach a temperature law, and of points from the start of each boot
BOOTS, POINTS = 8, 300
HOUR_NS, DAY_NS = 3600 * 10**9, 86400 * 10**9
#: an older point of bias history is kept only if it is the last of its hour; beyond the second age, of its day
ALL_NS, HOURLY_NS = 7 * DAY_NS, 90 * DAY_NS
#: number of newest boots kept per device, and of newest lines of its audit and of its alerts
KEPT_BOOTS, KEPT_AUDIT = 1000, 10_000

#: boots that may teach a law; one more than the law uses, since the present boot does not count
_TEACHING = f"""
SELECT boot FROM (
    SELECT boot, row_number() OVER (PARTITION BY model, firmware, gyro_range ORDER BY number DESC) AS nth
    FROM boots WHERE device = :device
) WHERE nth <= {BOOTS + 1}
"""
_CALIBRATED = "SELECT boot FROM calibrations WHERE device = :device"
_KNOWN = "SELECT boot FROM boots WHERE device = :device"

#: a point of bias history that is not the last of its hour or day
_BETWEEN = f"""number IN (
    SELECT number FROM (
        SELECT number, boot, time_ns, row_number() OVER of_boot AS nth, lead(time_ns) OVER of_boot AS next_ns,
            CASE WHEN time_ns < :now_ns - {HOURLY_NS} THEN {DAY_NS} ELSE {HOUR_NS} END AS width
        FROM bias_history WHERE device = :device WINDOW of_boot AS (PARTITION BY boot ORDER BY time_ns)
    )
    WHERE time_ns < :now_ns - {ALL_NS} AND next_ns / width = time_ns / width
        AND (nth > {POINTS} OR boot NOT IN ({_TEACHING}))
)"""
_OLD_BOOT = f"""device = :device AND boot NOT IN ({_CALIBRATED}) AND boot NOT IN ({_TEACHING}) AND boot NOT IN (
    SELECT boot FROM boots WHERE device = :device ORDER BY number DESC LIMIT {KEPT_BOOTS}
)"""
_OF_UNKNOWN_BOOT = f"""device = :device AND time_ns < :now_ns - {ALL_NS}
    AND boot NOT IN ({_CALIBRATED}) AND boot NOT IN ({_KNOWN})"""
_BEYOND = """device = :device AND number <= (
    SELECT number FROM {table} WHERE device = :device ORDER BY number DESC LIMIT 1 OFFSET {kept}
)"""

#: tables, each with the condition of a row to delete, for one `device` at `now_ns`
THIN = (
    ("bias_history", _BETWEEN),
    ("boots", _OLD_BOOT),
    *((table, _OF_UNKNOWN_BOOT) for table in ("bias", "bias_history")),
    *((table, _BEYOND.format(table=table, kept=KEPT_AUDIT)) for table in ("audit", "alerts")),
)
