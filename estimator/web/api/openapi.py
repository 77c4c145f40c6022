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
    "description": "its id, as `truerate devices` shows it",
    "schema": {"type": "string", "pattern": "^" + ID.pattern.removesuffix(r"\Z") + "$"},
}
_COMMANDS = {
    "recalibrate": "Ask for three new turns; the old calibration stays in use until they are taken. `words` is the reason.",
    "cancel": "Stop a calibration under way; the old one stays.",
    "note": "Mark this moment of a device with `words`: kept, and in every recording of the ward.",
    "place": "Say where and by whom the device is worn from now on; an empty body ends the placement.",
}


@cache
def document() -> dict[str, Any]:
    """Return the complete OpenAPI 3.1 document as JSON-compatible values; built once, then cached."""
    kinds = (Devices, Device, Calibrations, Answer, Reply, Words, Placing, Standings, Error)
    _, schemas = msgspec.json.schema_components(kinds, ref_template=_REF)
    of_one = {400: "no id of a device, or a parameter", 404: "no such device was heard of"}
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "truerate",
            "version": version("truerate"),
            "description": "The devices of a ward. Everybody may look; commands need a name and a secret. "
            "Rates are rad/s, times ISO 8601 in UTC; null is not known. A parameter that is not told is refused. "
            "Beside what is told of each place, every place answers an `Error` with 400 to a foreign `Host`, with 405 to "
            "another method, and with 500 where the dashboard itself fails.",
            "license": {"name": "MIT", "identifier": "MIT"},
        },
        "paths": {
            "/api/v1/devices": {
                "get": _get(
                    "listDevices",
                    "All devices, those that need a person first",
                    Devices,
                    [],
                    {400: "no such parameter"},
                )
            },
            "/api/v1/devices/{device}": {"get": _get("getDevice", "One device", Device, [_DEVICE], of_one)},
            "/api/v1/devices/{device}/calibrations": {
                "get": _get(
                    "listCalibrations",
                    "Its calibrations, the latest first",
                    Calibrations,
                    [_DEVICE, _BEFORE, _LIMIT],
                    {
                        400: "no id of a device, or no such parameter",
                        404: "no such device, or no such calibration of it",
                    },
                )
            },
            "/api/v1/alerts": {"get": _get("listAlerts", "Standing alerts", Standings, [], {400: "no such parameter"})},
            "/api/v1/alerts/{device}/acknowledge": {
                "post": _post(
                    "acknowledge", "Say that a person has seen an alert; `words` is its kind, or empty for all."
                )
            },
            "/api/v1/stream": {
                "get": {
                    **_get(
                        "readStream",
                        "The next corrected samples, each once",
                        Answer,
                        [_OF, _AFTER, _HZ, _WAIT],
                        {
                            400: "no id of a device, or a parameter",
                            404: "no such device was heard of",
                            503: "no router, no device yet, or too many programs read; see Retry-After",
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
    "description": "those that are older than the calibration of this id: `next` of an answer",
    "schema": {"type": "string", "minLength": 1},
}
_LIMIT = {
    "name": "limit",
    "in": "query",
    "description": "how many at most",
    "schema": {"type": "integer", "minimum": 1, "maximum": MOST, "default": PAGE},
}


_STREAM = (
    "Waits for the next samples. The first request begins now; give each text of `after` as a parameter of the next request. "
    "A WebSocket at the same address sends each element of `documents` as a message: text, or with `format=protobuf` the bytes "
    "of a CorrectedBatch (docs/wire.md). Code 4000 + an HTTP status closes a refused WebSocket, with the reason in words."
)
_OF = {
    "name": "device",
    "in": "query",
    "description": "a device; may be given again; without it, the whole ward",
    "schema": {"type": "array", "maxItems": DEVICES, "items": _DEVICE["schema"]},
}
_AFTER = {
    "name": "after",
    "in": "query",
    "description": "where to resume, DEVICE.BOOT.NUMBER of the last sample; may be given again. Devices without it, "
    "and an empty one, begin with all that is kept",
    "schema": {"type": "array", "items": {"type": "string", "pattern": f"^({PLACE.pattern})?$"}},
}
_HZ = {
    "name": "hz",
    "in": "query",
    "description": "means a second instead of every sample",
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
        400: "not understood",
        401: "nobody, or a wrong secret",
        403: "not of this session, or from a page of another origin",
        404: "no such device was heard of",
        408: "the body came too slowly, or not to its end",
        409: "the estimator does not do it, and says why",
        413: "too long",
        415: "not JSON",
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
        "responses": _responses("Done, in the estimator's words", Reply, errors),
    }


def _responses(words: str, kind: type, errors: dict[int, str]) -> dict[str, Any]:
    def one(description: str, name: str) -> dict[str, Any]:
        return {
            "description": description,
            "content": {"application/json": {"schema": {"$ref": _REF.format(name=name)}}},
        }

    return {"200": one(words, kind.__name__), **{str(code): one(said, "Error") for code, said in errors.items()}}
