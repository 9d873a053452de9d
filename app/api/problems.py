"""Every error as an RFC 9457 problem document: `application/problem+json` with the offending field and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, PlainTextResponse
from starlette.exceptions import HTTPException

from app.errors import MaryError, NotFound, OverCapacity

MEDIA_TYPE = "application/problem+json"

_log = structlog.get_logger("mary.api")

_SLUGS = {
    400: "bad-request",
    403: "forbidden",
    404: "not-found",
    405: "method-not-allowed",
    412: "precondition-failed",
    413: "too-long",
    415: "unsupported-media-type",
    416: "range-not-satisfiable",
    428: "precondition-required",
    500: "internal",
}
_ADVICE = {
    404: "See /docs for what is there.",
    405: "The Allow header names the methods that work here.",
    412: "Send the ETag of the answer to the offer in If-Match.",
    413: "Send less at a time.",
    415: "Send a body of the type that the detail names; /docs shows what each address takes.",
    428: "Send the ETag of the answer to the offer in If-Match.",
}

EXPLANATIONS = {
    "invalid-input": "A field of the request is missing, unknown, of the wrong type or out of range.",
    "invalid-json": "The body is not JSON. The detail says where reading it stopped.",
    "nothing-to-say": "The text is empty, or nothing in it can be read aloud.",
    "too-long": "The text or the body is over the configured limit.",
    "not-found": "There is no such avatar, voice, stream, utterance or page.",
    "gone": "The stream existed and has ended.",
    "not-ready": "It is still being made. Ask again in a moment.",
    "over-capacity": "The service is full, starting or stopping. The header Retry-After says when to try again.",
    "bad-pack": "The files of an avatar are damaged or of another version.",
    "missing-extra": "An optional part of the service, such as a voice, is not installed.",
    "speech-failed": "The speech engine failed.",
    "alignment-failed": "The aligner failed.",
    "recognition-failed": "What hears the phones of a sound without a text failed.",
    "negotiation-failed": "The WebRTC offer is broken or has nothing in common with what the service can send.",
    "ice-restart-refused": "A WebRTC connection keeps its ICE credentials. DELETE it and send a new offer instead.",
    "precondition-required": "The request must say by If-Match which ICE session it is about.",
    "precondition-failed": "The request is about another ICE session than the present one.",
    "forbidden": "A page of another origin sent a form. See server.cors_origins in the settings.",
    "bad-request": "The request could not be read.",
    "method-not-allowed": "This address does not answer to this method.",
    "unsupported-media-type": "The body is of a type that this address does not take.",
    "range-not-satisfiable": "The range lies outside the file.",
    "internal": "Something failed inside the service. Its log says what.",
}

router = APIRouter()


@router.get("/problems/{slug}", include_in_schema=False)
async def explain(slug: str) -> PlainTextResponse:
    """What a problem's `type` means: the address that the document names."""
    if slug not in EXPLANATIONS:
        raise NotFound(f"there is no problem called {slug!r}")
    return PlainTextResponse(f"{slug}\n\n{EXPLANATIONS[slug]}\n")


def problem(
    status: int,
    slug: str,
    title: str,
    detail: str,
    *,
    field: str = "",
    advice: str = "",
    headers: dict[str, str] | None = None,
) -> JSONResponse:
    """The answer with a problem document."""
    content = document(status, slug, title, detail, field=field, advice=advice)
    return JSONResponse(content, status, {"Cache-Control": "no-store", **(headers or {})}, MEDIA_TYPE)


def document(
    status: int, slug: str, title: str, detail: str, *, field: str = "", advice: str = ""
) -> dict[str, str | int]:
    """A problem document; empty members are left out."""
    members: dict[str, str | int] = {"type": f"/problems/{slug}", "title": title, "status": status, "detail": detail}
    if field:
        members["field"] = field
    if advice:
        members["advice"] = advice
    return members


def of_error(error: MaryError) -> dict[str, str | int]:
    """The problem document of an error."""
    return document(error.status, error.slug, error.title, error.message, field=error.field, advice=error.advice)


def answer(error: MaryError, headers: dict[str, str] | None = None) -> JSONResponse:
    """The answer with the problem document of an error."""
    return JSONResponse(of_error(error), error.status, {"Cache-Control": "no-store", **(headers or {})}, MEDIA_TYPE)


def of_faults(faults: Sequence[Any]) -> dict[str, str | int]:
    """The problem document of what pydantic found wrong, whose places begin with where the fields are ("body")."""
    advice = ""
    if any(fault["type"] == "extra_forbidden" for fault in faults):
        advice = "See /docs for the fields that are known."
    elif _no_file(faults[0]):
        advice = f"Send it as a file, with a name (curl: -F {_field(faults[0])}=@speech.wav)."
    return document(
        422,
        "invalid-input",
        "Invalid input",
        "; ".join(_sentence(fault) for fault in faults),
        field=_field(faults[0]),
        advice=advice,
    )


def install(app: FastAPI) -> None:
    """Map every kind of error of `app` to a problem document; `middleware.Envelope` answers what nobody foresaw."""
    app.add_exception_handler(MaryError, _mary_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _http_exception)


async def _mary_error(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, MaryError)
    if error.status >= 500 and not isinstance(error, OverCapacity):
        cause = {"cause": str(error.__cause__)} if error.__cause__ else {}  # what is not the caller's to read
        _log.error("request failed", problem=error.slug, detail=error.message, **cause)
    headers = {"Retry-After": str(error.retry_after)} if isinstance(error, OverCapacity) else None
    return answer(error, headers)


async def _validation_error(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    faults = error.errors()
    first = faults[0]
    if first["type"] == "json_invalid":
        place, reason = first["loc"][-1], first["ctx"]["error"]
        detail = f"the body is not valid JSON: {reason} at character {place}"
        return problem(400, "invalid-json", "Invalid JSON", detail, advice="Send a JSON object in UTF-8.")
    return JSONResponse(of_faults(faults), 422, {"Cache-Control": "no-store"}, MEDIA_TYPE)


def _field(fault: dict[str, Any]) -> str:
    """Where in the body, path or query: ('body', 'phase', 'frame') -> 'phase.frame'."""
    return ".".join(str(part) for part in fault["loc"][1:]) or str(fault["loc"][0])


def _no_file(fault: dict[str, Any]) -> bool:
    return "Expected UploadFile" in str(fault["msg"])


def _sentence(fault: dict[str, Any]) -> str:
    field = _field(fault)
    if _no_file(fault):
        return f"{field} must be a file"
    match fault["type"]:
        case "extra_forbidden":
            return f"{field} is not a known field"
        case "missing":
            return f"{field} is missing"
        case "model_attributes_type" | "model_type":
            return f"{field} must be a JSON object"
    message = str(fault["msg"])
    return f"{field}: {message[0].lower()}{message[1:]}"


async def _http_exception(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    status = error.status_code
    title = HTTPStatus(status).phrase
    detail = error.detail
    if status == 404 and detail == title:
        detail = f"there is nothing at {request.url.path}"
    elif status == 405 and detail == title:
        detail = f"{request.method} does not work on {request.url.path}"
    headers = dict(error.headers) if error.headers else None
    return problem(
        status, _SLUGS.get(status, "bad-request"), title, detail, advice=_ADVICE.get(status, ""), headers=headers
    )


def unexpected() -> JSONResponse:
    """The answer to a request during which something failed that nobody foresaw."""
    return problem(500, "internal", "Internal error", "something failed inside; the log of the service says what")
