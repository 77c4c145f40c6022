"""Limits for rests as evidence of the bias (zaru.py): assumed motion of a resting body (rad/s), times (s) and NIS gates."""

from math import radians

#: rad/s, motion of a resting body that no reading shows
QUASI_STATIC = radians(0.003)
#: rad/s, the same while quiet for less than PROVEN_AFTER seconds: too short to tell rest from a slow breath or sway
UNPROVEN = radians(0.1)
#: rad/s, the same without an accelerometer: so much a person sways who stands for a moment (tests/bench/honesty.py); and
#: before any proven rest of an unknown bias: half a breath at power-up shut out the truth for minutes
#: (tests/consistency/test_warming.py; seed 16, begun late)
UNPROVEN_AT_MOST = radians(0.19)
PROVEN_AFTER = 4
#: rad/s, the same in the last second of a rest: a movement may begin too gently for a gyro alone
EDGE = radians(0.015)
#: ratio of scatter to noise variance of the means above which a body moves a little
SCATTER = 3.0
#: a jump of the bias is believed after this many seconds of rest in a row
SURE_RESTS = 5
#: NIS gate of the vertical part of a rest: 4 standard deviations
VERTICAL_GATE = 16.0
#: s; a contradiction that stays the same for this long is believed
INSIST_S = 120.0
#: factor by which the bias may have walked faster than BiasKnobs say, in a gap between rests
HURRY = 5.0
#: s, least length of a gap
GAP_S = 5.0
#: rad/s; gated measurements wait and are judged together until their mean is this good; longest wait, s
CERTAIN, LONGEST_WAIT_S = radians(0.006), 8
