"""Printable reports: certificate of a calibration, summary of the ward, and a chart of a device's bias."""

import gc
import time
from datetime import UTC, datetime
from http import HTTPStatus
from importlib.metadata import version
from io import BytesIO

import segno
from markupsafe import Markup
from starlette.datastructures import URL
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from estimator.language.texts import texts
from estimator.service.history import History
from estimator.web import number_format, reports
from estimator.web.http_error import Fault
from estimator.web.language import language
from estimator.web.pages import show
from estimator.web.site import Desk


def routes() -> list[BaseRoute]:
    """Return the routes of the reports, of device labels and of the bias chart."""
    return [
        Route("/report", ward, name="report"),
        Route("/devices/{device}/calibrations/{calibration}/certificate", certificate, name="certificate"),
        Route("/devices/{device}/label", label, name="label"),
        Route("/devices/{device}/bias.png", bias, name="bias"),
    ]


async def ward(request: Request) -> Response:
    """Serve the printable summary of the ward."""
    page = reports.summary(Desk.of(request).known, time.monotonic(), texts(language(request)))
    return _report(request, "report.html", page)


async def certificate(request: Request) -> Response:
    """Serve the certificate of one calibration, accepted or rejected; with ?label=1 a printable label for the device.

    Raises Fault for an unknown device or calibration.
    """
    desk, name, number = Desk.of(request), request.path_params["device"], request.path_params["calibration"]
    known = {calibration.id: calibration for calibration in await desk.past(request, name)}
    if (found := known.get(number)) is None:
        raise Fault(HTTPStatus.NOT_FOUND, "unknown_calibration", id=number[:80], device=name)
    story = desk.story(name)
    page = reports.certificate(
        found, known.values(), story.status, texts(language(request)),
        limit=desk.treatment.of(name).scale_limit, due_days=desk.settings.due_days, now_ns=time.time_ns(),
    )  # fmt: skip
    picture = bool(reports.past(story, name).biases)
    label = request.query_params.get("label") == "1"
    code = _code_of_device(request) if label else _code(request.url.replace(query=""))
    return _report(request, "certificate.html", page, picture=picture and not label, code=code, label=label)


async def label(request: Request) -> Response:
    """Serve the printable label of a device, with a QR code that opens its page. Raises Fault for an unknown device."""
    name = request.path_params["device"]
    Desk.of(request).story(name)
    return _report(request, "label.html", None, device=name, code=_code_of_device(request), label=True)


def _code_of_device(request: Request) -> Markup:
    """QR code for a label on the device: it opens the device's page, where the placement is set."""
    return _code(request.url_for("device", device=request.path_params["device"]))


def _code(opens: URL) -> Markup:
    return Markup(segno.make(str(opens)).svg_inline(scale=2, border=1))  # noqa: S704 - made here


async def bias(request: Request) -> Response:
    """Serve a chart of the device's bias over time as a PNG image; ?dark=1 for a dark page, ?narrow=1 for a phone.

    Raises Fault if no bias is known.
    """
    desk, name = Desk.of(request), request.path_params["device"]
    story = desk.story(name)
    if not reports.past(story, name).biases:
        raise Fault(HTTPStatus.NOT_FOUND, "no_bias", device=name)
    dark, narrow = (request.query_params.get(way) == "1" for way in ("dark", "narrow"))
    key = f"{name} {dark:d}{narrow:d}"
    drawn = await desk.pictures.get(request, key, lambda: _drawn(reports.past(story, name), dark=dark, narrow=narrow))
    return Response(drawn, media_type="image/png")


def _drawn(of: History, *, dark: bool, narrow: bool) -> bytes:
    from estimator.figures.histories import history  # noqa: PLC0415 - matplotlib takes a second to load

    drawn = BytesIO()
    history(of, drawn, datetime.now().astimezone().tzinfo or UTC, words=False, dark=dark, narrow=narrow)
    gc.collect()  # a figure is a cycle of references with megabytes of pixels: else ten of them wait to be freed
    return drawn.getvalue()


def _report(request: Request, template: str, page: object, **more: object) -> Response:
    zone = number_format.zone_name(datetime.now().astimezone())
    values = {"page": page, "made": number_format.clock(time.time_ns()), "zone": zone, "version": version("truerate")}
    return show(request, template, {**values, **more})
