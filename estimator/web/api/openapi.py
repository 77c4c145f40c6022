"""OpenAPI 3.1 document of /api/v1, generated from the response types."""

from functools import cache
from importlib.metadata import version
from typing import Any

import msgspec

from bridge.wire.keys import ID
from estimator.web.api.answers import MOST, PAGE, Calibrations, Device, Devices, Error, Placing, Reply, Standings, Words
from estimator.web.stream.documents import Answer
from estimator.web.stream.request import DEVICES, FASTEST_HZ, LONGEST_S, PLACE, SLOWEST_HZ, USUAL_S

_REF = "#/components/schemas/{name}"
_DEVICE = {
    "name": "device",
    "in": "path",
    "required": True,
    "description": "device id, as `truerate devices` shows it",
    "schema": {"type": "string", "pattern": "^" + ID.pattern.removesuffix(r"\Z") + "$"},
}
_COMMANDS = {
    "recalibrate": "Request three new turns. The old calibration stays in use until they are accepted. `words` is the reason.",
    "cancel": "Cancel a running calibration. The previous calibration stays in use.",
    "note": "Attach the note `words` to this moment of a device. The store and all running recordings keep the note.",
    "place": "State where and by whom the device is worn from now on. An empty body ends the placement.",
}


@cache
def document() -> dict[str, Any]:
    """Return the complete OpenAPI 3.1 document as JSON-compatible values; built once, then cached."""
    kinds = (Devices, Device, Calibrations, Answer, Reply, Words, Placing, Standings, Error)
    _, schemas = msgspec.json.schema_components(kinds, ref_template=_REF)
    of_one = {400: "invalid device id, or unknown parameter", 404: "device was never heard"}
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "truerate",
            "version": version("truerate"),
            "description": "The devices of a ward. Everybody may read; commands need a name and a secret. "
            "Rates are in rad/s, times in ISO 8601 and UTC; null means unknown. A parameter that is not listed is refused. "
            "Besides the listed answers, every path answers an `Error`: 400 to a foreign `Host`, 405 to another method, "
            "and 500 if the dashboard itself fails.",
            "license": {"name": "MIT", "identifier": "MIT"},
        },
        "paths": {
            "/api/v1/devices": {
                "get": _get(
                    "listDevices",
                    "All devices; those that need a person come first",
                    Devices,
                    [],
                    {400: "unknown parameter"},
                )
            },
            "/api/v1/devices/{device}": {"get": _get("getDevice", "One device", Device, [_DEVICE], of_one)},
            "/api/v1/devices/{device}/calibrations": {
                "get": _get(
                    "listCalibrations",
                    "Calibrations of one device, the latest first",
                    Calibrations,
                    [_DEVICE, _BEFORE, _LIMIT],
                    {
                        400: "invalid device id, or unknown parameter",
                        404: "unknown device, or a calibration that this device does not have",
                    },
                )
            },
            "/api/v1/alerts": {"get": _get("listAlerts", "Standing alerts", Standings, [], {400: "unknown parameter"})},
            "/api/v1/alerts/{device}/acknowledge": {
                "post": _post(
                    "acknowledge",
                    "Acknowledge an alert: a person has seen it. `words` is the kind of alert; empty acknowledges all.",
                )
            },
            "/api/v1/stream": {
                "get": {
                    **_get(
                        "readStream",
                        "The next corrected samples, each sample once",
                        Answer,
                        [_OF, _AFTER, _HZ, _WAIT],
                        {
                            400: "invalid device id, or unknown parameter",
                            404: "device was never heard",
                            503: "no router, no device yet, or too many programs read the stream; see Retry-After",
                        },
                    ),
                    "description": _STREAM,
                }
            },
            **{f"/api/v1/devices/{{device}}/{verb}": {"post": _post(verb, words)} for verb, words in _COMMANDS.items()},
        },
        "components": {
            "schemas": schemas,
            "securitySchemes": {
                "secret": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "`name.secret`: `truerate people add script --token` makes one",
                }
            },
        },
    }


_BEFORE = {
    "name": "before",
    "in": "query",
    "description": "id of a calibration; the answer lists older calibrations only. Use `next` of the previous answer",
    "schema": {"type": "string", "minLength": 1},
}
_LIMIT = {
    "name": "limit",
    "in": "query",
    "description": "largest number of calibrations in one answer",
    "schema": {"type": "integer", "minimum": 1, "maximum": MOST, "default": PAGE},
}


_STREAM = (
    "Waits for the next samples. The first request begins now; pass each text of `after` as a parameter of the next request. "
    "A WebSocket at the same address sends each element of `documents` as a message: text, or with `format=protobuf` the bytes "
    "of a CorrectedBatch (docs/wire.md). A refused WebSocket is closed with code 4000 + the HTTP status, and a reason in words."
)
_OF = {
    "name": "device",
    "in": "query",
    "description": "device id; repeatable. Without this parameter: the whole ward",
    "schema": {"type": "array", "maxItems": DEVICES, "items": _DEVICE["schema"]},
}
_AFTER = {
    "name": "after",
    "in": "query",
    "description": "where to resume: DEVICE.BOOT.NUMBER of the last sample; repeatable. Devices that are not named, "
    "and an empty text, begin with all kept samples",
    "schema": {"type": "array", "items": {"type": "string", "pattern": f"^({PLACE.pattern})?$"}},
}
_HZ = {
    "name": "hz",
    "in": "query",
    "description": "mean rates per second to send, instead of every sample",
    "schema": {"type": "number", "minimum": SLOWEST_HZ, "maximum": FASTEST_HZ},
}
_WAIT = {
    "name": "wait_s",
    "in": "query",
    "description": "longest wait for a sample, s",
    "schema": {"type": "number", "minimum": 0, "maximum": LONGEST_S, "default": USUAL_S},
}


def _get(name: str, words: str, kind: type, parameters: list[dict[str, Any]], errors: dict[int, str]) -> dict[str, Any]:
    return {
        "operationId": name,
        "summary": words,
        "parameters": parameters,
        "responses": _responses(words, kind, errors),
    }


def _post(verb: str, words: str) -> dict[str, Any]:
    errors = {
        400: "invalid request",
        401: "no name and secret, or a wrong secret",
        403: "wrong session token, or a page of another origin",
        404: "device was never heard",
        408: "the body arrived too slowly, or incomplete",
        409: "the estimator refuses the command, and gives the reason",
        413: "the body is too long",
        415: "the body is not JSON",
        429: "too many wrong secrets; see Retry-After",
        503: "no estimator answers",
    }
    body = _REF.format(name="Placing" if verb == "place" else "Words")
    return {
        "operationId": verb,
        "summary": words,
        "parameters": [_DEVICE],
        "requestBody": {"content": {"application/json": {"schema": {"$ref": body}}}},
        "security": [{"secret": []}],
        "responses": _responses("Command carried out; the estimator's message", Reply, errors),
    }


def _responses(words: str, kind: type, errors: dict[int, str]) -> dict[str, Any]:
    def one(description: str, name: str) -> dict[str, Any]:
        return {
            "description": description,
            "content": {"application/json": {"schema": {"$ref": _REF.format(name=name)}}},
        }

    return {"200": one(words, kind.__name__), **{str(code): one(said, "Error") for code, said in errors.items()}}
