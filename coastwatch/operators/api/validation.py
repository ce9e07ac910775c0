"""Parameters and bodies of requests: checked outside the event loop where they are large; what is refused is said in a few sentences."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine, Iterator
from itertools import islice
from typing import Any, get_type_hints

from fastapi import HTTPException, Request, Response, WebSocket
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError, ValidationException
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel
from pydantic_core import ErrorDetails
from starlette.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection

from coastwatch.operators.api.bounds import MOST_VALUES, has_too_many_values
from coastwatch.operators.api.streaming import BAD_MESSAGE
from coastwatch.scenario.refusing import in_brackets, models_of, sentence
from coastwatch.spelling import did_you_mean, printable

MOST_ERRORS = 10
"""Errors that an answer names. It says how many more there are."""

LONGEST_SENTENCE = 400
"""Characters of what is said of one error."""

PREFIX = "/api/"
"""Of the paths that take their parameters alone. To others, as of monitors, a proxy may add some."""

SMALL_BODY = 4096
"""Bytes of a body that is checked at once. A larger one is checked in a thread first, while other requests go on."""


class CheckedRoute(APIRoute):
    """A route of known parameters alone, whose body is bounded.

    A large body is checked in a thread: what is valid then takes no time to read again.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of the framework, behind the check. It is called by the framework."""
        handle = super().get_route_handler()
        names = sorted(set(_parameters(self.dependant)))

        async def checked(request: Request) -> Response:
            if request.url.path.startswith(PREFIX):
                _check_names(request, names)
            if self.body_field is None:
                return await handle(request)
            body = await request.body()
            if has_too_many_values(body):
                raise HTTPException(413, f"body: got more than {MOST_VALUES} values, needed fewer")
            if len(body) > SMALL_BODY:
                await run_in_threadpool(_check, self, body)
            return await handle(request)

        return checked


def _parameters(dependant: Dependant) -> Iterator[str]:
    """The names of the parameters of a query that an endpoint and what it depends on take."""
    for field in dependant.query_params:
        models, _ = models_of(field.field_info.annotation)
        if models:
            yield from (one.alias or name for name, one in models[0].model_fields.items())
        else:
            yield field.alias
    for inner in dependant.dependencies:
        yield from _parameters(inner)


def _check_names(request: Request, names: list[str]) -> None:
    """Raises: HTTPException where a parameter has none of these names: what it was meant to do would not be done."""
    unknown = [(name, value) for name, value in request.query_params.multi_items() if name not in names]
    if not unknown:
        return
    texts = []
    for name, value in unknown[:MOST_ERRORS]:
        needed = f"one of {', '.join(names)}{did_you_mean(name, names)}" if names else "none"
        texts.append(_short(printable(f"{name[:80]}: got {value[:80]!r} for an unknown parameter, needed {needed}")))
    raise HTTPException(422, "; ".join([*texts, *_more(len(unknown))]))


def _check(route: APIRoute, body: bytes) -> None:
    """Raises: RequestValidationError as the framework does. What is no JSON is left to the framework."""
    try:
        document = json.loads(body)
    except (ValueError, RecursionError):
        return
    if route.body_field is not None:
        _, errors = route.body_field.validate(document, {}, loc=("body",))
        if errors:
            raise RequestValidationError(errors)


async def refused_socket(socket: WebSocket, error: Exception) -> None:
    """Answers as `refused`, before the socket is open. A server that cannot do that closes it."""
    if "websocket.http.response" in socket.scope.get("extensions", {}):
        await socket.send_denial_response(await refused(socket, error))
    else:
        await socket.accept()
        await socket.close(BAD_MESSAGE)


async def refused(request: HTTPConnection, error: Exception) -> Response:
    """The answer to parameters or a body that are refused: a sentence for each of the first errors."""
    assert isinstance(error, ValidationException)
    errors = error.errors()
    hints = get_type_hints(request.scope["endpoint"], include_extras=True)
    models = [model for hint in hints.values() for model in models_of(hint)[0]]
    texts = [_refusal(one, models[0] if models else BaseModel) for one in islice(errors, MOST_ERRORS)]
    if any(one["loc"] == ("body",) and isinstance(one["input"], bytes) for one in errors):  # it was not read as JSON
        kind = request.headers.get("content-type", "")[:80]
        texts = [printable(f"Content-Type: got {kind!r}, needed application/json")]
    texts += _more(len(errors))
    of_its_type = all(one["type"] == "value_error" for one in errors)  # and wrong by its meaning
    texts = list(dict.fromkeys(texts))  # a parameter that two parts of the endpoint read is wrong once
    return JSONResponse({"detail": "; ".join(texts)}, 400 if of_its_type else 422)


def _refusal(error: ErrorDetails, model: type[BaseModel]) -> str:
    """What an error of a request says: the path of the value in the body, or the name of the parameter, and what was needed."""
    where, *path = error["loc"]
    if error["type"] == "json_invalid":
        return f"body: got no JSON from character {path[0]} on, needed JSON"
    if not path and error["type"] != "value_error":
        path = [where]  # the whole body
    path = [part[:77] + "..." if isinstance(part, str) and len(part) > 80 else part for part in path]
    text = printable(sentence({**error, "loc": tuple(path)}, model, in_brackets, "key" if where == "body" else "parameter"))
    return _short(text)


def _short(text: str) -> str:
    return text if len(text) <= LONGEST_SENTENCE else text[: LONGEST_SENTENCE - 3] + "..."


def _more(errors: int) -> list[str]:
    """What is said of the errors that are not named."""
    return [f"and {errors - MOST_ERRORS} more"] if errors > MOST_ERRORS else []
