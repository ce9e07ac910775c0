"""Parameters and bodies of requests: checked outside the event loop where they are large; what is refused is said in a few sentences."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine
from itertools import islice
from typing import Any, get_type_hints

from fastapi import HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel
from pydantic_core import ErrorDetails
from starlette.concurrency import run_in_threadpool

from coastwatch.operators.api.bounds import MOST_VALUES, has_too_many_values
from coastwatch.scenario.refusing import in_brackets, models_of, sentence
from coastwatch.spelling import printable

MOST_ERRORS = 10
"""Errors that an answer names. It says how many more there are."""

LONGEST_SENTENCE = 400
"""Characters of what is said of one error."""

SMALL_BODY = 4096
"""Bytes of a body that is checked at once. A larger one is checked in a thread first, while other requests go on."""


class CheckedRoute(APIRoute):
    """A route whose body is bounded. If it is large it is checked in a thread: what is valid then takes no time to read again."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of the framework, behind the check. It is called by the framework."""
        handle = super().get_route_handler()
        if self.body_field is None:
            return handle

        async def checked(request: Request) -> Response:
            body = await request.body()
            if has_too_many_values(body):
                raise HTTPException(413, f"body: got more than {MOST_VALUES} values, needed fewer")
            if len(body) > SMALL_BODY:
                await run_in_threadpool(_check, self, body)
            return await handle(request)

        return checked


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


async def refused(request: Request, error: Exception) -> Response:
    """The answer to parameters or a body that are refused: a sentence for each of the first errors."""
    assert isinstance(error, RequestValidationError)
    errors = error.errors()
    hints = get_type_hints(request.scope["endpoint"], include_extras=True)
    models = [model for hint in hints.values() for model in models_of(hint)[0]]
    texts = [_refusal(one, models[0] if models else BaseModel) for one in islice(errors, MOST_ERRORS)]
    if any(one["loc"] == ("body",) and isinstance(one["input"], bytes) for one in errors):  # it was not read as JSON
        kind = request.headers.get("content-type", "")[:80]
        texts = [printable(f"Content-Type: got {kind!r}, needed application/json")]
    if len(errors) > MOST_ERRORS:
        texts.append(f"and {len(errors) - MOST_ERRORS} more")
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
    return text if len(text) <= LONGEST_SENTENCE else text[: LONGEST_SENTENCE - 3] + "..."
