"""The estimator's reasons as keys with values, so that every language can say them. Each pattern is one of its sentences."""

import re
from dataclasses import dataclass, field

_N = r"([\d.]+)"
#: axes, as `x` or `x, z`
_AXES = r"([xyz](?:, [xyz])*)"


@dataclass(frozen=True, slots=True)
class Words:
    """A sentence: what it is called in the texts, and what is filled in."""

    key: str
    values: dict[str, str] = field(default_factory=dict)


#: by key: what the estimator says, and the names of what is in it; the first words of a sentence are enough
_SAID: dict[str, tuple[str, tuple[str, ...]]] = {
    "stuck": (rf"the gyro repeated itself for {_N} samples", ("n",)),
    "fast": (r"turned faster than the gyro's range for", ()),
    "torn": (rf"{_N} s of samples are missing in the turn", ("seconds",)),
    "units": (r"(?:readings|rates) are probably (?:rad/s|in degrees per second|degrees per second)", ()),
    "back_and_forth": (rf"went back and forth: {_N}° of movement gained {_N}°", ("way", "angle")),
    "short": (rf"a movement of {_N}°, not a full turn", ("angle",)),
    "long": (rf"a movement of {_N}°, more than one full turn", ("angle",)),
    "rate": (r"the sample rate is (?:probably )?off by a factor of two", ()),
    "slow": (rf"a turn that took {_N} s", ("seconds",)),
    "askew": (rf"not about one axis of the device: {_N} % about ([xyz])", ("percent", "axis")),
    "vertical": (r"gravity does not check a turn about the vertical: stand the device so that ([xyz])", ("axis",)),
    "restless": (rf"the rests before and after read {_N} °/s apart", ("rate",)),
    "tilted": (rf"ended tilted {_N}°", ("angle",)),
    "paused": (rf"a pause of {_N} s in it was too short to be a rest", ("seconds",)),
    "old": (rf"the turn about {_AXES} (?:is too old|no longer counts)", ("axes",)),
    "around": (rf"no turn of 360° if the gyro is what its maker says: .*Repeat axis {_AXES}", ("axes",)),
    "open": (rf"the turn did not end where it began: .*Repeat axis {_AXES}", ("axes",)),
    "loose": (rf"the turns leave the scale uncertain\. Repeat axis {_AXES}", ("axes",)),
    "outside": (r"scale factor (.+) outside", ("values",)),
    "accelerometer": (r"the accelerometer (?:reads [\d.]+ m/s² at rest|does not read gravity)", ()),
    "foreign": (r"the gyro's axes are not the accelerometer's", ()),
    "cancelled": (r"calibration cancelled by (.+?);", ("who",)),
    "moved": (rf"the turns about {_AXES} were taken by an estimator that does not have it now", ("axes",)),
    "changed": (r"(its .+: from scratch)", ("what",)),
}
#: what it says when nothing is wrong: the steps themselves tell that
_USUAL = re.compile(
    r"still: now turn it|turn about [xyz] taken(?!; the turn)|hold the device still|a nudge, not a turn|warming up|never seen"
    r"|calibrated|three turns closed|right if |sure to |all scale factors near|recalibration asked|the device was restarted"
    r"|bias of this boot"
)
_PATTERNS = {key: (re.compile(pattern), names) for key, (pattern, names) in _SAID.items()}


def said(reason: str) -> tuple[Words, ...]:
    """What is wrong in a status's reason, in order; nothing when it is the usual; what is not known is said as it is."""
    found = [
        (match.start(), Words(key, dict(zip(names, match.groups(), strict=True))))
        for key, (pattern, names) in _PATTERNS.items()
        if (match := pattern.search(reason)) is not None
    ]
    if not found and reason and not _USUAL.match(reason):
        return (Words("other", {"words": reason}),)
    return tuple(words for _, words in sorted(found, key=lambda one: one[0]))
