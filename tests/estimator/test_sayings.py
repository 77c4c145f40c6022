"""What estimator and bridge say to people has a Chinese: sentence by sentence, as their sources have them."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from estimator import glance
from estimator.sayings import Sayings
from estimator.texts import texts
from estimator.track import zaru

ROOT = Path(glance.__file__).parents[1]
ZH = texts("zh").sayings or Sayings({}, {}, "{words}")

#: whose sentences reach a page: reasons, verdicts, replies, notices, troubles, refusals
SPEAKERS = (
    "estimator/session.py",
    "estimator/learnt.py",
    "estimator/under_way.py",
    "estimator/glance.py",
    "estimator/restore.py",
    "estimator/ward_view.py",
    "estimator/batch/accel_aided.py",
    "estimator/batch/axes.py",
    "estimator/batch/closure.py",
    "estimator/batch/recognise.py",
    "estimator/batch/result.py",
    "estimator/batch/session.py",
    "estimator/batch/transitions.py",
    "estimator/batch/turn360.py",
    "estimator/service/commands.py",
    "estimator/service/gate.py",
    "estimator/service/lost.py",
    "estimator/service/presence.py",
    "estimator/service/orders.py",
    "estimator/service/intake.py",
    "estimator/service/shell.py",
    "estimator/track/doubt.py",
    "estimator/web/app.py",
    "estimator/web/desk.py",
    "estimator/web/form.py",
    "estimator/web/known.py",
    "estimator/web/report_pages.py",
    "bridge/ingest/device_info.py",
    "bridge/ingest/duplicate_bridges.py",
    "bridge/ingest/bad_sample_ratio.py",
    "bridge/ingest/timeline.py",
    "bridge/ingest/no_data_reason.py",
    "bridge/wire/refusal.py",
    "bridge/transport/net_fault.py",
    "bridge/transport/serial_state.py",
    "bridge/drivers/mtdata2_settings.py",
    "bridge/drivers/witmotion_settings.py",
    "bridge/drivers/ximu3_settings.py",
)
#: what no page shows: logs and counts of the service
NOT_SHOWN = re.compile(
    r"%s|%d|^tokens refused|messages refused|messages missed|^commands to|recalibration needed|restored$"
    r"|damaged state|the state goes with|^a state of|by an accelerometer only"
)
#: parts of sentences, which are tried as wholes below
PIECES = {
    "it will be calibrated anyway",
    "nothing to do until it is heard",
    "the gyro's axes are not the accelerometer's: 1",
    " of what the gyro reports",
    "no movement between two rests whose gravity an accelerometer measured1",
    "no full turn about 1 was seen1",
    " (last movement: 1)",
    "1, 1 times worse than sensors err: hold it quite still between movements",
    "full matrix (condition number 1): 11",
    ", 1 that contradicted left out",
    "no samples for 1 s11",
    ": it was 1 when it was heard last",
    "the router is gone1",
    "1 sent by 1: 1 samples are refused; 1",
    "its rate is measured: 1",
    "1 came, and no sample of 1's is in them",
    "1: it is over: 1; 1",
    "1? 1`truerate bridge scan --port 1` finds out",
    "another speed, or another protocol",
    "Stop the bridge, and ",
    "have it open: close those",
    "has it open: close that one",
    "what it sends was not changed",
    "who it is was not learnt",
    "does not answer",
    "answers error 1",
    "to request 1 it 1: 1",
    "after 1 s at rest, ",
    "it calibrates its gyro by itself 11",
}


def spoken(path: Path) -> Iterator[str]:
    """Each text of a source of three words and more, with 1 for what is filled in."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        for child in ast.iter_child_nodes(node):
            if isinstance(node, ast.Expr | ast.JoinedStr):
                child.of_no_interest = True  # type: ignore[attr-defined] # a docstring, or a piece
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(v.value) if isinstance(v, ast.Constant) else "1" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not hasattr(node, "of_no_interest"):
            yield node.value


def test_why_evidence_is_refused_has_a_chinese() -> None:
    for why in (zaru.REFUSED_TILT, zaru.UNPROVEN, "outside the gate", "not finite"):
        assert texts("zh").said(f"zaru: {why}") != f"zaru: {why}"
        assert not re.search("[a-z]{2}", texts("zh").said(why)), why


@pytest.mark.parametrize("speaker", SPEAKERS)
def test_every_sentence_has_a_chinese(speaker: str) -> None:
    said = [text for text in spoken(ROOT / speaker) if text.strip().count(" ") >= 2]
    assert said, "it says nothing any more: take it from the list"
    assert [text for text in said if not (NOT_SHOWN.search(text) or text in PIECES or ZH.knows(text))] == []


#: English, and below it the same in Chinese
PAIRS = """\
a movement of 181°, not a full turn of 360°; if it was just one, the sample rate is off by a factor of two; still needed: x, z
移动了 181°，不是 360° 的整圈；如果只转了一圈，采样率就差了一倍；还需要：x, z
turn about x taken; still needed: y, z
绕 x 轴的转动已记录；还需要：y, z
recalibration asked for by nurse; hold it still for 3 seconds
nurse 要求重新校准；请让它静止 3 秒
bed-1 is tracking: no calibration is under way
bed-1 处于“正常跟踪”：没有正在进行的校准
no samples for 3.1 s: its bridge b is gone: does it run, does it reach the router?
3.1 秒没有样本：它的网桥 b 不在了：在运行吗？能连到路由器吗？
calibrated: three turns closed to 0.12°
已校准：三圈的闭合误差为 0.12°
the turn did not end where it began: x by 1.2°, z by 3.0°. Repeat axis x, z
转动没有回到起点：x 差 1.2°，z 差 3.0°。请重做 x, z 轴
calibrated: diagonal only, Mxy and 2 more known to 1.2° only: rest it on its other sides too, turning a quarter turn between; gravity carried through 7 movements to 0.12° rms
已校准：仅对角线，Mxy 等 2 个以上元素只知道到 1.2°：请也让它靠其他面静止，其间转四分之一圈；重力经 7 次移动传递，均方根误差 0.12°
device a is sent by two bridges, b and c: c's samples are refused; stop one
设备 a 由两个网桥 b 与 c 发送：拒绝 c 的样本；请停掉一个
/dev/ttyUSB0: busy; minicom (process 12) has it open: close that one
/dev/ttyUSB0：被占用；minicom（进程 12） 打开了它：请关掉它
zaru: outside the gate
静止更新：超出门限
"""  # noqa: E501 - as they are said


@pytest.mark.parametrize("pair", range(PAIRS.count("\n") // 2))
def test_sentences_are_put_together(pair: int) -> None:
    text, chinese = PAIRS.splitlines()[2 * pair : 2 * pair + 2]
    assert ZH(text) == chinese


def test_what_is_not_known_is_said_to_be_so_and_the_rest_is_not_lost() -> None:
    words = "port 7: its flux capacitor is empty; hold the device still for 3 seconds"
    assert ZH(words) == "port 7：（原文）its flux capacitor is empty；请让设备静止 3 秒"
    assert not ZH.knows(words)
    assert ZH("<b>{x}</b>") == "<b>{x}</b>"


def test_a_field_is_no_pattern() -> None:
    said = Sayings({"a (b) {n}*": "{n}!", "a (b) 1*": "one"}, {}, "?{words}")
    assert said("a (b) c.d*") == "c.d!"
    assert said("a (b) 1*") == "one"
    assert said("a bb ccc.d*") == "?a bb ccc.d*"


@pytest.mark.parametrize("endless", ["a. " * 166, "so it is. " * 50])
def test_what_would_take_for_ever_is_left_as_it_is_and_the_rest_is_said(endless: str) -> None:
    """As many notices of a bridge as the wire takes, and as long."""
    of_a_bridge = "; ".join(f"notice {i}: {endless}" for i in range(16))
    said = ZH(f"{of_a_bridge}; hold the device still for 3 seconds")
    assert said.count(endless) == 16
    assert said.endswith("；请让设备静止 3 秒")


#: as they are put together by their speakers
WHOLE = """\
bed-1 is warming: it will be calibrated anyway
bed-1 is lost: nothing to do until it is heard
turn about z taken; the turn about x no longer counts: the bias has moved by 0.3 °/s since. Let the device warm up and lie still, then turn it again; still needed: x, y
the turn about x, y is too old; still needed: x, y, z
the gyro's axes are not the accelerometer's: x is y, y is −x of what the gyro reports
calibrated: three turns closed to 0.10°; right if each turn was exactly 360°; all scale factors near 1.147: the LSM9DS1's sensitivity is read as its range over 32768
no movement between two rests whose gravity an accelerometer measured (last movement: a nudge, not a turn)
no turn of 360° if the gyro is what its maker says: y 440°, z 330°. Turn it once around, to where it began. Repeat axis y, z
no full turn about x, y, z was seen: 4.0 samples a second do not show whether it is still: set it to 50 or more, 4 never do
no full turn about x, y was seen (last movement: went back and forth: 400° of movement gained 10°)
no full turn about x was seen: the device was never still for 3 s
the mountings leave the scale of x, z uncertain: mount it with x, z upright too
gravity carried through 7 movements to 2.10° rms, 5.1 times worse than sensors err: hold it quite still between movements
calibrated: full matrix (condition number 12): gravity carried through 9 movements to 0.12° rms, 2 that contradicted left out
no samples for 20 minutes: bridge b hears it no more: is it switched on, plugged in, in reach?
no samples for 4.0 s: bridge b hears it no more: is it switched on, plugged in, in reach?
the router is gone: it was awaiting still when it was heard last
devices a, b, c, d and 3 more are sent by 3 bridges, b, c and d: c's, d's samples are refused; stop all but one
the device tells no time; its rate is measured: 104.2 Hz ± 0.2 %
measured 99 Hz, told 104 Hz; its clock runs 1.05 times as fast as the host's
/dev/ttyUSB0: bytes come, but not native's; they look like driver = 'ximu3': put that into the ward's file
/dev/ttyUSB0: bytes come, but not native's; another speed, or another protocol? Stop the bridge, and `truerate bridge scan --port /dev/ttyUSB0` finds out
file:///a: it is over: 20 bytes came, and no sample of native's is in them; another protocol? `truerate bridge scan --port file:///a` finds out
/dev/ttyUSB0: busy; minicom (process 12), cat (process 13) have it open: close those
to request 10 it answers error 04: what it sends was not changed
it calibrates its gyro by itself after 5 s at rest, which disturbs the calibration: turn it off with WitMotion's own program
it calibrates its gyro by itself which disturbs the calibration: turn it off with WitMotion's own program
its range is 34.907 rad/s, was 17.453 rad/s, its rate is 208 Hz, was 104 Hz when it was calibrated: from scratch
of its samples of the last minute 12 % repeated, 3 % out of range
scale factor x 0.017, y 0.017, z 0.017 outside 0.7 to 1.4: the rates are probably in degrees per second
its battery is at 9 %: charge it
device a is unknown: nothing was heard of it; known are b, c and 3 more
this device's gyro reads 14.7 % low: the library Arduino_LSM9DS1 takes range / 32768 for the sensitivity, the datasheet of the LSM9DS1 says 70 mdps a count. Its readings stay as sent; expect a scale factor k near 1.15, which a calibration finds
no device x was heard; there are: a, b
The estimator does not answer: nothing was done. Try again, or tell the engineer.
"""  # noqa: E501 - as they are said


@pytest.mark.parametrize("text", WHOLE.splitlines())
def test_what_is_said_in_several_pieces_is_all_known(text: str) -> None:
    assert ZH(text) != text
    assert ZH.knows(text), ZH(text)
    assert not re.search("[A-Za-z]{3,} [a-z]{3,} [a-z]{2,}", re.sub("`.*`", "", ZH(text))), ZH(text)
