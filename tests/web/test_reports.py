"""What is printed: a certificate and the ward's summary, in a real browser and as a PDF of it."""

import re
from dataclasses import replace
from datetime import datetime
from io import BytesIO
from itertools import pairwise, product

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Page, expect

from bridge.wire.messages import AccelerometerCalibration, State, Turn, Verdict
from estimator.figures import history
from estimator.web import number_format, reports
from tests.estimator.device.test_correction import CALIBRATION
from tests.sentences import free
from tests.web.conftest import Look, Site
from tests.web.talk import about, said, until
from tests.web.test_browser import heard, now_ns, tracking

pytestmark = [pytest.mark.xdist_group("browser"), pytest.mark.timeout(300)]
NAME = "bed-01-chest"
TURNS = (Turn(0, 6.28, 0.002, 4.1), Turn(1, -6.28, 0.004, 4.6), Turn(2, 6.27, 0.001, 5.0))
FIRST = replace(
    CALIBRATION,
    device=NAME,
    boot=5,
    id="first",
    who="nurse",
    turns=TURNS,
    model="virtual",
    firmware="1.0",
    gyro_range=8.7,
)
LEVEL = AccelerometerCalibration(
    Verdict.ACCEPTED, (), 6, (0.1, 0.0, -0.2), (1.0, 0.99, 1.01), tuple((1e-6 * np.eye(6)).ravel().tolist())
)
SECOND = replace(
    FIRST,
    id="second",
    accelerometer=LEVEL,
    matrix=np.diag([0.9, 1.001, 1.15]),
    reason=free("three turns closed to 0.23°"),
)


def calibrated(site: Site) -> None:
    """A device that was calibrated twice, one that was refused, and one that is lost."""
    at = now_ns()
    site.talk(
        about(NAME, boot=5, time_ns=at, battery_percent=82.0),
        replace(FIRST, time_ns=at - 3600 * 10**9),
        replace(SECOND, time_ns=at - 60 * 10**9),
        replace(FIRST, id="bad", verdict=Verdict.REFUSED, reason=free("scale factor x 2.000 outside"), parameters=(),
                covariance=np.zeros((0, 0)), time_ns=at - 30 * 10**9),
        tracking(NAME, calibration="second"),
        replace(said("bed-01-wrist", State.LOST, boot=1, time_ns=at), reason=free("no samples for 12 s")),
    )  # fmt: skip
    site.talk(*(tracking(NAME, calibration="second") for _ in range(3)))
    heard(site, 2)
    until(lambda: len(site.server.desk.known.stories[NAME].trail.points) >= 4)


def path(number: str) -> str:
    return f"/devices/{NAME}/calibrations/{number}/certificate"


def pages_of(page: Page) -> int:
    """How many sheets of A4 it is, as the browser prints it."""
    return page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n")


def test_a_certificate(page: Page, site: Site, look: Look) -> None:
    calibrated(site)
    page.goto(path("second"))
    expect(page.get_by_role("heading", level=1)).to_have_text("Calibration certificate")
    expect(page.locator(".verdict")).to_contain_text(f"{NAME}: accepted It is in use now.")
    expect(page.locator(".numbers").first).to_contain_text("1.0010 ± 0.0039")
    expect(page.locator(".paper")).to_contain_text(": z. Was it another table edge")
    expect(page.locator(".paper")).to_contain_text("−359.8°")
    assert page.locator(".figure").evaluate("picture => picture.decode().then(() => picture.naturalWidth)") > 1000
    # When it was is said with its zone, and the picture below is in the same.
    zone = number_format.zone_name(datetime.now().astimezone())
    expect(page.locator(".facts")).to_contain_text(re.compile(rf"\d\d:\d\d:\d\d {re.escape(zone)}"))
    expect(page.locator(".paper")).to_contain_text(f"Times in {zone}.")
    expect(page.locator(".signs")).to_contain_text("Turned by:")
    expect(page.locator(".due")).to_contain_text(re.compile(r"Calibrated on 20\d\d-\d\d-\d\d. Due again by 20\d\d"))
    expect(page.locator(".facts")).to_contain_text("within")
    expect(page.locator(".facts")).to_contain_text(
        re.compile(r"x 1\.0000 ±\s0\.0020, 0\.100 ±\s0\.002 m/s²; y 0\.9900")
    )
    expect(page.locator(".code svg")).to_be_visible()
    expect(page.locator(".next")).to_have_text("Print this page, sign it below, and keep it.")
    page.evaluate("window.print = () => { window.printed = true; }")
    page.get_by_role("button", name="Print").click()
    assert page.evaluate("window.printed")
    look("certificate")
    assert pages_of(page) == 1
    page.get_by_role("link", name="中文").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("校准证书")
    expect(page.locator(".paper")).to_contain_text("相差超过两者的不确定度：z")
    look("certificate-zh")
    # For a printer of labels of 62 × 29 mm: the device, the verdict, when it is due, and the code.
    page.goto(f"{path('second')}?lang=en")
    page.get_by_role("link", name="Print a label").click()
    expect(page.locator(".verdict")).to_contain_text(f"{NAME}: accepted")
    expect(page.locator(".facts")).to_have_count(0)
    look("label")
    assert pages_of(page) == 1
    certificates = page.locator(".code svg path").last.get_attribute("d")
    page.goto(f"/devices/{NAME}/label")
    assert page.locator(".code svg path").last.get_attribute("d") == certificates, "both open the device's page"
    look()
    assert pages_of(page) == 1


def test_a_picture_of_the_bias_leads_no_line_across_a_reboot(site: Site) -> None:
    calibrated(site)
    site.talk(*(tracking(NAME, boot=6) for _ in range(3)))
    story = site.server.desk.known.stories[NAME]
    until(lambda: story.boot == 6 and len(reports.past(story, NAME).biases) == 2)
    past = reports.past(story, NAME)
    boundaries = [one.time_ns[-1] < other.time_ns[0] for one, other in pairwise(past.biases)]
    assert boundaries == [True]
    for dark, narrow in product((False, True), repeat=2):
        drawn = BytesIO()
        history(past, drawn, dark=dark, narrow=narrow)
        drawn.seek(0)
        picture = imread(drawn)
        assert (picture.shape[0] > picture.shape[1]) == narrow, "upright on a phone"
        assert (picture[0, 0, :3].mean() < 0.3) == dark


def test_a_certificate_of_a_refused_one_says_so(page: Page, site: Site, look: Look) -> None:
    calibrated(site)
    page.goto(path("bad"))
    expect(page.locator(".verdict")).to_contain_text(f"{NAME}: refused It is not in use now.")
    expect(page.locator(".facts")).to_contain_text("scale factor x 2.000 outside")
    expect(page.locator(".next")).to_have_text("Calibrate the device again. Calibrate")
    look("certificate-refused")
    page.goto(path("first"))
    expect(page.locator(".next")).to_have_text("See the device's page: it says what to do now.")
    page.goto(path("never"))
    expect(page.locator(".reason")).to_have_text(f"No calibration never of {NAME} is known.")


def test_the_wards_summary(page: Page, site: Site, look: Look) -> None:
    calibrated(site)
    page.goto("/")
    page.get_by_role("link", name="Report of the ward, to print").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Ward w: summary")
    expect(page.locator(".of")).to_contain_text("1 of 2 tracking")
    expect(page.locator(".needs")).to_contain_text(
        "bed-01-wrist lost Check that it is on, charged and near. no samples for 12 s"
    )
    expect(page.locator(".numbers")).to_contain_text("1.1500 ± 0.0059")
    look("report")
    assert pages_of(page) == 1
    page.get_by_role("link", name="中文").click()
    expect(page.locator(".of")).to_contain_text("2 台中有 1 台正常跟踪")
    look("report-zh")
