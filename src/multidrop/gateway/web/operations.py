"""An operation of the API, told once: its route and its place in the OpenAPI document come of it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from multidrop.gateway.web.tokens import Right

Schema = Mapping[str, Any]

TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
WHOLE: Schema = {"type": "integer"}
YES_NO: Schema = {"type": "boolean"}
TIME: Schema = {"type": "string", "format": "date-time"}
ANY_VALUE: Schema = {"type": ["number", "string", "boolean", "null"]}


def maybe(schema: Schema) -> Schema:
    """The same, or null."""
    types = schema["type"]
    return {**schema, "type": [*(types if isinstance(types, list) else [types]), "null"]}


def listed(schema: Schema) -> Schema:
    return {"type": "array", "items": schema}


def fields(**properties: Schema) -> Schema:
    """An object with all of these."""
    return {"type": "object", "properties": properties, "required": list(properties)}


def ref(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


@dataclass(frozen=True, slots=True)
class Parameter:
    """In the path where its name stands there in braces, else in the query."""

    name: str
    meaning: str
    schema: Schema = field(default_factory=lambda: TEXT)
    required: bool = False
    example: Any = None


DEVICE = Parameter("device", "a device, by its name in the plant file", example="infeed")


@dataclass(frozen=True, slots=True)
class Operation:
    """One method of one path. `right` is None for what anybody may ask who reaches the server."""

    method: str
    path: str
    summary: str
    answer: Callable[[Request], Awaitable[Response]]
    right: Right | None = Right.READ
    parameters: tuple[Parameter, ...] = ()
    body: Schema | None = None
    content: str = "application/json"
    schema: Schema = field(default_factory=lambda: TEXT)
    statuses: tuple[int, ...] = ()
    """Of failures, besides those that any operation can have."""

    def __post_init__(self) -> None:
        assert (self.method == "GET") == (
            self.body is None
        )  # what acts demands a body, which is JSON

    @property
    def id(self) -> str:
        words = self.path.strip("/").replace("{", "").replace("}", "").replace(".", "/")
        return "_".join([self.method.lower(), *words.split("/")])


REASONS = {
    400: "the request makes no sense",
    401: "a token is needed, or this one is not known",
    403: "not allowed: by the token, by the plant, or for another site",
    404: "there is no such thing",
    409: "all of this device is being read already",
    413: "the body is too long",
    415: "the body is not application/json",
    421: "the request names another server",
    429: "too many listeners",
    502: "the device refused, or its answer cannot be used",
    503: "the port of the line is away, the disk takes nothing, or the gateway stops",
    504: "the device does not answer",
}


def document(operations: tuple[Operation, ...], schemas: Mapping[str, Schema]) -> dict[str, Any]:
    """The OpenAPI document."""
    paths: dict[str, dict[str, Any]] = {}
    for operation in operations:
        paths.setdefault(operation.path, {})[operation.method.lower()] = _described(operation)
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "multidrop gateway",
            "version": version("multidrop"),
            "description": "Latest values, history, frames and writes of a plant on serial lines.",
            "license": {"name": "Apache-2.0", "identifier": "Apache-2.0"},
        },
        "paths": paths,
        "components": {
            "schemas": dict(schemas),
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
    }


def _described(operation: Operation) -> dict[str, Any]:
    statuses = {400, 403, 421, *operation.statuses}
    if operation.right is not None:
        statuses.add(401)
    if operation.body is not None:
        statuses |= {413, 415}
    failure = {"application/json": {"schema": ref("Failure")}}
    described: dict[str, Any] = {
        "operationId": operation.id,
        "summary": operation.summary,
        "parameters": [_parameter(item, operation.path) for item in operation.parameters],
        "responses": {
            "200": {
                "description": operation.summary,
                "content": {operation.content: {"schema": operation.schema}},
            },
            **{
                str(status): {"description": REASONS[status], "content": failure}
                for status in sorted(statuses)
            },
        },
    }
    if operation.right is Right.READ:
        described["security"] = [{}, {"token": []}]
    elif operation.right is not None:
        described["security"] = [{"token": []}]
    if operation.body is not None:
        described["requestBody"] = {
            "required": True,
            "content": {"application/json": {"schema": operation.body}},
        }
    return described


def _parameter(item: Parameter, path: str) -> dict[str, Any]:
    in_path = f"{{{item.name}}}" in path
    described: dict[str, Any] = {
        "name": item.name,
        "in": "path" if in_path else "query",
        "required": in_path or item.required,
        "description": item.meaning,
        "schema": item.schema,
    }
    if item.example is not None:
        described["example"] = item.example
    return described
