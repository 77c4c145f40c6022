"""Reason codes of bridge and estimator, each with the names of its parameters."""

from enum import StrEnum
from typing import NamedTuple, Self


class Sentence(NamedTuple):
    """A reason: a code and its parameters by name, each formatted as text.

    The catalogue turns a sentence into the words of a language.

    A parameter's name ends in its unit (`angle_deg`, `duration_s`). The parameter named `label` is a label of the
    catalogue.
    """

    code: str
    params: dict[str, str]


#: reasons of one result or state, in display order
Sentences = tuple[Sentence, ...]


class Code(StrEnum):
    """Reason codes of bridge and estimator, each with the names of its parameters (`params`).

    Calling a code makes its sentence: `Code.TURN_TAKEN(axis="x")`. The catalogue has the texts.
    """

    params: tuple[str, ...]

    def __new__(cls, code: str, *params: str) -> Self:
        """Create a code with the names of its parameters."""
        made = str.__new__(cls, code)
        made._value_ = code
        made.params = params
        return made

    def __call__(self, **params: object) -> Sentence:
        """Make the sentence with these parameters. Raises TypeError if a parameter is missing or unknown."""
        if params.keys() != set(self.params):
            raise TypeError(f"{self.value} takes the parameters {self.params}, not {tuple(params)}")
        return Sentence(self, {name: str(value) for name, value in params.items()})

    # Life of a device: its state, and what to do next
    NEVER_HEARD = "never_heard"
    WARMING_UP = "warming_up"
    RESTARTED = "restarted"
    HOLD_STILL = "hold_still"
    TURN_NOW = "turn_now", "axes"
    TURN_TAKEN = "turn_taken", "axis"
    TURNS_NEEDED = "turns_needed", "axes"
    CALIBRATED = "calibrated"
    CALIBRATION_GOES_ON = "calibration_goes_on"
    RECALIBRATION_ASKED = "recalibration_asked", "who"
    REQUEST_REASON = "request_reason", "words"
    CALIBRATION_CANCELLED = "calibration_cancelled", "who"
    OLD_CALIBRATION_STAYS = "old_calibration_stays"
    TURNS_LOST = "turns_lost", "axes"
    MODEL_CHANGED = "model_changed", "now", "then"
    FIRMWARE_CHANGED = "firmware_changed", "now", "then"
    RANGE_CHANGED = "range_changed", "now_rad_s", "then_rad_s"
    RATE_CHANGED_SINCE = "rate_changed_since", "now_hz", "then_hz"
    CALIBRATE_FROM_SCRATCH = "calibrate_from_scratch"
    RATE_TOO_LOW = "rate_too_low", "rate_hz", "least_hz"
    AT_REST_AGAIN = "at_rest_again", "gap_s"

    # Doubts about the bias
    BIAS_WAS_DOUBTED = "bias_was_doubted"
    BIAS_CONFIRMED = "bias_confirmed"
    REST_CONTRADICTS_BIAS = "rest_contradicts_bias", "rate_dps"
    QUIET_CONTRADICTS_BIAS = "quiet_contradicts_bias", "rate_dps"
    GRAVITY_CONTRADICTS_BIAS = "gravity_contradicts_bias"
    RESTS_DISAGREE = "rests_disagree", "times"
    NO_REST_FOR = "no_rest_for", "minutes"
    TEMPERATURE_LAW_REFUTED = "temperature_law_refuted"

    # Why a device sends nothing, or its samples are not used
    NO_SAMPLES = "no_samples", "duration"
    NO_SAMPLES_SINCE_TAKEOVER = "no_samples_since_takeover"
    BRIDGE_GONE = "bridge_gone", "bridge"
    BRIDGE_NOT_BACK = "bridge_not_back", "bridge"
    DEVICE_UNHEARD = "device_unheard", "bridge"
    SAMPLES_OUTDATED = "samples_outdated", "bridge"
    ROUTER_GONE = "router_gone"
    WARD_ROUTER_GONE = "ward_router_gone"
    LAST_STATE = "last_state", "label"
    NOT_ENROLLED = "not_enrolled"
    ENROLLED_ELSEWHERE = "enrolled_elsewhere", "place", "bridge"
    SILENT_ESTIMATOR = "silent_estimator", "duration_s"
    NO_ESTIMATOR_SPOKE = "no_estimator_spoke"
    LOW_BATTERY = "low_battery", "percent"

    ALERT = "alert", "subject", "label"

    # Answers to commands
    ALREADY_DUE = "already_due", "device"
    NOT_HEARD = "not_heard", "device"
    NOTHING_TO_CANCEL = "nothing_to_cancel", "device"
    NOTED = "noted"
    NOTE_EMPTY = "note_empty"
    HEADING_IS_ZERO = "heading_is_zero"
    ACKNOWLEDGED = "acknowledged", "labels"
    NOTHING_TO_ACKNOWLEDGE = "nothing_to_acknowledge", "subject"
    PLACED = "placed", "placement"
    NOBODY_WEARS = "nobody_wears"
    NO_PLACEMENT = "no_placement", "device"
    NO_ORIENTATION = "no_orientation", "device"
    COMMAND_FAILED = "command_failed"
    COMMAND_MALFORMED = "command_malformed", "detail"
    UNKNOWN_DEVICE = "unknown_device", "device"
    KNOWN_DEVICES = "known_devices", "names"
    KNOWN_DEVICES_AND_MORE = "known_devices_and_more", "names", "more"
    TOO_MANY_COMMANDS = "too_many_commands"
    ESTIMATOR_BUSY = "estimator_busy"
    TURNS_WOULD_BE_LOST = "turns_would_be_lost"
    BOOT_NUMBER_REPEATED = "boot_number_repeated"
    FORGOTTEN = "forgotten", "who"
    ERASED = "erased", "who"
    STILL_LISTED = "still_listed", "device", "place"
    STILL_SENDING = "still_sending", "device"
    WARD_FILE_IN_FORCE = "ward_file_in_force"
    WARD_FILE_TAKEN = "ward_file_taken", "settings"
    WARD_FILE_NEEDS_RESTART = "ward_file_needs_restart", "settings"
    WARD_FILE_REFUSED = "ward_file_refused", "error"

    # Copies of backups and recordings
    BUCKET_FAILS = "bucket_fails", "bucket", "error"
    BUCKET_HAS_ANOTHER = "bucket_has_another", "bucket", "file"

    # Why a movement was no turn
    NUDGE = "nudge"
    GYRO_STUCK = "gyro_stuck", "samples"
    TOO_FAST = "too_fast", "samples"
    SAMPLES_MISSING = "samples_missing", "duration_s"
    MOVEMENT_IN_DEGREES = "movement_in_degrees", "angle_deg"
    BACK_AND_FORTH = "back_and_forth", "way_deg", "angle_deg"
    TURN_TOO_SHORT = "turn_too_short", "angle_deg"
    TURN_TOO_LONG = "turn_too_long", "angle_deg"
    RATE_OFF_BY_TWO = "rate_off_by_two"
    TURN_TOO_SLOW = "turn_too_slow", "duration_s", "most_s"
    NOT_ONE_AXIS = "not_one_axis", "percent", "axis"
    RESTLESS = "restless", "rate_dps"
    ENDED_TILTED = "ended_tilted", "angle_deg"
    ACCELEROMETER_BLIND = "accelerometer_blind"
    VERTICAL_TURN = "vertical_turn", "axis"
    PAUSED = "paused", "duration_s"
    TURN_TOO_OLD = "turn_too_old", "axes", "most_minutes"
    TURN_BIAS_MOVED = "turn_bias_moved", "axis", "rate_dps"
    NO_FULL_TURN = "no_full_turn", "axes"
    READINGS_IN_DEGREES = "readings_in_degrees", "rate_rad_s"
    READINGS_IN_RADIANS = "readings_in_radians"
    NEVER_STILL = "never_still", "duration_s"
    NEVER_MOVED = "never_moved"
    LAST_MOVEMENT = "last_movement"
    NO_CHECKED_MOVEMENT = "no_checked_movement"
    ACCELEROMETER_NOT_GRAVITY = "accelerometer_not_gravity", "reading_m_s2"

    # Calibrations that devices make themselves
    OWN_ACCEPTED = "own_accepted"
    LEARNT_WORN = "learnt_worn"
    OWN_OF_ANOTHER_BOOT = "own_of_another_boot"
    OWN_BIAS_LARGE = "own_bias_large", "bias_dps", "most_dps"
    OWN_BIAS_CONTRADICTED = "own_bias_contradicted", "own_dps", "seen_dps"

    # Verdicts
    TURNS_CLOSED = "turns_closed", "angle_deg"
    TURNS_ASSUMED = "turns_assumed"
    VERTICAL_TURNS_ASSUMED = "vertical_turns_assumed", "axes"
    TURNS_TILTED = "turns_tilted", "percent", "angle_deg"
    LIBRARY_SENSITIVITY = "library_sensitivity", "factor"
    TURNS_OPEN = "turns_open", "errors", "axes"
    SCALE_UNCERTAIN = "scale_uncertain", "axes"
    SCALE_OUTSIDE = "scale_outside", "scale", "least", "most"
    RATE_WRONG = "rate_wrong"
    UNIT_WRONG = "unit_wrong"
    SENSITIVITY_WRONG = "sensitivity_wrong"
    NOT_ONE_TURN = "not_one_turn", "turns", "axes"
    AXES_DIFFER = "axes_differ", "mapping"
    NOT_CONVERGED = "not_converged", "steps", "scale"
    TURNS_UNDETERMINED = "turns_undetermined"
    FULL_MATRIX = "full_matrix"
    CONDITION_NUMBER = "condition_number", "number"
    DIAGONAL_ONLY = "diagonal_only"
    GRAVITY_CARRIED = "gravity_carried", "movements", "angle_deg"
    MOVEMENTS_LEFT_OUT = "movements_left_out", "movements"
    MOVEMENTS_MISFIT = "movements_misfit", "times"
    MOVEMENTS_TOO_FEW = "movements_too_few", "movements", "least"
    POSES_INSUFFICIENT = "poses_insufficient", "number", "most"
    ELEMENTS_UNCERTAIN = "elements_uncertain", "element", "others", "angle_deg"
    MOVEMENTS_UNDETERMINED = "movements_undetermined"
    MOVEMENTS_UNCERTAIN = "movements_uncertain", "axes"
    TOO_FEW_POSES = "too_few_poses", "poses", "least"
    POSES_UNDETERMINED = "poses_undetermined"
    MATRIX_UNCERTAIN = "matrix_uncertain", "percent"
    ACCELEROMETER_CALIBRATED = "accelerometer_calibrated", "poses"
    ACCELEROMETER_UNCERTAIN = "accelerometer_uncertain"
    ACCELEROMETER_MISFIT = "accelerometer_misfit", "times"
    SERVO_RATES = "servo_rates", "given"
    SERVO_NO_REST = "servo_no_rest"
    SERVO_TOO_FEW = "servo_too_few", "spins"
    SERVO_DIAGONAL = "servo_diagonal", "spins", "percent"
    SERVO_MISFIT = "servo_misfit", "times"
    MOUNTINGS_UNCERTAIN = "mountings_uncertain", "axes"
    TABLE_ONE_WAY = "table_one_way", "spins", "axes"
    TABLE_RATE_MISSING = "table_rate_missing", "rates_dps"
    TABLE_MATRIX = "table_matrix", "spins", "percent"
    TABLE_MISFIT = "table_misfit", "times"
    STRETCHES_LEFT_OUT = "stretches_left_out", "stretches", "clipped"

    # The ward
    NO_ESTIMATOR = "no_estimator"
    NO_BRIDGE = "no_bridge"
    NO_DEVICE = "no_device"
    WARD_EMPTY = "ward_empty", "ward"
    TWO_BRIDGES = "two_bridges", "devices", "owner", "refused"
    TWO_BRIDGES_AND_MORE = "two_bridges_and_more", "devices", "more", "owner", "refused"
    SETTING_DOUBTED = "setting_doubted", "devices", "names", "setting"
    ESTIMATOR_OVERLOADED = "estimator_overloaded", "duration_s"
    STORE_FAILING = "store_failing", "devices"
    SAMPLES_UNACCOUNTED = "samples_unaccounted", "device", "taken", "out", "dropped", "lost"
    SAMPLES_WERE_UNACCOUNTED = "samples_were_unaccounted", "device", "times"
    DEVICES_LEFT_OUT = "devices_left_out", "messages", "bridges"
    ESTIMATOR_SILENT = "estimator_silent", "estimator"
    TWO_ESTIMATORS = "two_estimators", "devices", "names"
    ESTIMATOR_CAME = "estimator_came", "estimator"
    ESTIMATOR_GONE = "estimator_gone", "estimator"
    ESTIMATOR_TOOK = "estimator_took", "estimator"
    SHARED_ANEW = "shared_anew"
    HEARD_FIRST = "heard_first"

    # Why a bridge cannot read a device
    NOTHING_HEARD = "nothing_heard", "place"
    NOTHING_UNDERSTOOD = "nothing_understood", "place"
    NOTHING_COMES = "nothing_comes", "place"
    BYTES_OF_ANOTHER = "bytes_of_another", "place", "driver"
    LOOKS_LIKE = "looks_like", "settings"
    TRY_SCAN = "try_scan", "place"
    CAPTURE_EMPTY = "capture_empty", "place"
    CAPTURE_WITHOUT_SAMPLES = "capture_without_samples", "place", "bytes", "driver"
    CAPTURE_OVER = "capture_over", "place"
    RECORDING_OVER = "recording_over", "place"
    DEVICE_REMOVED = "device_removed", "bridge"
    PORT_MISSING = "port_missing", "place"
    PORT_FORBIDDEN = "port_forbidden", "place"
    NOT_A_SERIAL_PORT = "not_a_serial_port", "place"
    PORT_BUSY = "port_busy", "place"
    PORT_HELD = "port_held", "place", "holders"
    PORT_READ_BY_BRIDGE = "port_read_by_bridge", "place", "holders"
    PORT_SHARED = "port_shared", "place", "holders"
    PORT_LOST = "port_lost", "place"
    PLACE_FAILED = "place_failed", "place", "error"
    NAME_UNKNOWN = "name_unknown", "place"
    NO_ANSWER = "no_answer", "place"
    CONNECTION_REFUSED = "connection_refused", "place"
    UNREACHABLE = "unreachable", "place"
    LISTENING_BUSY = "listening_busy", "place"
    ADDRESS_FOREIGN = "address_foreign", "place"
    PORT_PRIVILEGED = "port_privileged", "place"
    TOO_MANY_FILES = "too_many_files", "place"
    PORT_TAKEN = "port_taken", "place", "taken", "example"
    CONNECTION_LOST = "connection_lost", "place", "error"
    CONNECTION_SILENT = "connection_silent", "place"
    CONNECTION_CLOSED = "connection_closed", "place"
    NOT_TAKEN = "not_taken", "place"
    CLOSED = "closed", "place"
    BLE_NO_CONNECTION = "ble_no_connection", "place", "duration_s"
    BLE_NOT_HEARD = "ble_not_heard", "place"
    BLE_OFF = "ble_off", "place"
    BLE_UNUSABLE = "ble_unusable", "place", "error"
    BLE_SERVICE_SILENT = "ble_service_silent", "place"
    BLE_NO_CHARACTERISTIC = "ble_no_characteristic", "place", "wanted", "listed"
    BLE_LOST = "ble_lost", "place"
    LSL_NOT_HEARD = "lsl_not_heard", "place"
    LSL_SEVERAL = "lsl_several", "place", "listed"
    LSL_NO_CHANNELS = "lsl_no_channels", "place", "wanted", "listed"
    LSL_NO_UNIT = "lsl_no_unit", "place", "channels", "unit", "option"
    DRIVER_FAILED = "driver_failed", "error"

    # Notices: what a person should know about a device
    RATE_CHANGED = "rate_changed", "then_hz", "now_hz"
    RATE_MEASURED = "rate_measured", "rate_hz", "percent"
    RATE_PRESUMED = "rate_presumed", "rate_hz"
    RATE_DIFFERS = "rate_differs", "measured_hz", "told_hz"
    CLOCK_DIFFERS = "clock_differs", "times"
    SAMPLES_BAD = "samples_bad", "percent", "label"
    CALIBRATES_ITSELF = "calibrates_itself"
    CALIBRATES_ITSELF_AT_REST = "calibrates_itself_at_rest", "duration_s"
    MAY_CALIBRATE_ITSELF = "may_calibrate_itself"
    CORRECTS_ITSELF = "corrects_itself"
    MAY_CORRECT_ITSELF = "may_correct_itself"
    REQUEST_UNANSWERED = "request_unanswered", "request"
    REQUEST_REFUSED = "request_refused", "request", "error"
    NO_RATE_OF_TURN = "no_rate_of_turn"
    LEGACY_MTDATA = "legacy_mtdata"
    RAW_COUNTS = "raw_counts"
    NOT_SHIMMER3 = "not_shimmer3", "version"
    GYRO_NOT_CALIBRATED = "gyro_not_calibrated"
    SEVERAL_SYSTEMS = "several_systems", "system", "others"
    LSL_UNEVEN = "lsl_uneven"
    NO_TIME_COLUMN = "no_time_column", "column", "rate_hz"
    READS_LOW = "reads_low", "percent", "cause", "scale"
    READS_HIGH = "reads_high", "percent", "cause", "scale"
    DEVICE_SAYS = "device_says", "words"
    DEVICE_REPORTS_ERROR = "device_reports_error", "words"
    PROFILE_NOTICE = "profile_notice", "words"
